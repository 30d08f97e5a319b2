"""The problems of `hqp`: what answers claim holds, and changed answers fail."""

from __future__ import annotations

import json
import sys
import time
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hoap3.protocol.robot.description import RobotDescription
from hoap3.protocol.runtime.shm_ring import Record
from hoap3.remote_controller.controllers.acceleration import hqp as controller
from hoap3.remote_controller.problems.check import check_problem
from hoap3.remote_controller.problems.hqp import HqpProblems, levels_of
from hoap3.remote_controller.problems.oracles.parameters import UnverifiableError
from hoap3.remote_controller.problems.statement import Cascade
from hoap3.tools.verify.claims import Claims

sys.path.append(str(Path(__file__).parent))
from checked_motion import check_motion, missed_changes, missed_motions, some_answers
from driven_motion import recorded_motion

Records = tuple[list[Record], dict[str, Any]]
TICKS = 300
ORDER: dict[str, Any] = {"order": ["hand", "elbow", "posture"]}
MOVING: dict[str, Any] = {
    **ORDER,
    "timeline": [
        {"at_s": 0.05, "order": ["elbow", "hand"], "over_s": 0.05},
        {"at_s": 0.15, "remove": "elbow", "over_s": 0.02},
        {"at_s": 0.2, "insert": "elbow", "over_s": 0.02},
    ],
}
REQUESTS: dict[int, dict[str, Any]] = {
    100: {"order": ["posture", ["elbow", "hand"]], "over_s": 0.03},
    120: {"set": [["hand", "elbow", 0.4]]},
    170: {"w_r": 0.02, "over_s": 0.02},
    190: {"tasks": {"hand": {"kp": 40.0}}, "over_s": 0.01},
}
CIRCLE: dict[str, Any] = {
    "kind": "circle", "center_m": [0.0, -0.5, 0.3], "radius_m": 0.05, "period_s": 1.0
}  # fmt: skip
ON_CIRCLE: list[dict[str, Any]] = [
    {"name": "hand", "task": "frame_position", "kp": 30.0,
     "parameters": {"frame": "ee", "target": {**CIRCLE, "approach_s": 0.2}}},
    {"name": "posture", "task": "posture", "kp": 30.0, "parameters": {"posture": "table1"}},
]  # fmt: skip
ELBOW: dict[str, Any] = {
    "name": "elbow", "task": "frame_position", "kp": 30.0, "parameters": {
        "frame": "elbow", "target": {"kind": "point", "position_m": [0.18689, 0.28125, 0.5249]}
    }
}  # fmt: skip
REMOVED = {"order": ["hand", "elbow"], "timeline": [{"at_s": 0.1, "remove": "elbow"}]}
ROUGH: dict[str, Any] = {
    "noise": 1e-4, "lost": 0.05, "unseen": 0.05, "pauses": (60, 61, 150), "not_finite": (0, 80, 81)
}  # fmt: skip
SLOW = {"acceleration_max": [3.0]}
RUNS: dict[str, dict[str, Any]] = {
    "priorities": {"priorities": MOVING, "changes": REQUESTS, **ROUGH},
    "at torques": {"priorities": ORDER, "bounds": {"torque_max": [5.0]}, "noise": 1e-4},
    "at bounds": {"priorities": MOVING, "bounds": SLOW, "noise": 1e-4},
    "weak motors": {"gravity": "full", "bounds": {"torque_max": [20.0]}, "noise": 1e-4},
    "small damping": {"priorities": MOVING, "w_r": 1e-5, "bounds": SLOW},
    "without braking": {"priorities": MOVING, "null_damping_per_s": 0.0},
    "naive bounds": {"priorities": MOVING, "bounds": {"kind": "naive"}},
    "no bounds": {"priorities": MOVING, "bounds": {"kind": "none"}},
    "accelerations": {"priorities": MOVING, "command": "acceleration", "gravity": "full"},
    "without posture": {"tasks": [ON_CIRCLE[0], ELBOW], "priorities": REMOVED, "noise": 1e-4},
    "circle": {"tasks": ON_CIRCLE, "priorities": {"order": ["hand", "posture"]}, **ROUGH},
}


@cache
def made(name: str, ticks: int = TICKS) -> Records:
    return recorded_motion("hqp", "lwr", ticks, **RUNS[name])


