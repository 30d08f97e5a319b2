"""Priorities changed by `hoap3 change`, from another shell, on an arm that runs under `ghc`."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from support.command_bench import (
    PATIENT,
    Done,
    controller,
    emulator,
    endpoint,
    inside,
    wait_for_mode,
)

from hoap3.protocol.runtime.shm_ring import Kind
from hoap3.tools.logs.log import Log
from hoap3.tools.replay import replay
from hoap3.tools.verify.verify import verify

pytestmark = pytest.mark.slow

OVER_S = 0.3
REST_S = 1.5  # of virtual time before the change: the hand is slow by then
LEAST_S = 0.6  # after it
TASKS = ["hand", "elbow", "posture"]
START = ("--set", "parameters.priorities={order: [hand, elbow, posture]}")


@pytest.fixture(scope="module")
def at() -> str:
    return endpoint()


def change(at: str, **what: object) -> Done:
    """Ask for a change; without any, only what there is."""
    words = [json.dumps(what)] if what else []
    return inside("change", *words, "--robot", "lwr", "--connect", at)


def ticks_seen(at: str) -> int:
    done = inside("status", "lwr", "--connect", at, "--json")
    return int(done.json()["tick"])


def wait_for(at: str, seconds: float) -> None:
    """Let so much virtual time pass."""
    then = ticks_seen(at)
    while ticks_seen(at) < then + seconds / 1e-3:
        pass


@pytest.fixture(scope="module")
def told(at: str, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[Done]]:
    """An arm in lockstep whose hand and elbow change places, told from another shell."""
    folder = tmp_path_factory.mktemp("live") / "log"
    robot = ("lwr_weightless", "--lockstep", "--set", "command=torque", *PATIENT)
    with (
        emulator(*robot, "--out", folder, at=at) as arm,
        controller("ghc", *START, "--out", folder, at=at) as law,
    ):
        law.hear("following robot")
        wait_for_mode("active", at, "lwr")
        wait_for(at, REST_S)
        answers = [
            change(at),
            change(at, set=[["hand", "elbow", 1.0]], over_s=OVER_S),
            change(at, set=[["hand", "nobody", 1.0]]),
            change(at, set=[["hand", "elbow", 2.0]]),
        ]
        wait_for(at, LEAST_S)
        answers.append(change(at))
        answers.append(change(at, remove=["elbow"], over_s=0.0))
        assert law.end(2) == 0, law.stderr
        assert arm.end(2) in {0, 1}
    return folder, answers


def test_the_pair_changes_places_and_who_asks_is_told(told):
    before, asked, unknown, outside, after, removed = told[1]
    assert before.json()["priorities"] == {
        "names": TASKS,
        "alpha": [[0, 0, 0], [1, 0, 0], [1, 1, 0]],
        "moving": False,
        "out": [],
    }
    assert asked.code == 0
    assert asked.json()["priorities"]["moving"]
    assert unknown.code == outside.code == 2
    assert "nobody" in unknown.stderr
    assert "hand, elbow, posture" in unknown.stderr
    assert after.json()["priorities"] == {
        "names": TASKS,
        "alpha": [[0, 1, 0], [0, 0, 0], [1, 1, 0]],
        "moving": False,
        "out": [],
    }
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


def test_the_change_is_logged_and_a_replay_repeats_it(told):
    log = Log.open(told[0], "controller")
    changes = [json.loads(r.payload) for r in log.records() if r.kind == Kind.CHANGE]
    assert changes == [
        {"set": [["hand", "elbow", 1.0]], "over_s": OVER_S},
        {"remove": ["elbow"], "over_s": 0.0},
    ]
    again = replay(told[0], [])
    assert again.identical, str(again)


def test_all_that_the_log_claims_is_true(told):
    found = verify(told[0])
    assert found.claims.by_tick() == []
    assert found.claims.counts["alpha"].checked > 1000
