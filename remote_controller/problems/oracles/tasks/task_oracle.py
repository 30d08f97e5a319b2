"""Errors that tasks bring to 0, their Jacobians, and how their targets move them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.robot.description import COM
from hoap3.remote_controller.problems.oracles.robot_oracle import Robot
from hoap3.remote_controller.problems.oracles.tasks.logarithm_oracle import (
    angular_velocity,
    inverse_left,
    nearer,
    pose_logarithm,
    rotation_of,
    rotation_vector,
    skew,
)
from hoap3.remote_controller.problems.oracles.tasks.target_oracle import Target
from hoap3.remote_controller.problems.oracles.tasks.tolerances_oracle import Tolerances
from hoap3.remote_controller.problems.statement import Claim

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

AXES = "xyz"
STEP_S = 1e-5  # along the motion: what a difference quotient rounds and bends is below 1e-10 then


class Rows(NamedTuple):
    """A task at one joint position and time; its weights are in all of it.

    Attributes:
        error: e, (m,); V = ½|e|².
        jacobian: ∂e/∂q, (m, n), in wire order.
        rate: ∂e/∂t, (m,), what the target's motion makes of e.
    """

    error: Array
    jacobian: Array
    rate: Array

    @property
    def value(self) -> float:
        """V = ½|e|²."""
        return 0.5 * float(self.error @ self.error)

    @property
    def gradient(self) -> Array:
        """∇V, (n,)."""
        return self.error @ self.jacobian

    @property
    def value_rate(self) -> float:
        """∂V/∂t."""
        return float(self.error @ self.rate)


class ErrorTask(ABC):
    """An error e(q, t). `robot` is at the joint positions in question in every call.

    Attributes:
        roots: √W of V = ½eᵀWe, (m,); they are in e and all that follows from it.
    """

    roots: Array

    @property
    def size(self) -> int:
        """How many components e has."""
        return len(self.roots)

    @property
    def watched(self) -> bool:
        """Whether it has tolerances."""
        return False

    def watch(self, robot: Robot, time_s: float) -> None:  # noqa: B027 - most have no tolerances
        """Compare with tolerances, once for each State, at the measured joint positions."""

    @property
    @abstractmethod
    def rounding(self) -> float:
        """How much rounding of joint positions changes the error."""

    @abstractmethod
    def begin(self, robot: Robot, time_s: float) -> None:
        """Start from where the robot is, at a time [s]."""

    @abstractmethod
    def take_over(self, other: object) -> None:
        """Continue with the memory of a task with other parameters."""

    @abstractmethod
    def at(self, robot: Robot, time_s: float) -> Rows:
        """e, J and ∂e/∂t at a time [s]."""

    @abstractmethod
    def error_at(self, robot: Robot, time_s: float) -> Array:
        """E alone, (m,); `robot` may be placed without Jacobians."""

    @abstractmethod
    def moved(self, robot: Robot) -> Flags:
        """Joints, (n,), whose column of J need not be 0 to the bit."""

    def motion(
        self, robot: Robot, q: Array, dq: Array, time_s: float, period_s: float
    ) -> tuple[Array, Array]:
        """ė, and ë where q̈ = 0, both (m,): ë = J·q̈ + it.

        The target's part is the change of ∂e/∂t within the coming period, over that period; the
        joints' is a central difference along dq. `robot` is left at q.

        Args:
            robot: at any joint positions.
            q, dq: (n,).
            time_s, period_s: [s].
        """

        def rate(place: Array, at_s: float) -> Array:
            robot.place(place)
            rows = self.at(robot, at_s)
            return np.asarray(rows.jacobian @ dq + rows.rate, float)

        ahead = rate(q + STEP_S * dq, time_s) - rate(q - STEP_S * dq, time_s)
        later, now = rate(q, time_s + period_s), rate(q, time_s)
        return now, ahead / (2.0 * STEP_S) + (later - now) / period_s

    def derivative_claims(self, robot: Robot) -> list[Claim]:
        """Claims that the derivatives are those of e, where `at` was called last.

        Ours are recomputed apart from the controller's, so there is nothing to claim of them.
        """
        del robot
        return []


class Task(ErrorTask):
    """An error with a target.

    Args:
        target: what is aimed at.
        weights: W of V = ½eᵀWe, (m,): e and all that follows from it is multiplied by √W.
    """

    def __init__(self, target: Target, weights: Array) -> None:
        self.target = target
        self.roots: Array = np.sqrt(weights)
        self.tolerances: Tolerances | None = None

    def begin(self, robot: Robot, time_s: float) -> None:
        """Have the target set out from where the robot is, at a time [s]."""
        self.target.start(None, time_s)  # of two ways to say an orientation, the one nearer to it
        aim, _ = self.target.at(time_s)
        self.target.start(self.present(robot, aim), time_s)
        if self.tolerances is not None:
            self.tolerances.open = True

    def take_over(self, other: object) -> None:
        """Go on with the target and the tolerances of a task of which only weights differ."""
        if isinstance(other, Task):
            self.target, self.tolerances = other.target, other.tolerances

    @property
    def watched(self) -> bool:
        """Whether it has tolerances."""
        return self.tolerances is not None

    def watch(self, robot: Robot, time_s: float) -> None:
        """Once for each State, at the joint positions that were measured: does it give up here?"""
        tolerances = self.tolerances
        if tolerances is None or not tolerances.open:
            return
        aim, _ = self.target.at(time_s)
        error = self.error(robot, aim)
        if tolerances.broken(error, self.target.elapsed(time_s)) and tolerances.holds:
            self.target.stay(self.present(robot, aim))

    def at(self, robot: Robot, time_s: float) -> Rows:
        """e, J and ∂e/∂t at a time [s]."""
        error, jacobian, rate = self.plain(robot, *self.target.at(time_s))
        return Rows(self.roots * error, self.roots[:, None] * jacobian, self.roots * rate)

    def error_at(self, robot: Robot, time_s: float) -> Array:
        """E alone, (m,); `robot` may be placed without Jacobians."""
        return self.roots * self.error(robot, self.target.at(time_s)[0])

    @property
    def rounding(self) -> float:
        """As of its target."""
        return self.target.rounding

    @abstractmethod
    def present(self, robot: Robot, aim: Array) -> Array:
        """Where the robot is, as the target counts; `aim` is where that is at the start."""

    @abstractmethod
    def error(self, robot: Robot, aim: Array) -> Array:
        """E without weights, for a target."""

    @abstractmethod
    def plain(self, robot: Robot, aim: Array, rate: Array) -> tuple[Array, Array, Array]:
        """e, ∂e/∂q and ∂e/∂t without weights, for a target and its velocity."""


class PlaceTask(Task):
    """e = p − p_d of the centre of mass or a frame's origin, of some axes of the reference [m]."""

    def __init__(
        self, target: Target, weights: Array, point: str, reference: str, axes: Sequence[str]
    ) -> None:
        super().__init__(target, weights)
        self._point, self._reference = point, reference
        self._axes = [AXES.index(axis) for axis in axes]

    def moved(self, robot: Robot) -> Flags:
        """All for the centre of mass, else those between both frames."""
        if self._point == COM:
            return np.ones(robot.description.n, bool)
        return robot.moves(self._point, self._reference)

    def present(self, robot: Robot, aim: Array) -> Array:
        """p, (3,) [m]."""
        del aim
        return self._point_of(robot)

    def error(self, robot: Robot, aim: Array) -> Array:
        """The components of p − p_d."""
        return (self._point_of(robot) - aim)[self._axes]

    def plain(self, robot: Robot, aim: Array, rate: Array) -> tuple[Array, Array, Array]:
        """The components of p − p_d."""
        p, J = self._see(robot)
        return (p - aim)[self._axes], J[self._axes], -rate[self._axes]

    def motion(
        self, robot: Robot, q: Array, dq: Array, time_s: float, period_s: float
    ) -> tuple[Array, Array]:
        """As of any task, but with Pinocchio's own J̇·dq."""
        robot.place(q)
        robot.move(dq)
        _, velocity, acceleration = self.target.over(time_s, period_s)
        drift = (
            robot.com_drift(self._reference)
            if self._point == COM
            else robot.frame_drift(self._point, self._reference)[:3]
        )
        _, J = self._see(robot)
        now, rate = J @ dq - velocity, drift - acceleration
        return self.roots * now[self._axes], self.roots * rate[self._axes]

    def _point_of(self, robot: Robot) -> Array:
        if self._point == COM:
            return robot.com_point(self._reference)
        return robot.pose(self._point, self._reference)[0]

    def _see(self, robot: Robot) -> tuple[Array, Array]:
        if self._point == COM:
            return robot.com(self._reference)
        p, _, J = robot.frame(self._point, self._reference)
        return p, J[:3]


