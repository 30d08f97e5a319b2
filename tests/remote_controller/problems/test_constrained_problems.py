"""The problems of controllers of accelerations with constraints: what holds, and what is found."""

from __future__ import annotations

import json
import sys
import time
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hoap3.protocol.robot.description import RobotDescription
from hoap3.protocol.runtime.shm_ring import Kind, Record
from hoap3.remote_controller.constraints.barrier import Barrier
from hoap3.remote_controller.constraints.coordinated_stop import CoordinatedStop
from hoap3.remote_controller.constraints.frames.half_space import HalfSpace
from hoap3.remote_controller.constraints.joints.joint_velocity import JointVelocity
from hoap3.remote_controller.problems.acceleration import AccelerationProblems
from hoap3.tools.verify.claims import Claims
from hoap3.tools.verify.statements import builder_of as type_of

sys.path.append(str(Path(__file__).parent))
from checked_motion import check_motion, missed_changes, missed_motions
from driven_motion import recorded_motion

Records = tuple[list[Record], dict[str, Any]]
TICKS, AT = 120, 23
CONTROLLERS = "tsid", "weighted", "ghc", "ghc_torque", "hqp"
ROUGH: dict[str, Any] = {
    "noise": 1e-4, "lost": 0.05, "unseen": 0.05, "pauses": (60, 61, 150), "not_finite": (0, 80, 81)
}  # fmt: skip
TASKS = [
    {"name": "hand", "task": "frame_position", "kp": 60.0, "kd": 12.0, "parameters":
        {"frame": "ee", "target": {"kind": "point", "position_m": [-0.5, -0.25, 0.4]}}},
    {"name": "posture", "task": "posture", "kp": 30.0, "parameters": {"posture": "table1"}},
]  # fmt: skip


class Above(Barrier):
    """A user's own: a frame above a height that bends with a joint."""

    def prepare(self, parameters, kinematics):
        super().prepare(parameters, kinematics)
        self.name_rows(("height",))
        self.frames = kinematics.frame_id("ee"), kinematics.frame_id(self.description.base_frame)
        self.pose = np.zeros(3), np.zeros((3, 3)), np.zeros((6, self.n))
        self.q = np.zeros(self.n)

    def look(self, kinematics, margins_out, A_out):
        kinematics.frame(*self.frames, *self.pose)
        kinematics.joints(self.q)
        margins_out[0] = self.pose[0][2] - 0.55 + 0.01 * np.sin(self.q[0])
        A_out[0] = -self.pose[2][2]
        A_out[0, 0] -= 0.01 * np.cos(self.q[0])


def one(constraint: str, **parameters: object) -> dict[str, Any]:
    return {"constraint": constraint, "parameters": parameters}


def wall(offset_m: float, *normal: float, **parameters: object) -> dict[str, Any]:
    given = {"frame": "ee", "normal": normal or (0.0, 0.0, 1.0), "offset_m": offset_m}
    return one("half_space", **given, **parameters)


VIABLE = one("viability", limit_rad_s=0.3, limit_rad_s2=3.0)
FLOOR = wall(0.552, eta_per_s=5.0)
GENTLE = one("joint_velocity", limit_rad_s=0.02)
CHANGES: dict[int, dict[str, Any]] = {
    50: {"constraints": {"half_space": {"parameters": {"eta_per_s": 8.0}}}, "over_s": 0.03},
    90: {"constraints": {"joint_velocity": {"parameters": {"limit_rad_s": 0.015}}}, "over_s": 0.05},
}
BALL = {"name": "ball", "shape": "sphere", "center_m": [-0.45, -0.36, 0.45], "radius_m": 0.05}
RUNS: dict[str, dict[str, Any]] = {
    "joints": {
        "constraints": [
            GENTLE,
            one("joint_position", margin_rad=0.1),
            one("joint_acceleration", limit_rad_s2=1.0),
            one("joint_torque", limit_nm=3.0),
        ],
        "noise": 1e-4,
    },
    "floor": {"constraints": [GENTLE, FLOOR], "changes": CHANGES, **ROUGH},
    "equations": {
        "constraints": [
            VIABLE, FLOOR, one("fixed_frame", frame="ee", axes=["x", "rz"]),
            one("minimum_speed", joints={"joint_1": 1.0}, speed=0.01),
            one("pfaffian", matrix=[[0.0, 0.0, 1.0, 0.0, 0.0, 0.0, -2.0]]),
        ],
        **ROUGH,
    },
    "ball": {
        "constraints": [VIABLE, one("distance", pairs=[], obstacles=[BALL], activation_m=0.2)],
        **ROUGH,
    },
    "own": {"constraints": [VIABLE, one(f"{__name__}:Above", eta_per_s=4.0)], **ROUGH},
    "stops": {"constraints": [one("joint_velocity", limit_rad_s=0.05), wall(0.557)], **ROUGH},
    "no answer": {"constraints": [VIABLE, wall(0.55), wall(-0.5, 0.0, 0.0, -1.0)], **ROUGH},
    "weak motors": {
        "constraints": [VIABLE, FLOOR], "gravity": "full", "bounds": {"torque_max": [20.0]},
        "noise": 1e-4,
    },
}  # fmt: skip
OF_MOTION = {"error", "command", "torques", "setpoint", "largest torque share", "rho"}


