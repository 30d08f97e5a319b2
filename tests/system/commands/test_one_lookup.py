"""Whatever connects to a robot by its name finds it at its port, as the commands do."""

from __future__ import annotations

import json
import signal
from typing import Any

import pytest
import zenoh
from support.command_bench import (
    PATIENT,
    QUIET,
    Command,
    controller,
    emulator,
    endpoint,
    inside,
)

import hoap3
from hoap3.protocol.errors import LinkError, NameTakenError, UsageError
from hoap3.tools.services import find_robot


@pytest.fixture(autouse=True)
def runtime(tmp_path, monkeypatch) -> None:
    monkeypatch.setenv("HOAP3_RUNTIME_DIR", str(tmp_path / "run"))


@pytest.mark.parametrize("name", ["arm", None])
def test_who_connects_to_nothing_is_told_what_was_looked_for_where_and_what_to_do(
    name, monkeypatch
):
    monkeypatch.setattr(find_robot, "listens", lambda _: False)
    with pytest.raises(LinkError) as error:
        hoap3.connect(name)
    words = str(error.value)
    assert ("'arm'" in words) == (name is not None)
    for part in ("this machine", "tcp/127.0.0.1:7447", "hoap3 emulator", "--connect", "endpoint="):
        assert part in words


@pytest.mark.slow
def test_a_robot_at_a_free_port_is_found_by_its_name_alone():
    at = endpoint()
    with emulator("hoap3", *QUIET, "--set", "name=arm", at=at) as robot:
        with hoap3.connect("arm") as connected:
            assert (connected.robot, connected.status()["mode"]) == ("arm", "idle")
        with hoap3.connect() as connected:
            assert connected.description.name == "arm"
        with pytest.raises(LinkError, match=r"this machine: arm$"):
            hoap3.connect("leg")
        (found,) = inside("list", "--live", "--json", "--connect", at).json()["sessions"]
        session = inside("status", "--json").json()["session_id"]
        expected = ("arm", at, robot.process.pid, session)
        keys = ("robot", "endpoint", "pid", "session_id")
        assert tuple(found[key] for key in keys) == expected
        assert robot.end(signal.SIGTERM) == 0


@pytest.mark.slow
def test_stop_reaches_all_robots_of_one_name_on_this_machine():
    first, second = endpoint(), endpoint()
    words = ("hoap3", *QUIET, "--set", "name=arm")
    with emulator(*words, at=first) as one, emulator(*words, at=second) as other:
        warned = other.hear(r"has the same name: arm at (\S+) \(process (\d+)")
        assert warned.groups() == (first, str(one.process.pid))
        found = inside("status", "arm", "--json").json()["robots"]
        assert {each["endpoint"] for each in found} == {first, second}
        with pytest.raises(UsageError) as refused:
            hoap3.connect("arm")
        assert first in str(refused.value)
        assert second in str(refused.value)
        assert inside("recover", "arm").code == 2
        done = inside("stop", "arm", "--json")
        assert done.code == 0
        stopped = {(each["endpoint"], each["mode"]) for each in done.json()["robots"]}
        assert stopped == {(first, "stopped"), (second, "stopped")}


@pytest.mark.slow
def test_two_held_robots_whose_router_starts_later_go_on_and_grant_nothing_new():
    router, places = endpoint(), (endpoint(), endpoint())
    robot = ("hoap3", *QUIET, *PATIENT, "--set", f"link.connect=[{router}]")
    with (
        emulator(*robot, at=places[0]) as one,
        emulator(*robot, at=places[1]) as other,
        controller("qp12", *QUIET, at=places[0]) as first,
        controller("qp12", *QUIET, at=places[1]) as second,
    ):
        for law in (first, second):
            law.hear("following robot")
        opened = _router(router)
        try:
            for side in (one, other):
                told = side.hear(r"2 robots on this network are called 'hoap3': (.*)")[1]
                assert all(place in told for place in places)
                side.hear("name conflict")
            found = inside("status", "--connect", router, "--json").json()["robots"]
            assert {each["endpoint"] for each in found} == set(places)
            assert {each["mode"] for each in found} == {"active"}
            assert len({each["holder"] for each in found} - {None}) == 2
            with pytest.raises(NameTakenError) as refused:
                hoap3.connect("hoap3", router)
            assert all(place in str(refused.value) for place in places)
            with Command("controller", "qp12", *QUIET, "--set", f"link={_client(router)}") as third:
                told = third.hear(r"2 robots on this network .*Waiting until one is left")[0]
                assert all(place in told for place in places)
            done = inside("stop", "hoap3", "--connect", router, "--json").json()["robots"]
            assert {each["endpoint"] for each in done} == set(places)
            assert {each["mode"] for each in done} <= {"stopping", "stopped"}
        finally:
            opened.close()


def _router(at: str) -> Any:
    config = {
        "mode": "router",
        "listen": {"endpoints": [at]},
        "scouting": {"multicast": {"enabled": False}},
    }
    return zenoh.open(zenoh.Config.from_json5(json.dumps(config)))


def _client(at: str) -> str:
    return f"{{mode: client, connect: [{at}]}}"