class PoseTask(Task):
    """e = log(M_d⁻¹M) in SE(3) of a frame, or only its rotation vector; of 6 or 3 components."""

    def __init__(self, target: Target, weights: Array, frame: str, reference: str) -> None:
        super().__init__(target, weights)
        self._frame, self._reference = frame, reference
        self._rows = slice(6 - target.dimension, 6)  # of an orientation the lower half

    def moved(self, robot: Robot) -> Flags:
        """Those between both frames."""
        return robot.moves(self._frame, self._reference)

    def present(self, robot: Robot, aim: Array) -> Array:
        """Give p and a rotation vector, or the latter alone."""
        p, R = robot.pose(self._frame, self._reference)
        return np.concatenate([p, nearer(rotation_vector(R), aim[-3:])])[self._rows]

    def error(self, robot: Robot, aim: Array) -> Array:
        """The logarithm, in the target's axes."""
        p, R = robot.pose(self._frame, self._reference)
        axes = rotation_of(aim[-3:]).T
        phi = rotation_vector(axes @ R)
        if len(aim) == 3:
            return phi
        return np.concatenate([inverse_left(phi)[0] @ axes @ (p - aim[:3]), phi])

    def plain(self, robot: Robot, aim: Array, rate: Array) -> tuple[Array, Array, Array]:
        """The logarithm, in the target's axes, and its derivatives."""
        p, R, J = robot.frame(self._frame, self._reference)
        wanted, wanted_rate = np.zeros(6), np.zeros(6)
        wanted[self._rows], wanted_rate[self._rows] = aim, rate
        if len(aim) == 3:
            wanted[:3] = p
        axes = rotation_of(wanted[3:]).T
        t, turning = axes @ (p - wanted[:3]), angular_velocity(wanted[3:], wanted_rate[3:])
        e, rates = pose_logarithm(t, axes @ R)
        twist = np.vstack([axes @ J[:3], axes @ J[3:]])
        away = np.concatenate([axes @ wanted_rate[:3] + skew(turning) @ t, turning])
        rows = self._rows
        return e[rows], (rates @ twist)[rows], (-rates @ away)[rows]


