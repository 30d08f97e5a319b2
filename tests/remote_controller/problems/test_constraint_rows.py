"""Rows of accelerations as the oracles state them, compared with those of the constraints."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from support.constraint_bench import AccelerationBench, hoap3, posture, small

from hoap3.protocol.robot.description import RobotDescription
from hoap3.remote_controller.constraints.barrier import Barrier
from hoap3.remote_controller.problems.acceleration_constraints import Constraints
from hoap3.remote_controller.problems.oracles.robot_oracle import Robot

STATES = 40


class Wave(Barrier):
    """A user's own, with margins that bend."""

    def prepare(self, parameters, kinematics):
        super().prepare(parameters, kinematics)
        self.name_rows(("wave", "sum"))
        self.q = np.zeros(self.n)

    def look(self, kinematics, margins_out, A_out):
        kinematics.joints(self.q)
        margins_out[:] = 2.0 + np.sin(self.q).sum(), 3.0 - self.q @ self.q / 2.0
        A_out[0], A_out[1] = -np.cos(self.q), self.q


BALL = {"shape": "sphere", "name": "ball", "center_m": [0.1, 0.05, 0.3], "radius_m": 0.05}
POLE = {
    "shape": "capsule", "name": "pole", "radius_m": 0.02,
    "ends_m": [[0.15, 0.1, 0.0], [0.15, 0.1, 0.8]],
}  # fmt: skip
BOX = {
    "shape": "box", "name": "box", "center_m": [0.2, 0.1, 0.4], "size_m": [0.1, 0.2, 0.3],
    "rpy_rad": [0.1, 0.2, 0.3],
}  # fmt: skip
NEAR = {"activation_m": 0.5, "clearance_m": 0.0}
SPREAD = {"activation_m": 0.5, "contact_m": 0.5, "spread_m": 0.05, "joints_apart": 1}
CASES: dict[str, tuple[Any, list[dict[str, Any]]]] = {
    "position": (hoap3, [{"constraint": "joint_position", "margin_rad": 0.05}]),
    "viability": (hoap3, [{"constraint": "viability", "limit_rad_s": 2.0, "limit_rad_s2": 8.0}]),
    "velocity": (hoap3, [{"constraint": "joint_velocity", "limit_rad_s": 1.0}]),
    "joints": (
        hoap3,
        [
            {"constraint": "joint_position"},
            {"constraint": "viability", "limit_rad_s": 2.0},
            {"constraint": "joint_velocity", "joints_rad_s": {"r_hip_pitch": 0.5}},
            {"constraint": "joint_torque", "limit_nm": 2.0},
            {"constraint": "joint_acceleration", "limit_rad_s2": 9.0},
        ],
    ),
    "half space": (
        small,
        [
            {"constraint": "half_space", "frame": "hand", "normal": [0, 1, 2], "offset_m": 0.45,
             "point_m": [0.1, -0.2, 0.3], "reference": "fore", "eta_per_s": 3.0}
        ],
    ),
    "lowered η": (
        small,
        [
            {"constraint": "half_space", "frame": "hand", "normal": [0, 0, 1]},
            {"constraint": "joint_acceleration", "limit_rad_s2": 2.0},
        ],
    ),
    "support": (hoap3, [{"constraint": "support_polygon", "soles": ["r_sole", "l_sole"]}]),
    "zmp": (hoap3, [{"constraint": "zmp"}, {"constraint": "friction_cone"}]),
    "frame": (hoap3, [{"constraint": "fixed_frame", "frame": "l_sole"}]),
    "axes": (
        small,
        [
            {"constraint": "fixed_frame", "frame": "hand", "reference": "fore",
             "axes": ["rz", "x"], "eta_per_s": 400.0}
        ],
    ),
    "speeds": (
        small,
        [
            {"constraint": "minimum_speed", "frame": "hand", "direction": [1, 2, 0], "speed": 0.1},
            {"constraint": "minimum_speed", "joints": {"elbow": 2.0}, "speed": 0.1},
            {"constraint": "pfaffian", "matrix": [[1.0, 2.0, 0.0]]},
        ],
    ),
    "user": (small, [{"constraint": f"{__name__}:Wave", "eta_per_s": 2.0}]),
    "ball": (small, [{"constraint": "distance", "pairs": [], "obstacles": [BALL], **NEAR}]),
    "pole": (small, [{"constraint": "distance", "pairs": [], "obstacles": [POLE], **SPREAD}]),
    "box": (small, [{"constraint": "distance", "obstacles": [BOX], **SPREAD}]),
    "links": (hoap3, [{"constraint": "distance", "activation_m": 0.1, "contact_m": 0.1}]),
}  # fmt: skip


