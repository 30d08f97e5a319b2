"""Robots are found by name: on this machine, at their port, and among several."""

from __future__ import annotations

import json
import os
import signal
from contextlib import ExitStack, closing
from pathlib import Path
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
    tell,
)

import hoap3
from hoap3.protocol.answers import Status
from hoap3.protocol.errors import LinkError, NameTakenError, UsageError
from hoap3.protocol.link import local_control
from hoap3.protocol.link.local_control import LocalControl
from hoap3.tools.cli.options import ENDPOINT
from hoap3.tools.services import find_robot, sent
from hoap3.tools.services.find_robot import ask_robots, reach_robot, release_robot


@pytest.fixture(autouse=True)
def runtime(tmp_path, monkeypatch) -> Path:
    folder = tmp_path / "run"
    monkeypatch.setenv("HOAP3_RUNTIME_DIR", str(folder))
    return folder


@pytest.mark.slow
def test_the_only_robot_needs_neither_name_nor_endpoint(runtime):
    at = endpoint()
    with emulator("hoap3", *QUIET, "--set", "name=arm", at=at) as robot:
        (path,) = runtime.glob("*.sock")
        assert path.name == f"robot-arm-{robot.process.pid}.sock"
        session = tell("status", at, "arm")["session_id"]
        where = f"  at {at}, process {robot.process.pid}, session {session}\n"
        idle = "arm: idle, no controller; start one to move it\n"
        assert inside("status").stdout == f"{idle}{where}"
        assert inside("status", "arm", "--json").json().keys() == tell("status", at, "arm").keys()
        assert inside("stop", "--json").json()["mode"] == "stopped"
        stopped = inside("status", "--connect", at).stdout
        assert stopped.startswith("arm: stopped, no controller; ")
        assert "hoap3 recover arm" in stopped
        told = inside("status", "--json").json()
        assert (told["robot"], told["stop_reason"]) == ("arm", "command")
        assert inside("recover").stdout == idle
        again = inside("recover")
        assert (again.code, again.stdout) == (1, "")
        assert again.stderr.startswith("error: ")
        assert inside("recover", "--json").json()["recovered"] is False
        assert inside("release").stdout == "arm: follows nobody\n"
        assert inside("release", "--json").json() == {"released": False}
        assert reach_robot(None, None) == reach_robot("arm", None) == ("arm", at)
        assert reach_robot(None, at) == ("arm", at)
        robot.end(signal.SIGKILL)
    assert path.exists()
    done = inside("release")
    assert done.code == 1
    assert "no robot of this user runs on this machine" in done.stderr
    assert not path.exists()


@pytest.mark.slow
def test_a_robot_that_compiles_is_starting():
    starting = Status(mode="starting", holder=None, session_id=7, tick=0, lockstep=False)
    with closing(LocalControl("arm", ("tcp/127.0.0.1:1",), starting.model_dump())):
        assert inside("status").stdout.startswith("arm is starting")
        assert inside("status", "--json").json()["mode"] == "starting"
        for command in ("stop", "record"):
            done = inside(command)
            assert (done.code, done.stdout) == (1, "")
            assert "is starting" in done.stderr
        assert inside("list", "--live", "--json").json()["alive"] == []


def test_a_robot_that_starts_does_not_hide_the_one_that_runs(runtime, monkeypatch):
    monkeypatch.setattr(local_control, "ANSWER_TIMEOUT_S", 0.05)  # no loop serves it
    with (
        closing(LocalControl("arm", ("tcp/127.0.0.1:1",), {"mode": "starting"})),
        closing(LocalControl("leg", ("tcp/127.0.0.1:2",))),
        pytest.raises(LinkError, match=r"'leg'.* does not stop"),
    ):
        ask_robots(None, "stop", None)


@pytest.mark.slow
def test_a_recording_takes_the_only_robot_of_this_machine(tmp_path):
    with emulator("hoap3", *QUIET, "--set", "name=arm", at=endpoint()) as robot:
        done = inside("record", "--duration", 0.2, "--out", tmp_path / "log", "--json")
        assert done.code == 0
        assert done.json()["states"] > 0
        assert robot.end(signal.SIGTERM) == 0


def test_the_list_has_robots_of_this_machine_where_the_network_is_silent(monkeypatch):
    def silent(endpoint: str) -> list[dict]:
        raise LinkError(f"nothing answers at {endpoint}")

    monkeypatch.setattr(find_robot, "alive", silent)
    monkeypatch.setattr(local_control, "ANSWER_TIMEOUT_S", 0.05)  # no loop serves it
    with closing(LocalControl("arm", ())):
        done = inside("list", "--live", "--json")
        assert (done.code, done.json()["alive"]) == (0, ["arm"])
        assert ENDPOINT in done.stderr
        elsewhere = inside("list", "--live", "--json", "--connect", "tcp/10.0.0.1:1")
        assert (elsewhere.code, elsewhere.json()["alive"]) == (1, [])
        keys = ("endpoint", "pid", "host", "session_id")
        leg = {"robot": "leg", **dict.fromkeys(keys)}
        both = [{**leg, "robot": "arm", "pid": os.getpid()}, leg]
        monkeypatch.setattr(find_robot, "alive", lambda _: both)
        found = inside("list", "--live", "--json").json()
        assert found["alive"] == ["arm", "leg"]
        assert found["sessions"] == both


