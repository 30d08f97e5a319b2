"""The problems of `joint_acceleration`: what answers claim holds, and changed answers fail."""

from __future__ import annotations

import json
import sys
import time
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hoap3.protocol.messages import Setpoint, State
from hoap3.protocol.robot.description import RobotDescription
from hoap3.protocol.runtime.shm_ring import Kind, Record
from hoap3.remote_controller.problems.joint_acceleration import JointAccelerationProblems
from hoap3.remote_controller.problems.oracles.parameters import UnverifiableError
from hoap3.tools.verify.claims import Claims

sys.path.append(str(Path(__file__).parent))
from checked_motion import check_motion, failing, missed_changes, some_answers
from driven_motion import recorded_motion

Records = tuple[list[Record], dict[str, Any]]
TICKS = 300
ROUGH: dict[str, Any] = {
    "noise": 1e-4, "lost": 0.05, "unseen": 0.05, "pauses": (60, 61, 150), "not_finite": (0, 80, 81)
}  # fmt: skip
CHANGES: dict[int, dict[str, Any]] = {
    40: {"kp": 250.0, "over_s": 0.05},
    120: {"kd": 45.0, "over_s": 0.02},
    170: {"bounds": {"speed_share": 0.1}, "over_s": 0.01},
}
POSITIONS: dict[str, Any] = {"robot": "hoap3", "command": "position"}
ACCELERATIONS: dict[str, Any] = {
    "robot": "ur5", "command": "acceleration", "posture": None, "posture_rad": [0.5] * 6
}  # fmt: skip
RUNS: dict[str, dict[str, Any]] = {
    "positions": {**POSITIONS, "changes": CHANGES},
    "rough": {**POSITIONS, **ROUGH, "changes": CHANGES},
    "at a wall": {**POSITIONS, "posture": None, "posture_rad": [-3.0] * 21},
    "slow": {**POSITIONS, "bounds": {"acceleration_max": [0.5], "speed_share": 0.01}},
    "from outside its ranges": {**POSITIONS, "bounds": {"margin_rad": 0.1}},
    "at its target": {**POSITIONS, "posture": "q0"},
    "naive bounds": {**POSITIONS, "bounds": {"kind": "naive"}},
    "no bounds": {**POSITIONS, "bounds": {"kind": "none"}},
    "accelerations": {**ACCELERATIONS, **ROUGH},
    "setpoints ignored by half of the joints": {**POSITIONS, "ignored": 0.1},
    "around its target": {**ACCELERATIONS, "posture_rad": [], "noise": 1e-7},
    "accelerations at bounds": {**ACCELERATIONS, "bounds": {"acceleration_max": [1.0]}},
}


@cache
def made(name: str, ticks: int = TICKS) -> Records:
    given = dict(RUNS[name])
    return recorded_motion("joint_acceleration", given.pop("robot"), ticks, **given)


def builder_of(records: list[Record], parameters: dict[str, Any]) -> JointAccelerationProblems:
    description = RobotDescription.from_json(records[0].payload)
    session = json.loads(records[1].payload)
    return JointAccelerationProblems(description, parameters, session, "joint_acceleration")


def checked(records: list[Record], parameters: dict[str, Any]) -> Claims:
    return check_motion(builder_of(records, parameters), records)


@pytest.mark.parametrize("name", RUNS)
def test_a_true_log_has_no_false_claim(name):
    found = checked(*made(name))

    assert found.by_tick() == []
    assert found.unverifiable == 0
    assert found.counts["optimum"].checked > 0.8 * TICKS


@pytest.mark.parametrize("name", RUNS)
def test_a_changed_number_is_found(name):
    records, parameters = made(name)

    assert missed_changes(builder_of(records, parameters), records) == []


@pytest.mark.parametrize("name", ["rough", "at a wall", "accelerations"])
def test_another_motion_with_a_consistent_setpoint_is_not_the_optimum(name):
    random, others, count = np.random.default_rng(4), [], 0
    T, (records, parameters) = 1e-3, made(name)
    builder = builder_of(records, parameters)
    for setpoint in some_answers(builder, records, 10):
        if not np.isfinite(setpoint["values"]).all():
            continue
        moved, by = setpoint.copy(), 1e-6 * random.normal(size=len(setpoint["values"]))
        moved["decision"][:] += by
        moved["values"][:] += by if name == "accelerations" else 0.5 * T**2 * by
        builder.history.answer = moved
        count += 1
        if not {"optimum", "rows"} & set(failing(builder.problem())):
            others.append(int(setpoint["tick"]))
        builder.history.answer = setpoint
    print(f"{name}: {count - len(others)} of {count} other motions found")
    assert count > 20
    assert others == []


def test_a_velocity_that_does_not_follow_from_the_answers_is_found():
    """The robot commands what was sent, but the next answer starts from another velocity."""
    records, parameters = made("positions")
    place = [i for i, record in enumerate(records) if record.kind == Kind.STATE][100]
    state = State.like(records[place].payload)
    state.load(records[place].payload)
    state.reference[0] += 1e-9
    changed = [*records]
    changed[place] = records[place]._replace(payload=state.dump())

    false = checked(changed, parameters).by_tick()

    assert {each.claim for each in false} >= {"optimum", "setpoint"}
    assert min(each.tick for each in false) == 100


def test_a_missing_answer_leaves_the_rest_unverified_up_to_a_reset():
    records, parameters = made("rough")
    place = [i for i, record in enumerate(records) if record.kind == Kind.SETPOINT][20]

    found = checked([*records[:place], *records[place + 1 :]], parameters)

    assert found.false == 0
    tick = int(Setpoint.scalars(records[place].payload, "tick")[0])
    assert tick < 60
    assert 10 < found.unverifiable < 60 - tick


@pytest.mark.parametrize("change", [{"kp": 100.0 + 1e-4}, {"kd": 20.0 + 1e-4}])
def test_another_gain_is_found(change):
    records, parameters = made("slow")

    assert checked(records, parameters).false == 0
    assert checked(records, {**parameters, **change}).counts["optimum"].false > 100


def test_a_robot_at_its_target_rests():
    records, parameters = made("at its target")
    last = Setpoint.like(records[-1].payload)
    last.load(records[-1].payload)

    assert last.solver_status == Setpoint.schema.constants["STATUS_AT_TARGET"]
    assert checked(records, parameters).false == 0


@pytest.mark.parametrize(
    "wrong",
    [
        {"kp": float("nan")},
        {"kp": -1.0},
        {"kd": "much"},
        {"posture": [1]},
        {"posture_rad": [1.0]},
        {"bounds": {"kind": "some"}},
        {"bounds": 3},
    ],
)
def test_a_config_that_cannot_be_read_is_unverifiable(wrong):
    records, parameters = made("positions")

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