@cache
def made(controller: str, name: str, ticks: int = TICKS) -> Records:
    return recorded(controller, ticks, **RUNS[name])


def recorded(controller: str, ticks: int, **given: Any) -> Records:
    ranked = controller in CONTROLLERS[2:]
    order = {"order": ["hand", "posture"]} if ranked else {"weights": {"posture": 1e-3}}
    return recorded_motion(controller, "lwr", ticks, tasks=TASKS, priorities=order, **given)


def builder_of(
    controller: str, records: list[Record], parameters: dict[str, Any]
) -> AccelerationProblems:
    description = RobotDescription.from_json(records[0].payload)
    session, build = json.loads(records[1].payload), type_of(controller, parameters)
    found = build(description, parameters, session, controller)
    assert isinstance(found, AccelerationProblems)
    return found


def checked(controller: str, records: list[Record], parameters: dict[str, Any]) -> Claims:
    return check_motion(builder_of(controller, records, parameters), records)


@pytest.mark.slow
@pytest.mark.parametrize("controller", CONTROLLERS)
@pytest.mark.parametrize("name", RUNS)
def test_a_true_log_has_no_false_claim(controller, name):
    found = checked(controller, *made(controller, name))

    assert found.by_tick() == []
    assert found.counts["V"].checked > 0.8 * TICKS
    if name != "stops":
        assert found.unverifiable == 0


@pytest.mark.slow
@pytest.mark.parametrize("controller", CONTROLLERS)
@pytest.mark.parametrize("name", ["floor", "equations", "no answer", "weak motors"])
def test_a_changed_number_and_another_motion_are_found(controller, name):
    records, parameters = made(controller, name)

    assert missed_changes(builder_of(controller, records, parameters), records) == []
    weak = (controller, name) == ("ghc_torque", "weak motors")
    by = 1e-3 if weak else 1e-6  # as exactly as the wish is known
    assert missed_motions(builder_of(controller, records, parameters), records, by) == []


@pytest.mark.slow
def test_a_change_of_a_constraint_counts():
    records, parameters = made("ghc", "floor")
    unchanged = [record for record in records if record.kind != Kind.CHANGE]

    ticks = {each.tick for each in checked("ghc", unchanged, parameters).by_tick()}

    assert len(ticks) > 30
    assert min(ticks) in {50, 51}


@pytest.mark.parametrize("controller", CONTROLLERS)
def test_a_short_log_is_true_and_a_changed_one_is_not(controller):
    records, parameters = made(controller, "floor", 40)

    assert checked(controller, records, parameters).by_tick() == []
    assert missed_changes(builder_of(controller, records, parameters), records) == []


