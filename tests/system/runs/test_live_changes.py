"""`hoap3 change`: what is changed while it runs, from another shell."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from support.command_bench import (
    PATIENT,
    QUIET,
    Command,
    Done,
    controller,
    emulator,
    endpoint,
    events,
    hoap3,
    inside,
    on_path,
    wait_for_mode,
)

from hoap3.protocol.runtime.shm_ring import Kind
from hoap3.tools.logs.log import Log
from hoap3.tools.replay import replay
from hoap3.tools.verify.verify import verify

pytestmark = pytest.mark.slow

HERE = Path(__file__).parent


@pytest.fixture(scope="module")
def at() -> str:
    return endpoint()


@pytest.fixture(scope="module")
def robot(at: str) -> Iterator[Command]:
    with emulator("hoap3", *QUIET, *PATIENT, at=at) as command:
        yield command


def change(request: object, at: str) -> Done:
    text = request if isinstance(request, str) else json.dumps(request)
    return inside("change", text, "--connect", at)


def test_a_change_is_followed_recorded_and_repeated(robot, at, tmp_path, monkeypatch):
    log = tmp_path / "log"
    named = "changeable_controllers:Turner"
    with controller(named, "--out", log, at=at, environment=on_path(HERE)) as turner:
        turner.hear("following robot")
        wait_for_mode("active", at)
        assert change({"speed": 0.005}, at).json() == {"speed": 0.005}
        refused = change({"speed": 5.0}, at)
        assert refused.code == 2
        assert "give a speed of at most 0.01 rad/s" in refused.stderr
        assert change({"speed": -0.005}, at).json() == {"speed": -0.005}
        assert turner.end(2) == 0
        assert "changed (after tick" in turner.stderr
    whole = Log.open(log, "controller")
    changes = [json.loads(r.payload) for r in whole.records() if r.kind == Kind.CHANGE]
    assert changes == [{"speed": 0.005}, {"speed": -0.005}]
    assert [name for name, _ in events(whole)].count("CHANGED") == 2
    monkeypatch.syspath_prepend(str(HERE))
    again = replay(log, [], allow_code=True)
    assert again.identical, str(again)


def test_a_change_that_breaks_the_controller_ends_it_and_the_robot_stops(robot, at):
    named = "changeable_controllers:Faulty"
    with controller(named, *QUIET, at=at, environment=on_path(HERE)) as faulty:
        faulty.hear("following robot")
        wait_for_mode("active", at)
        change({}, at)
        assert faulty.end() == 1
        assert "controller Faulty failed on a change" in faulty.stderr
        assert "KeyError" in faulty.stderr
    wait_for_mode("stopped", at)
    assert hoap3("recover", "hoap3", "--connect", at).process.returncode == 0


def test_a_number_moves_and_the_log_is_true_of_it(robot, at, tmp_path):
    log = tmp_path / "log"
    with controller("qp12", "--out", log, at=at) as command:
        command.hear("following robot")
        wait_for_mode("active", at)
        assert inside("change", "--connect", at).json()["gamma"] == 0.5
        done = inside("change", "gamma=0.8", "beta=20", "over_s=0.2", "--connect", at)
        assert done.code == 0
        deadline = time.monotonic() + 20.0
        while inside("change", "--connect", at).json()["gamma"] != 0.8:
            assert time.monotonic() < deadline
        assert command.end(2) == 0
    assert replay(log, []).identical
    claims = verify(log).claims
    assert claims.checked
    assert not claims.false


def test_what_cannot_be_changed_is_said(robot, at):
    with controller("qp12", *QUIET, at=at) as command:
        command.hear("following robot")
        wait_for_mode("active", at)
        for arguments, problem in [
            (("change", '{"gama": 0.3}'), "gama: unknown key"),
            (("change", "gamma=3"), "gamma: should be less than or equal to 1"),
            (("change", "gamma=0.5", "psi_scale=one"), "does not change while it runs"),
            (("change", "gamma=0.5", "beta"), "is not KEY=VALUE"),
            (("change", "gama"), "is not KEY=VALUE"),
            (("change", "[1]"), "is no JSON object"),
            (("change", "{"), "is not JSON"),
            (("change", "{}", "--robot", "no robot"), "is not the name of"),
            (("priorities", "set", "hand", "foot", "0.5", "--over", "2"), "is now `hoap3 change`"),
        ]:
            done = inside(*arguments, "--connect", at)
            assert done.code == 2
            assert problem in done.stderr
        assert command.end(2) == 0


def test_where_nobody_controls_it_is_said(robot, at):
    wait_for_mode("idle", at)
    done = change({"speed": 0.001}, at)
    assert done.code == 1
    assert "no controller of a robot called 'hoap3' answers" in done.stderr