class PostureTask(Task):
    """e = q − q_d of some joints [rad or m]."""

    def __init__(self, target: Target, weights: Array, joints: Sequence[int]) -> None:
        super().__init__(target, weights)
        self._joints = list(joints)

    def moved(self, robot: Robot) -> Flags:
        """Those of the posture."""
        return np.isin(np.arange(robot.description.n), self._joints)

    def present(self, robot: Robot, aim: Array) -> Array:
        """Joint positions q of these joints."""
        del aim
        return robot.positions[self._joints]

    def error(self, robot: Robot, aim: Array) -> Array:
        """Q − q_d."""
        return robot.positions[self._joints] - aim

    def plain(self, robot: Robot, aim: Array, rate: Array) -> tuple[Array, Array, Array]:
        """Their errors; J has a 1 in each row."""
        q = robot.positions
        return q[self._joints] - aim, np.eye(len(q))[self._joints], -rate


class SumTask:
    """V = Σ w V_i of other tasks: their rows below each other, times √w."""

    def __init__(self, terms: Sequence[AnyTask], weights: Sequence[float]) -> None:
        self._terms, self._roots = terms, np.sqrt(weights)
        self.roots: Array = self._joined([term.roots for term in terms])

    @property
    def size(self) -> int:
        """How many components e has."""
        return len(self.roots)

    @property
    def rounding(self) -> float:
        """As of the targets of its terms."""
        return max(term.rounding for term in self._terms)

    def moved(self, robot: Robot) -> Flags:
        """Those of any term."""
        found = [term.moved(robot) for term in self._terms]
        return np.asarray(np.logical_or.reduce(found))

    @property
    def watched(self) -> bool:
        """Whether a term has tolerances."""
        return any(term.watched for term in self._terms)

    def watch(self, robot: Robot, time_s: float) -> None:
        """Watch all terms."""
        for term in self._terms:
            term.watch(robot, time_s)

    def take_over(self, other: object) -> None:
        """The same for all terms."""
        if isinstance(other, SumTask):
            for term, old in zip(self._terms, other._terms, strict=True):
                term.take_over(old)

    def begin(self, robot: Robot, time_s: float) -> None:
        """All targets set out."""
        for term in self._terms:
            term.begin(robot, time_s)

    def at(self, robot: Robot, time_s: float) -> Rows:
        """e, J and ∂e/∂t of all."""
        found = [term.at(robot, time_s) for term in self._terms]
        return Rows(*(self._joined([rows[part] for rows in found]) for part in range(3)))

    def error_at(self, robot: Robot, time_s: float) -> Array:
        """E alone, (m,)."""
        return self._joined([term.error_at(robot, time_s) for term in self._terms])

    def motion(
        self, robot: Robot, q: Array, dq: Array, time_s: float, period_s: float
    ) -> tuple[Array, Array]:
        """As of a single task."""
        found = [term.motion(robot, q, dq, time_s, period_s) for term in self._terms]
        return self._joined([each[0] for each in found]), self._joined([each[1] for each in found])

    def derivative_claims(self, robot: Robot) -> list[Claim]:
        """Those of all terms."""
        return [claim for term in self._terms for claim in term.derivative_claims(robot)]

    def _joined(self, parts: Sequence[Array]) -> Array:
        return np.concatenate([w * part for w, part in zip(self._roots, parts, strict=True)])


AnyTask = ErrorTask | SumTask