def test_of_several_robots_one_is_to_be_named(runtime, monkeypatch):
    monkeypatch.setattr(local_control, "ANSWER_TIMEOUT_S", 0.05)  # no loop serves them
    with ExitStack() as made:
        made.enter_context(closing(LocalControl("arm", ("tcp/127.0.0.1:1",))))
        for number in (1, 2):  # as processes of their own have them
            leg = made.enter_context(closing(LocalControl("leg", ())))
            leg.path = leg.path.rename(runtime / f"robot-leg-{number}.sock")
        with pytest.raises(UsageError, match=r"3 robots run on this machine: arm .*leg .*Add its"):
            ask_robots(None, "stop", None)
        with pytest.raises(UsageError, match=r"2 robots called .leg. run .*leg .*leg .*--connect"):
            reach_robot("leg", None)


def test_a_robot_that_does_not_run_here_is_looked_for_on_the_network(monkeypatch):
    asked = []
    monkeypatch.setattr(find_robot, "request_all", lambda *words: asked.append(words) or [{}])
    monkeypatch.setattr(find_robot, "alive", lambda _: [{"robot": "leg"}])
    monkeypatch.setattr(find_robot, "listens", lambda _: True)
    with closing(LocalControl("arm", ())):
        assert ask_robots("leg", "stop", None) == ([{"robot": "leg"}], [])
        assert ask_robots(None, "stop", "tcp/10.0.0.1:1") == ([{"robot": "leg"}], [])
    assert asked == [("leg", "stop", ENDPOINT), ("leg", "stop", "tcp/10.0.0.1:1")]


@pytest.mark.slow
def test_who_asks_for_a_robot_that_is_not_there_is_told_which_are(monkeypatch):
    monkeypatch.setattr(find_robot, "listens", lambda _: False)
    with closing(LocalControl("arm", ())):
        with pytest.raises(LinkError, match=r"nothing answers .* this machine: arm$"):
            ask_robots("leg", "status", None)
        with pytest.raises(LinkError, match=r"this machine: arm$"):
            release_robot("leg")
        with controller("qp12", *QUIET, "--set", "robot=leg", at=endpoint()) as law:
            law.wait_for(r"waiting for robot 'leg' .* this machine: arm")
            assert law.end(signal.SIGTERM) == 0
    with pytest.raises(LinkError, match=rf"nothing answers at {ENDPOINT}\. Start it"):
        ask_robots("leg", "status", None)


@pytest.mark.parametrize(
    ("names", "error", "words"),
    [([], LinkError, "no robot is alive at"), (["arm", "leg"], UsageError, "arm, leg. Name one")],
)
def test_on_the_network_only_a_single_robot_needs_no_name(monkeypatch, names, error, words):
    monkeypatch.setattr(find_robot, "alive", lambda _: [{"robot": name} for name in names])
    monkeypatch.setattr(find_robot, "listens", lambda _: True)
    with pytest.raises(error, match=words):
        ask_robots(None, "status", None)
    with pytest.raises(error, match=words):
        reach_robot(None, None)


def test_a_change_that_no_robot_takes_is_refused_before_it_is_sent():
    with pytest.raises(UsageError, match=r"70011 bytes.* 65536"):
        sent.request({"key": "x" * 70_000}, {})


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
        warned = other.wait_for(r"has the same name: arm at (\S+) \(process (\d+)")
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
            law.wait_for("following robot")
        with closing(_router(router)):
            for side in (one, other):
                told = side.wait_for(r"2 robots on this network are called 'hoap3': (.*)")[1]
                assert all(place in told for place in places)
                side.wait_for("name conflict")
            found = inside("status", "--connect", router, "--json").json()["robots"]
            assert {each["endpoint"] for each in found} == set(places)
            assert {each["mode"] for each in found} == {"active"}
            assert len({each["holder"] for each in found} - {None}) == 2
            with pytest.raises(NameTakenError) as refused:
                hoap3.connect("hoap3", router)
            assert all(place in str(refused.value) for place in places)
            with Command("controller", "qp12", *QUIET, "--set", f"link={_client(router)}") as third:
                told = third.wait_for(r"2 robots on this network .*Waiting until one is left")[0]
                assert all(place in told for place in places)
            done = inside("stop", "hoap3", "--connect", router, "--json").json()["robots"]
            assert {each["endpoint"] for each in done} == set(places)
            assert {each["mode"] for each in done} <= {"stopping", "stopped"}


def _router(at: str) -> Any:
    listens, alone = {"endpoints": [at]}, {"multicast": {"enabled": False}}
    config = {"mode": "router", "listen": listens, "scouting": alone}
    return zenoh.open(zenoh.Config.from_json5(json.dumps(config)))


def _client(at: str) -> str:
    return f"{{mode: client, connect: [{at}]}}"
