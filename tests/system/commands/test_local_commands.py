"""`hoap3 stop|status|recover|release|change` without an endpoint: the robots of this machine."""

from __future__ import annotations

import os
import signal
from contextlib import closing
from pathlib import Path

import pytest
from support.command_bench import QUIET, controller, emulator, endpoint, inside, tell

from hoap3.protocol.errors import LinkError, UsageError
from hoap3.protocol.link import local_control
from hoap3.protocol.link.local_control import LocalControl
from hoap3.tools.cli.options import ENDPOINT
from hoap3.tools.services import client, find_robot
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
        assert inside("status").stdout == f"arm: idle, follows nobody\n{where}"
        assert inside("status", "arm", "--json").json().keys() == tell("status", at, "arm").keys()
        assert inside("stop", "--json").json()["mode"] == "stopped"
        stopped = inside("status", "--connect", at).stdout
        assert stopped.startswith("arm: stopped, follows nobody; ")
        assert "hoap3 recover arm" in stopped
        told = inside("status", "--json").json()
        assert (told["robot"], told["stop_reason"]) == ("arm", "command")
        assert inside("recover").stdout == "arm: idle, follows nobody\n"
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
    made = [LocalControl("arm", ("tcp/127.0.0.1:1",))]
    for number in (1, 2):  # as processes of their own have them
        other = runtime / f"robot-leg-{number}.sock"
        made.append(LocalControl("leg", ()))
        made[-1].path.rename(other)
        made[-1].path = other
    try:
        with pytest.raises(UsageError, match=r"3 robots run on this machine: arm .*leg .*Add its"):
            ask_robots(None, "stop", None)
        with pytest.raises(UsageError, match=r"2 robots called .leg. run .*leg .*leg .*--connect"):
            reach_robot("leg", None)
    finally:
        for one in made:
            one.close()


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
            law.hear(r"waiting for robot 'leg' .* this machine: arm")
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
    with pytest.raises(UsageError, match="the change has 70011 bytes; a robot takes 65536"):
        client.change("arm", {"key": "x" * 70_000}, "tcp/127.0.0.1:1")


@pytest.mark.parametrize("robot", ["", "*", "Arm", "../arm", "arm-1"])
def test_what_is_no_name_is_refused(robot):
    for ask in (release_robot, lambda name: ask_robots(name, "stop", None)):
        with pytest.raises(UsageError, match="not the name of a robot"):
            ask(robot)
