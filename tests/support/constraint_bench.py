"""Robots, states and small solvers for tests of constraints."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import daqp
import numpy as np
from scipy.spatial.transform import Rotation

from hoap3.protocol.messages import FloatArray, State
from hoap3.protocol.robot.description import RobotDescription, Sole
from hoap3.remote_controller.constraints.acceleration_stack import AccelerationStack
from hoap3.remote_controller.constraints.frames.fixed_frame import AXES
from hoap3.remote_controller.constraints.registry import (
    ConstraintSettings,
    build,
    build_accelerations,
)
from hoap3.remote_controller.constraints.stack import ConstraintStack
from hoap3.remote_controller.model.kinematics import Kinematics
from hoap3.robot_emulator.robots import load
from support.small_arm import URDF, arm

PERIOD = 1e-3
ROUNDING = 1e-6  # of what a solver leaves of a row [rad/s, rad/s² or m/s, m/s²]


def _with_shapes() -> str:
    """The small arm's URDF with a capsule around the fore arm and a box around the hand."""
    place = '<collision><origin xyz="0 0 0.1"/><geometry>{}</geometry></collision></link>'
    shapes = {
        "base": '<box size="0.3 0.2 0.1"/>',
        "fore": '<cylinder radius="0.03" length="0.2"/>',
        "hand": '<box size="0.04 0.05 0.15"/>',
    }
    text = URDF
    for link, shape in shapes.items():
        start = text.index(f'<link name="{link}">')
        end = text.index("</link>", start)
        text = text[:end] + place.format(shape) + text[end + len("</link>") :]
    return text


@cache
def small() -> RobotDescription:
    """Three joints on a sole of 0.6 m by 0.4 m."""
    outline = ((0.3, 0.2), (-0.3, 0.2), (-0.3, -0.2), (0.3, -0.2))
    return arm(urdf=_with_shapes(), soles=(Sole(frame="base", polygon=outline),))


@cache
def hoap3() -> RobotDescription:
    return load("hoap3")


ROBOTS = {"hoap3": hoap3, "small": small}


def entry(given: dict[str, Any]) -> ConstraintSettings:
    """A config's entry from its constraint, its name, and its settings beside them."""
    rest = {key: value for key, value in given.items() if key not in {"constraint", "name"}}
    return ConstraintSettings(
        constraint=given["constraint"], name=given.get("name"), parameters=rest
    )


class Bench:
    """Constraints of a robot, moved by Euler steps."""

    def __init__(self, robot: RobotDescription, *entries: dict[str, Any]) -> None:
        self.robot, self.kinematics = robot, Kinematics(robot)
        self.stack: ConstraintStack = build(
            [entry(each) for each in entries], robot, self.kinematics, PERIOD
        )
        self.state = State(robot.n, 0)
        self.at(robot.initial_position)

    @property
    def only(self):
        return self.stack.constraints[0]

    def at(self, q: FloatArray, tick: int | None = None) -> Bench:
        """Put the robot at q, one tick later."""
        self.state.tick = self.state.tick + 1 if tick is None else tick
        self.state.q[:] = self.state.reference[:] = q
        self.kinematics.update(self.state.reference)
        self.stack.update(self.kinematics, self.state)
        return self

    def margins(self, q: FloatArray) -> FloatArray:
        return self.at(q).only.margins.copy()

    def nearest(self, wanted: FloatArray) -> FloatArray:
        """The u nearest to a wanted one that every row and bound allows."""
        stack, n = self.stack, self.robot.n
        matrix = np.ascontiguousarray(np.vstack((stack.A, stack.C)))
        upper = np.concatenate((stack.upper, stack.b, stack.c))
        lower = np.concatenate((stack.lower, np.full(len(stack.b), -np.inf), stack.c))
        sense = np.array([0] * (n + len(stack.b)) + [5] * len(stack.c), np.int32)
        u, _, flag, _ = daqp.solve(
            np.eye(n), -wanted, matrix, np.minimum(upper, 1e30), np.maximum(lower, -1e30), sense
        )
        assert flag > 0, flag
        return np.array(u)

    def walk(self, wanted: FloatArray, steps: int, noise: float = 0.0) -> float:
        """Follow a wanted u, with noise, for some steps; returns the smallest margin on the way."""
        rng = np.random.default_rng(steps)
        least = self.stack.margin()
        for _ in range(steps):
            self.at(
                self.state.reference
                + PERIOD * self.nearest(wanted + noise * rng.normal(size=len(wanted)))
            )
            least = min(least, self.stack.margin())
        return least


