"""The problems of `weighted` and `tsid`: what answers claim holds, and changed answers fail."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from hoap3.protocol.errors import SolverError
from hoap3.protocol.robot.description import RobotDescription
from hoap3.protocol.runtime.shm_ring import Kind, Record
from hoap3.remote_controller.controllers.acceleration import weighted as weighted_controller
from hoap3.remote_controller.problems.oracles.parameters import UnverifiableError
from hoap3.remote_controller.problems.tsid import TsidProblems
from hoap3.remote_controller.problems.weighted import WeightedProblems
from hoap3.remote_controller.solvers.ghc import weighted
from hoap3.remote_controller.solvers.qp.dense_qp import Program
from hoap3.remote_controller.solvers.tsid import tsid
from hoap3.tools.verify.claims import Claims

sys.path.append(str(Path(__file__).parent))
from checked_motion import check_motion, missed_changes, missed_motions
from driven_motion import recorded_motion

Array = NDArray[np.float64]
Records = tuple[list[Record], dict[str, Any]]
TICKS = 300
BUILDERS = {"weighted": WeightedProblems, "tsid": TsidProblems}
HAND: dict[str, Any] = {"kind": "point", "position_m": [-0.5, -0.25, 0.49]}
PRESSING = [
    {"name": "hand", "task": "wrench", "kp": 30.0, "kd": 20.0, "parameters":
        {"frame": "ee", "target": HAND, "normal": [0.0, 0.0, 1.0], "force_n": 10.0,
         "force_ki_per_s": 5.0}},
    {"name": "posture", "task": "posture", "kp": 30.0, "parameters": {"posture": "bent"}},
]  # fmt: skip
CIRCLE = {"kind": "circle", "center_m": [0.0, -0.5, 0.3], "radius_m": 0.05, "period_s": 1.0}
MOVING = [
    {"name": "hand", "task": "frame_position", "kp": 30.0, "parameters":
        {"frame": "ee", "weights": [1.0, 2.0, 1.0], "target": {**CIRCLE, "approach_s": 0.2}}},
    {"name": "posture", "task": "posture", "kp": 30.0, "parameters": {"posture": "table1"}},
]  # fmt: skip
WEIGHTS: dict[str, Any] = {
    "weights": {"hand": 1.0, "elbow": 0.1, "posture": 0.001},
    "timeline": [
        {"at_s": 0.05, "weights": {"hand": 0.1}, "over_s": 0.05},
        {"at_s": 0.15, "weights": {"elbow": 0.0}, "over_s": 0.02},
        {"at_s": 0.2, "weights": {"elbow": 2.0}},
    ],
}
OF_TSID: dict[str, Any] = {
    "timeline": [
        {"at_s": 0.05, "weights": {"rest": 0.5}, "over_s": 0.05},
        {"at_s": 0.15, "weights": {"pose": 0.0}, "over_s": 0.02},
        {"at_s": 0.2, "weights": {"pose": 2.0, "rest": 0.0}},
    ],
}
REQUESTS: dict[int, dict[str, Any]] = {
    100: {"weights": {"posture": 0.2, "hand": 0.4}, "over_s": 0.03},
    120: {"weights": {"hand": 3.0}},
    170: {"w_r": 0.02, "over_s": 0.02},
    190: {"tasks": {"hand": {"kp": 40.0}}, "null_damping_per_s": 20.0, "over_s": 0.01},
}
REQUESTS_OF_TSID: dict[int, dict[str, Any]] = {
    100: {"weights": {"rest": 0.2}, "over_s": 0.03},
    120: {"weights": {"pose": 3.0}},
    170: {"posture": {"kp": 20.0}, "over_s": 0.02},
    190: {"task": {"kp": 40.0}, "bounds": {"speed_share": 0.5}, "over_s": 0.01},
}
ROUGH: dict[str, Any] = {
    "noise": 1e-4, "lost": 0.05, "unseen": 0.05, "pauses": (60, 61, 150), "not_finite": (0, 80, 81)
}  # fmt: skip
PRESSED: dict[str, Any] = {"tasks": PRESSING, "pressed": {70: 3.0, 90: 14.0, 180: 0.0, 190: 12.0}}
FORCE: dict[str, Any] = {**PRESSED, "priorities": {"weights": {"posture": 0.01}}, **ROUGH}
WEAK: dict[str, Any] = {"gravity": "full", "noise": 1e-4}
SLOW = {"acceleration_max": [3.0]}
BAXTER = "baxter_left_arm"
RUNS: dict[str, tuple[str, str, dict[str, Any]]] = {
    "weighted": ("weighted", "lwr", {"priorities": WEIGHTS, "changes": REQUESTS, **ROUGH}),
    "weighted, force": ("weighted", "lwr", FORCE),
    "weighted, weak motors": (
        "weighted",
        "lwr",
        {**WEAK, "bounds": {**SLOW, "torque_max": [20.0]}},
    ),
    "weighted at bounds": (
        "weighted",
        "lwr",
        {"bounds": {**SLOW, "torque_max": [5.0]}, "noise": 1e-4},
    ),
    "tsid": (
        "tsid_baxter",
        BAXTER,
        {"priorities": OF_TSID, "changes": REQUESTS_OF_TSID, "gravity": "full", **ROUGH},
    ),
    "tsid, force": ("tsid", "lwr", {**FORCE, "priorities": {}}),
    "tsid, default task": ("tsid", "ur5", {"gravity": "full", **ROUGH}),
    "tsid, weak motors": ("tsid_baxter", BAXTER, {**WEAK, "bounds": {"torque_max": [8.0]}}),
    "tsid at bounds": (
        "tsid_baxter",
        BAXTER,
        {"gravity": "full", "bounds": SLOW, "task": {"kp": 400.0}, "noise": 1e-4},
    ),
}
TURN = {"rotation_rad": [0.3, 0.1, 0.0], "reference": "base"}
OTHER: dict[str, tuple[str, str, dict[str, Any]]] = {
    "torques": ("weighted", "lwr", {"regularise": "torque", "gravity": "full"}),
    "without regularisation": ("weighted", "lwr", {"regularise": "none", "priorities": WEIGHTS}),
    "small weight": ("weighted", "lwr", {"w_r": 1e-6, "priorities": WEIGHTS, "bounds": SLOW}),
    "without damping": ("weighted", "lwr", {"null_damping_per_s": 0.0, "bounds": SLOW}),
    "at torques": ("weighted", "lwr", {"bounds": {"torque_max": [3.0]}}),
    "much damping": ("weighted", "lwr", {"null_damping_per_s": 5e3}),
    "naive bounds": ("weighted", "lwr", {"bounds": {"kind": "naive"}}),
    "no bounds": ("weighted", "lwr", {"bounds": {"kind": "none"}}),
    "accelerations": ("weighted", "lwr", {"command": "acceleration", "gravity": "full"}),
    "compensated": (
        "weighted",
        "lwr",
        {"gravity": "compensated", "compensate_friction": False, "priorities": WEIGHTS},
    ),
    "tsid at torques": ("tsid", "lwr", {"bounds": {"torque_max": [3.0]}, "task": {"kp": 400.0}}),
    "tsid, accelerations": ("tsid", "ur5", {"command": "acceleration", "gravity": "full"}),
    "tsid, posture of almost no weight": ("tsid_baxter", BAXTER, {"posture": {"weight": 1e-8}}),
    "tsid, naive bounds": ("tsid_baxter", BAXTER, {"bounds": {"kind": "naive"}}),
    "tsid, no bounds": ("tsid_baxter", BAXTER, {"bounds": {"kind": "none"}}),
    "tsid to a pose": (
        "tsid",
        "ur5",
        {
            "frame": "tool0",
            "goal": {"position_m": [0.3, 0.3, 0.5], "rotation_rad": [0.1, 0.2, 0.3]},
        },
    ),
    "tsid to a posture": ("tsid", "ur5", {"frame": "tool0", "goal": {"posture_rad": [0.5] * 6}}),
}


@cache
def made(name: str, ticks: int = TICKS) -> Records:
    config, robot, given = RUNS[name]
    return recorded_motion(config, robot, ticks, **given)


def checked(config: str, records: list[Record], parameters: dict[str, Any]) -> Claims:
    return check_motion(builder_of(config, records, parameters), records)


def builder_of(
    config: str, records: list[Record], parameters: dict[str, Any]
) -> WeightedProblems | TsidProblems:
    description = RobotDescription.from_json(records[0].payload)
    controller, session = config.partition("_")[0], json.loads(records[1].payload)
    return BUILDERS[controller](description, parameters, session, controller)


def missed(name: str, ticks: int) -> list[tuple[int, str, int]]:
    records, parameters = made(name, ticks)
    return missed_changes(builder_of(RUNS[name][0], records, parameters), records)


@pytest.mark.slow
@pytest.mark.parametrize("name", RUNS)
def test_a_true_log_has_no_false_claim(name):
    found = checked(RUNS[name][0], *made(name))

    assert found.by_tick() == []
    assert found.counts["V"].checked > 0.8 * TICKS
    if "weak" in name:
        assert found.counts["fallback: none is within all"].checked > 10
    else:
        assert found.unverifiable == 0


@pytest.mark.slow
@pytest.mark.parametrize("name", OTHER)
def test_other_settings_have_no_false_claim(name):
    config, robot, given = OTHER[name]

    found = checked(config, *recorded_motion(config, robot, TICKS, noise=1e-4, **given))

    assert found.by_tick() == []
    assert found.unverifiable == 0


@pytest.mark.parametrize("name", ["weighted", "tsid", "weighted, weak motors", "tsid, weak motors"])
def test_a_short_log_is_true_and_a_changed_one_is_not(name):
    assert checked(RUNS[name][0], *made(name, 40)).by_tick() == []
    assert missed(name, 40) == []


@pytest.mark.slow
@pytest.mark.parametrize("name", RUNS)
def test_a_changed_number_is_found(name):
    assert missed(name, TICKS) == []


@pytest.mark.slow
@pytest.mark.parametrize("name", RUNS)
def test_another_motion_with_consistent_torques_is_not_the_optimum(name):
    records, parameters = made(name)

    assert missed_motions(builder_of(RUNS[name][0], records, parameters), records, 1e-6) == []


def give_up(program: Program, **_: float) -> Callable[[float], tuple[bool, Array, Array]]:
    """A solver that finds no answer."""
    return lambda _: (False, np.zeros(program.f.size), np.zeros(len(program.A)))


def without_torque_limits(*given: Any, **options: Any) -> tuple[Array, Array]:
    """A solver that finds no answer unless motors are strong."""
    if np.isfinite(given[7].tau_upper).all():
        raise SolverError("none")
    return weighted.weighted(*given, **options)


@pytest.mark.parametrize(
    ("name", "fallback"), [("tsid", "clipped"), ("weighted", "nearest"), ("weighted", "clipped")]
)
def test_answers_of_a_solver_that_gives_up_are_checked(name, fallback, monkeypatch):
    config, robot, _ = RUNS[name]
    if fallback == "clipped":
        monkeypatch.setattr(tsid, "daqp", give_up)
    if name == "weighted":
        monkeypatch.setattr(weighted_controller, "weighted", without_torque_limits)
    given = {"gravity": "full", "bounds": {"torque_max": [12.0]}, "noise": 1e-4}
    records, parameters = recorded_motion(config, robot, 30, **given)

    found = checked(config, records, parameters)

    assert found.by_tick() == []
    assert sum(found.counts["fallback: no answer"].unverified.values()) == 30
    assert missed_changes(builder_of(config, records, parameters), records) == []


@pytest.mark.parametrize(
    ("name", "key", "value"),
    [
        ("weighted", "w_r", 0.01 + 1e-8),
        ("weighted", "null_damping_per_s", 10.0 + 1e-4),
        ("tsid", "task", {"kp": 10.0 + 1e-5}),
        ("tsid", "posture", {"posture": "fig5_start", "kp": 10.0 + 1e-5}),
    ],
)
def test_another_parameter_is_found(name, key, value):
    records, parameters = made(name, 60)

    assert checked(name, records, {**parameters, key: value}).counts["optimum"].false


@pytest.mark.slow
@pytest.mark.parametrize("config", BUILDERS)
def test_weights_that_change_while_a_target_moves_have_no_false_claim(config):
    change = {"tasks": {"hand": {"parameters": {"weights": [1.5, 1.0, 1.0]}}}, "over_s": 0.05}
    given = {"tasks": MOVING, "priorities": {}, "changes": {90: change}, "noise": 1e-4}
    records, parameters = recorded_motion(config, "lwr", 250, **given)

    assert checked(config, records, parameters).by_tick() == []
    unchanged = [record for record in records if record.kind != Kind.CHANGE]
    assert checked(config, unchanged, parameters).false > 100


@pytest.mark.parametrize("name", ["weighted", "tsid"])
@pytest.mark.parametrize(
    "wrong",
    [
        {"tasks": [{"task": "nothing"}]},
        {"tasks": [{"task": "posture"}], "priorities": {"weights": {"posture": [1]}}},
        {"bounds": {"kind": "some"}},
        {"base": "free"},
        {"w_r": 0.0, "frame": "nothing"},
    ],
)
def test_a_config_that_cannot_be_read_is_unverifiable(name, wrong):
    records, parameters = made(name, 40)

    with pytest.raises(UnverifiableError):
        builder_of(name, records, {**parameters, **wrong})


@pytest.mark.parametrize("name", ["weighted", "tsid"])
def test_negative_weights_of_a_config_are_found(name):
    records, parameters = made(name, 40)
    wrong = {"weights": {"hand": -1.0, "pose": -1.0}}

    found = checked(name, records, {**parameters, "priorities": wrong})

    assert found.counts["weight"].false > 20


@pytest.mark.long
@pytest.mark.parametrize("name", RUNS)
def test_a_long_log_has_no_false_claim(name):
    records, parameters = made(name, 20_000)
    begin = time.perf_counter()

    found = checked(RUNS[name][0], records, parameters)

    spent = 1e3 * (time.perf_counter() - begin) / found.counts["V"].checked
    print(f"{name}: {found.checked} numbers, {spent:.2f} ms per cycle")
    assert found.by_tick() == []