def builder_of(records: list[Record], parameters: dict[str, Any]) -> HqpProblems:
    description = RobotDescription.from_json(records[0].payload)
    return HqpProblems(description, parameters, json.loads(records[1].payload), "hqp")


def checked(records: list[Record], parameters: dict[str, Any]) -> Claims:
    return check_motion(builder_of(records, parameters), records)


def missed(name: str, ticks: int) -> list[tuple[int, str, int]]:
    records, parameters = made(name, ticks)
    return missed_changes(builder_of(records, parameters), records)


@pytest.mark.slow
@pytest.mark.parametrize("name", RUNS)
def test_a_true_log_has_no_false_claim(name):
    found = checked(*made(name))

    assert found.by_tick() == []
    assert found.counts["V"].checked > 0.8 * TICKS
    if "weak" in name:
        assert found.counts["fallback: none is within all"].checked > 10
    else:
        assert found.unverifiable == 0


@pytest.mark.parametrize("name", ["priorities", "at bounds", "weak motors"])
def test_a_short_log_is_true_and_a_changed_one_is_not(name):
    assert checked(*made(name, 40)).by_tick() == []
    assert missed(name, 40) == []


@pytest.mark.slow
@pytest.mark.parametrize("name", RUNS)
def test_a_changed_number_is_found(name):
    assert missed(name, TICKS) == []


@pytest.mark.slow
@pytest.mark.parametrize("name", RUNS)
def test_another_motion_with_consistent_torques_is_not_the_optimum(name):
    records, parameters = made(name)
    by = 1e-5 if name == "small damping" else 1e-6  # it amplifies rounding

    assert missed_motions(builder_of(records, parameters), records, by) == []


@pytest.mark.parametrize("name", ["priorities", "at bounds"])
def test_steps_that_are_no_optima_of_their_levels_are_found(name):
    """The steps need not be trusted: two of them off by the same give the same answer."""
    random, (records, parameters) = np.random.default_rng(5), made(name, 40)
    builder = builder_of(records, parameters)
    for _ in some_answers(builder, records, 10):
        statement = builder.problem()
        assert statement is not None
        problem = statement.problems[0]()
        assert isinstance(problem, Cascade)
        by = 1e-5 * random.normal(size=len(problem.error))
        first, second, *rest = problem.steps
        steps = (first + by, second - by, *rest)
        wrong = replace(problem, steps=steps)
        found = check_problem(wrong, statement.answer, statement.answer_error)
        assert "optimum" in [each.name for each in found if not each.holds]


def test_levels_are_those_of_the_controller():
    random = np.random.default_rng(6)
    for _ in range(300):
        alpha = random.choice([0.0, 0.3, 0.5, 0.7, 1.0], (4, 4))
        alpha[np.diag_indices(4)] = random.choice([0.0, 0.0, 0.4, 1.0], 4)

        assert levels_of(alpha) == controller.levels_of(alpha)


@pytest.mark.slow
def test_another_parameter_is_found():
    records, parameters = made("priorities")
    tasks = [dict(task) for task in parameters["tasks"]]
    tasks[0]["kp"] *= 1.0 + 1e-6

    assert checked(records, {**parameters, "tasks": tasks}).counts["answer"].false
    assert checked(records, {**parameters, "w_r": 0.01 + 1e-8}).counts["answer"].false


@pytest.mark.parametrize(
    "wrong",
    [
        {"tasks": [{"task": "nothing"}]},
        {"tasks": [{"task": "posture"}], "priorities": {"order": ["none"]}},
        {"bounds": 3},
        {"base": "free"},
        {"w_r": -1.0},
    ],
)
def test_a_config_that_cannot_be_read_is_unverifiable(wrong):
    records, parameters = made("priorities", 40)

    with pytest.raises(UnverifiableError):
        builder_of(records, {**parameters, **wrong})


@pytest.mark.long
@pytest.mark.parametrize("name", RUNS)
def test_a_long_log_has_no_false_claim(name):
    records, parameters = made(name, 20_000)
    begin = time.process_time()

    found = checked(records, parameters)

    spent = 1e3 * (time.process_time() - begin) / found.counts["V"].checked
    print(f"{name}: {found.checked} numbers, {spent:.2f} ms per cycle")
    assert found.by_tick() == []