def stated(robot: RobotDescription, *entries: dict[str, Any]) -> Constraints:
    parts = [
        {"constraint": each["constraint"],
         "parameters": {key: value for key, value in each.items() if key != "constraint"}}
        for each in entries
    ]  # fmt: skip
    found = Constraints(parts, Robot(robot), np.full(robot.n, np.inf))
    assert found.unknown == {}
    return found


@pytest.mark.parametrize("name", CASES)
def test_rows_and_bounds_are_those_of_the_controller(name):
    build, entries = CASES[name]
    robot = build()
    bench, ours = AccelerationBench(robot, *entries), stated(robot, *entries)
    stack, random, count = bench.stack, np.random.default_rng(7), 0
    np.testing.assert_array_equal(np.minimum(ours.torque_max, np.inf), stack.torque_max)
    for constraint in stack.constraints:
        constraint.reset()
    q = posture(robot, 0)
    for number in range(STATES):
        dq = random.normal(0.0, 10.0 ** random.uniform(-2.0, 0.3), robot.n) * (number > 0)
        if number % 2 == 0:
            q = posture(robot, number)
        if not len(stack.rows) and number % 2:  # near the ends of their ranges
            at = random.random(robot.n) < 0.5
            inside = 0.05 + 10.0 ** random.uniform(-5.0, -2.0, robot.n)
            q = np.where(at, robot.lower + inside, robot.upper - inside)
        bench.at(q, dq)
        if number == 0:
            ours.begin({"q": q, "dq": dq, "tick": bench.state.tick})
        ours.follow({"q": q, "dq": dq, "tick": bench.state.tick})
        ours._robot.place(q)
        ours._robot.move(dq)

        rows = [each.acceleration_rows(dq) for each in ours.known]
        lower, upper = ours.narrow(q, dq, *np.full((2, robot.n), [[-np.inf], [np.inf]]))

        np.testing.assert_allclose(lower, stack.lower, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(upper, stack.upper, rtol=1e-9, atol=1e-9)
        taken = 0
        for constraint, each, own in zip(stack.constraints, ours.known, rows, strict=True):
            near = 1e-13 * each.amplifies
            np.testing.assert_allclose(each.margin, constraint.margin(), rtol=1e-12, atol=near)
            part = slice(taken, taken + constraint.rows)
            taken += constraint.rows
            G, sides = stack.rows[part], (stack.rows_lower[part], stack.rows_upper[part])
            used = (sides[0] > -np.inf) | (sides[1] < np.inf)
            count += compare(own, G[used], *(side[used] for side in sides))
    assert count > STATES // 2 or not len(stack.rows)


def compare(own, G, lower, upper) -> int:
    """Each row of the controller is stated, and each that is stated is one of its rows."""
    if own is None:
        assert not len(G)
        return 0
    on = (own.lower > -np.inf) | (own.upper < np.inf)
    wanted = ~own.optional & on
    covered = np.zeros(len(own.a), bool)
    for row, least, most in zip(G, lower, upper, strict=True):
        off = np.abs(own.A - row).max(1) - own.A_error
        sides = np.maximum(apart(own.lower, least), apart(own.upper, most)) - own.error
        matches = (off <= 0.0) & (sides <= 0.0) & on
        assert matches.any(), (off.min(), sides[off <= 0.0], row, most)
        covered |= matches
    assert covered[wanted].all()
    return len(G)


def apart(sides, side):
    with np.errstate(invalid="ignore"):
        return np.where(sides == side, 0.0, np.abs(sides - side))
