"""`hoap3 change`: numbers and priorities changed while they run, from another shell."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
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
    following,
    hoap3,
    inside,
    on_path,
    wait_for_mode,
)

from hoap3.protocol.runtime.shm_ring import Kind
from hoap3.tools.analysis.replay import replay
from hoap3.tools.logs.log import Log
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
    return inside("change", text, "--connect", at, "--json")


def test_a_change_is_followed_recorded_and_repeated(robot, at, tmp_path, monkeypatch):
    log = tmp_path / "log"
    named = "changeable_controllers:Turner"
    with following(named, "--out", log, at=at, environment=on_path(HERE)) as turner:
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
    with following(named, *QUIET, at=at, environment=on_path(HERE)) as faulty:
        change({}, at)
        assert faulty.end() == 1
        assert "controller Faulty failed on a change" in faulty.stderr
        assert "KeyError" in faulty.stderr
    wait_for_mode("stopped", at)
    assert hoap3("recover", "hoap3", "--connect", at).process.returncode == 0


def test_a_number_moves_and_the_log_is_true_of_it(robot, at, tmp_path):
    log = tmp_path / "log"
    with following("qp12", "--out", log, at=at) as command:
        assert inside("change", "--connect", at).json()["gamma"] == 0.5
        done = inside("change", "gamma=0.8", "beta=20", "over_s=0.2", "--connect", at)
        assert done.code == 0
        assert done.stdout.splitlines()[0] == "gamma: 0.5 → 0.8"
        deadline = time.monotonic() + 20.0
        while inside("change", "--connect", at).json()["gamma"] != 0.8:
            assert time.monotonic() < deadline
        assert command.end(2) == 0
    assert replay(log, []).identical
    claims = verify(log).claims
    assert claims.checked
    assert not claims.false


def test_what_cannot_be_changed_is_said(robot, at):
    with following("qp12", *QUIET, at=at) as command:
        for arguments, problem in [
            (("change", '{"gama": 0.3}'), "gama: unknown key"),
            (("change", "gamma=3"), "gamma: should be less than or equal to 1"),
            (("change", "gamma=0.5", "psi_scale=one"), "does not change while it runs"),
            (("change", "gamma=0.5", "beta"), "is not KEY=VALUE"),
            (("change", "gama"), "is not KEY=VALUE"),
            (("change", "[1]"), "is no JSON object"),
            (("change", "{"), "is not JSON"),
            (("change", "{}", "--robot", "no robot"), "is not the name of"),
            (("priorities", "set", "hand", "foot", "0.5", "--over", "2"), "renamed change"),
        ]:
            done = inside(*arguments, "--connect", at)
            assert done.code == 2
            assert problem in done.stderr
        assert command.end(2) == 0


def test_where_nobody_controls_it_is_said(robot, at):
    wait_for_mode("idle", at)
    done = change({"speed": 0.001}, at)
    assert done.code == 1
    assert "no controller of robot 'hoap3' answers" in done.stderr


OVER_S = 0.3
REST_S = 1.5  # of virtual time before the change: the hand is slow by then
LEAST_S = 0.6  # after it
TASKS = ["hand", "elbow", "posture"]
START = ("--set", "parameters.priorities={order: [hand, elbow, posture]}")


@pytest.fixture(scope="module")
def arm_at() -> str:
    return endpoint()


def change_priorities(arm_at: str, **what: object) -> Done:
    """Ask for a change; without any, only what there is."""
    words = [json.dumps(what)] if what else []
    return inside("change", *words, "--robot", "lwr", "--connect", arm_at, "--json")


def ticks_seen(arm_at: str) -> int:
    done = inside("status", "lwr", "--connect", arm_at, "--json")
    return int(done.json()["tick"])


def wait_for(arm_at: str, seconds: float) -> None:
    """Let so much virtual time pass."""
    then = ticks_seen(arm_at)
    while ticks_seen(arm_at) < then + seconds / 1e-3:
        pass


@pytest.fixture(scope="module")
def told(arm_at: str, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[Done]]:
    """An arm in lockstep whose hand and elbow change places, told from another shell."""
    folder = tmp_path_factory.mktemp("live") / "log"
    robot = ("lwr_weightless", "--lockstep", "--set", "command=torque", *PATIENT)
    with (
        emulator(*robot, "--out", folder, at=arm_at) as arm,
        controller("ghc", *START, "--out", folder, at=arm_at) as law,
    ):
        law.wait_for("following robot")
        wait_for_mode("active", arm_at, "lwr")
        wait_for(arm_at, REST_S)
        answers = [
            change_priorities(arm_at),
            change_priorities(arm_at, set=[["hand", "elbow", 1.0]], over_s=OVER_S),
            change_priorities(arm_at, set=[["hand", "nobody", 1.0]]),
            change_priorities(arm_at, set=[["hand", "elbow", 2.0]]),
        ]
        wait_for(arm_at, LEAST_S)
        answers.append(change_priorities(arm_at))
        answers.append(change_priorities(arm_at, remove=["elbow"], over_s=0.0))
        assert law.end(2) == 0, law.stderr
        assert arm.end(2) in {0, 1}
    return folder, answers


def test_the_pair_changes_places_and_who_asks_is_told(told):
    before, asked, unknown, outside, after, removed = told[1]
    still = {"names": TASKS, "moving": False, "out": []}
    assert before.json()["priorities"] == {**still, "alpha": [[0, 0, 0], [1, 0, 0], [1, 1, 0]]}
    assert asked.code == 0
    assert asked.json()["priorities"]["moving"]
    assert unknown.code == outside.code == 2
    assert "nobody" in unknown.stderr
    assert "hand, elbow, posture" in unknown.stderr
    assert after.json()["priorities"] == {**still, "alpha": [[0, 1, 0], [0, 0, 0], [1, 1, 0]]}
    assert removed.code == 0
    assert removed.json()["priorities"]["out"] == ["elbow"]


def test_torques_do_not_jump_where_priorities_move(told):
    log = Log.open(told[0], "controller")
    extra, names = log.setpoints()["extra"], list(log.names("extra"))
    alpha = extra[:, names.index("alpha_hand_elbow")]
    moving = np.flatnonzero((alpha > 0.0) & (alpha < 1.0))
    assert moving.size >= 290
    assert np.diff(alpha).max() < 2.5 / (OVER_S * 1000)  # (15) is steepest in its middle
    tau = log.setpoints()["values"]
    step = np.abs(np.diff(tau[moving[0] - 1 : moving[-1] + 2], axis=0)).max()
    assert step < 0.5  # N m in a tick; at once it would be 17


def test_the_change_is_logged_true_and_repeated(told):
    log = Log.open(told[0], "controller")
    changes = [json.loads(r.payload) for r in log.records() if r.kind == Kind.CHANGE]
    assert changes == [
        {"set": [["hand", "elbow", 1.0]], "over_s": OVER_S},
        {"remove": ["elbow"], "over_s": 0.0},
    ]
    again = replay(told[0], [])
    assert again.identical, str(again)
    found = verify(told[0])
    assert found.claims.by_tick() == []
    assert found.claims.counts["alpha"].checked > 1000