@pytest.mark.parametrize("controller", CONTROLLERS)
@pytest.mark.parametrize("wrong", ["dropped row", "other row", "wider bound"])
def test_a_wrong_limit_is_found_in_its_cycle(controller, wrong, monkeypatch):
    """Of a controller that is wrong in one cycle."""
    accelerations, bounds = HalfSpace.update_accelerations, JointVelocity.bound_accelerations

    def rows(self, motion, state, G_out, lower_out, upper_out):
        accelerations(self, motion, state, G_out, lower_out, upper_out)
        if state.tick == AT:
            upper_out += np.inf if wrong == "dropped row" else 1e-4

    def wider(self, state, lower_out, upper_out):
        bounds(self, state, lower_out, upper_out)
        if state.tick == AT:
            lower_out -= 1e-4
            upper_out += 1e-4

    if wrong == "wider bound":
        monkeypatch.setattr(JointVelocity, "bound_accelerations", wider)
    else:
        monkeypatch.setattr(HalfSpace, "update_accelerations", rows)
    found = checked(controller, *recorded(controller, 30, constraints=[GENTLE, FLOOR], noise=1e-4))

    assert {each.tick for each in found.by_tick()} == {AT}


@pytest.mark.parametrize("stops", [True, False])
def test_a_stop_that_is_left_out_is_found(stops, monkeypatch):
    """Of a controller without the row that would keep the robot from a need to stop."""
    accelerations = HalfSpace.update_accelerations

    def dropped(self, motion, state, G_out, lower_out, upper_out):
        accelerations(self, motion, state, G_out, lower_out, upper_out)
        upper_out[:] = np.inf

    monkeypatch.setattr(HalfSpace, "update_accelerations", dropped)
    if not stops:
        monkeypatch.setattr(CoordinatedStop, "is_safe", lambda *_: True)
    constraints = [one("joint_velocity", limit_rad_s=1.0), wall(0.53)]
    found = checked("ghc", *recorded("ghc", 150, constraints=constraints))

    assert ("fallback: stop" in found.counts) == stops
    assert (found.counts["stop: margin"].false > 0) == (not stops)


def test_another_stop_is_found(monkeypatch):
    accelerations = CoordinatedStop.accelerations

    def harder(self, dq, out):
        accelerations(self, dq, out)
        out *= 1.0 + 1e-6

    monkeypatch.setattr(CoordinatedStop, "accelerations", harder)
    walls = [VIABLE, wall(0.6), wall(-0.5, 0.0, 0.0, -1.0)]
    found = checked("ghc", *recorded("ghc", 40, constraints=walls, noise=1e-2))

    assert found.counts["fallback: none keeps the rows"].checked == 40
    assert len({each.tick for each in found.by_tick()}) > 20


@pytest.mark.parametrize("controller", CONTROLLERS)
def test_what_no_unknown_constraint_changes_is_verified(controller):
    records, parameters = made(controller, "floor", 40)
    unknown = {"constraint": "nowhere:Nothing"}
    given = {**parameters, "constraints": [*parameters["constraints"], unknown]}

    found = checked(controller, records, given)

    assert found.by_tick() == []
    assert found.counts["constraint nowhere:Nothing"].unverified
    assert all(found.counts[name].checked > 25 for name in OF_MOTION)
    assert not {"margin", "optimum", "rows"} & {*found.counts}
    builder = builder_of(controller, records, given)
    missed = {field for _, field, _ in missed_changes(builder, records)}
    assert missed <= {"margin", "kkt_residual", "solver_status", "extra"}


@pytest.mark.parametrize(
    ("place", "key", "value"),
    [(0, "limit_rad_s", 0.02 + 1e-8), (1, "offset_m", 0.552 - 1e-7), (1, "eta_per_s", 5.0 + 1e-6)],
)
def test_another_parameter_is_found(place, key, value):
    records, parameters = made("ghc", "floor", 40)
    entries = [dict(each) for each in parameters["constraints"]]
    entries[place]["parameters"] = {**entries[place]["parameters"], key: value}

    assert checked("ghc", records, {**parameters, "constraints": entries}).false > 5


@pytest.mark.long
@pytest.mark.parametrize("controller", CONTROLLERS)
@pytest.mark.parametrize("name", RUNS)
def test_a_long_log_has_no_false_claim(controller, name):
    records, parameters = made(controller, name, 5000)
    begin = time.process_time()

    found = checked(controller, records, parameters)

    spent = 1e3 * (time.process_time() - begin) / found.counts["V"].checked
    print(f"{controller}, {name}: {found.checked} numbers, {spent:.2f} ms per cycle")
    assert found.by_tick() == []