class AccelerationBench:
    """Constraints of a robot, moved by accelerations that are held for a period."""

    def __init__(self, robot: RobotDescription, *entries: dict[str, Any]) -> None:
        self.robot, self.kinematics = robot, Kinematics(robot)
        self.stack: AccelerationStack = build_accelerations(
            [entry(each) for each in entries], robot, self.kinematics, PERIOD
        )
        self.state = State(robot.n, 0)
        self.at(robot.initial_position, np.zeros(robot.n))

    @property
    def only(self):
        return self.stack.constraints[0]

    def at(self, q: FloatArray, dq: FloatArray) -> AccelerationBench:
        """Put the robot at q, with dq, one tick later."""
        self.state.tick += 1
        self.state.q[:] = self.state.reference[:] = q
        self.state.dq[:] = dq
        self.stack.update(self.state.q, self.state.dq, self.state)
        return self

    def nearest(self, wanted: FloatArray, most: float = 1e3) -> FloatArray | None:
        """The q̈ nearest to a wanted one, none above `most`, that is allowed; None: none is."""
        stack, n = self.stack, self.robot.n
        rows = np.vstack((np.eye(n), stack.rows))
        lower = np.concatenate((np.maximum(stack.lower, -most), stack.rows_lower))
        upper = np.concatenate((np.minimum(stack.upper, most), stack.rows_upper))
        sense = np.where(lower == upper, 5, 0).astype(np.int32)
        ends = np.clip(upper, -1e30, 1e30), np.clip(lower, -1e30, 1e30)
        ddq, _, flag, _ = daqp.solve(np.eye(n), -wanted, np.ascontiguousarray(rows), *ends, sense)
        return np.array(ddq) if flag > 0 else None

    def hold(self, ddq: FloatArray, periods: float = 1.0) -> AccelerationBench:
        """Move the robot by accelerations for one period, or a part or several of one."""
        q, dq, t = self.state.q.copy(), self.state.dq.copy(), periods * PERIOD
        return self.at(q + t * dq + 0.5 * t * t * ddq, dq + t * ddq)


class StatedDrift:
    """Follows a frame by its poses alone, in periods; e is found by a rotation vector.

    c is the largest difference of e over parts of a period, of order 2 for velocities and 3 for
    accelerations, divided by the parts' lengths.

    Args:
        robot: that has the frame.
        frame, reference, axes: as of `fixed_frame`.
        eta: η [1/s].
        order: 2 or 3.
        q: (n,) where the frame's pose is kept.
    """

    def __init__(
        self,
        robot: RobotDescription,
        frame: str,
        reference: str,
        axes: tuple[str, ...],
        eta: float,
        order: int,
        q: FloatArray,
    ) -> None:
        self._kinematics = Kinematics(robot)
        self._ids = [self._kinematics.frame_id(name) for name in (frame, reference)]
        self._axes = [AXES.index(axis) for axis in axes]
        self._eta, self._order, self._kept = eta, order, self._pose(q)
        self.c = 0.0

    def drift(self, q: FloatArray) -> float:
        """Largest |e| of a posture."""
        return float(np.abs(self._error(q)).max())

    def move(self, q: FloatArray, dq: FloatArray, ddq: FloatArray | float = 0.0) -> None:
        """Know of a period that begins so, with ddq held; without it dq is."""
        times = np.linspace(0.0, PERIOD, self._order + 1)
        errors = [self._error(q + t * dq + 0.5 * t * t * ddq) for t in times]
        found = np.diff(errors, self._order, axis=0) / times[1] ** self._order
        self.c = max(self.c, float(np.abs(found).max()))

    @property
    def most(self) -> float:
        """That |e| ≤ c·T/(2η), or c·T/(2η²); a row that is ε off adds ε/η, or ε/η²."""
        return (0.5 * self.c * PERIOD + ROUNDING) / self._eta ** (self._order - 1)

    def _pose(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        position, rotation = np.zeros(3), np.zeros((3, 3))
        self._kinematics.update(q)
        self._kinematics.frame(*self._ids, position, rotation, np.zeros((6, len(q))))
        return position, rotation

    def _error(self, q: FloatArray) -> FloatArray:
        (position, rotation), (kept, turned) = self._pose(q), self._kept
        vector = Rotation.from_matrix(rotation @ turned.T).as_rotvec()
        angle = float(np.linalg.norm(vector))
        sine = math.sin(angle) / angle if angle > 0.0 else 1.0
        return np.concatenate((position - kept, sine * vector))[self._axes]


def differences(bench: Bench, q: FloatArray, step: float = 1e-6) -> FloatArray:
    """dm/dq of every margin by central differences, (margins, n)."""
    columns = []
    for joint in range(len(q)):
        ahead, behind = q.copy(), q.copy()
        ahead[joint] += step
        behind[joint] -= step
        columns.append((bench.margins(ahead) - bench.margins(behind)) / (2 * step))
    return np.array(columns).T


def posture(robot: RobotDescription, seed: int) -> FloatArray:
    return np.random.default_rng(seed).uniform(*robot.sampling_range)
