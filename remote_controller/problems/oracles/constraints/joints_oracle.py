"""Constraints of single joints: they are bounds, and need no rows."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from hoap3.remote_controller.constraints import limit_reference
from hoap3.remote_controller.problems.oracles.constraints.base_oracle import (
    Bounds,
    Constraint,
    States,
)
from hoap3.remote_controller.problems.oracles.constraints.cycles_oracle import Cycles
from hoap3.remote_controller.problems.oracles.parameters import UnverifiableError

Array = NDArray[np.float64]
SOURCES = ("reference", "measured")


class JointVelocity(Constraint):
    """|u_i| ≤ ω_i."""

    limits_speed: ClassVar[bool] = True

    defaults: ClassVar[Mapping[str, Any]] = {"limit_rad_s": None, "joints_rad_s": None}

    def bound(self, states: States, cycles: Cycles, bounds: Bounds) -> None:
        """Narrow to ±ω."""
        super().bound(states, cycles, bounds)
        own = self.settings["joints_rad_s"]
        most = _least(self, self.description.velocity, self.settings["limit_rad_s"], own)
        shape = bounds.lower.shape
        bounds.narrow(np.broadcast_to(-most, shape), np.broadcast_to(most, shape))


class JointPosition(Constraint):
    """−η(q − q_min) ≤ u ≤ η(q_max − q), (25)."""

    defaults: ClassVar[Mapping[str, Any]] = {
        "eta_per_s": 10.0,
        "margin_rad": 0.0,
        "return_speed_rad_s": 0.1,
        "joints": None,
        "positions_from": SOURCES,
    }

    def bound(self, states: States, cycles: Cycles, bounds: Bounds) -> None:
        """Narrow to what (25) leaves; the margin is that of the joint nearest to an end."""
        q, given = self.positions(states), self.settings
        names = self.description.joint_names if given["joints"] is None else given["joints"]
        least, most = _usable(self, given["margin_rad"], names)
        eta, back = given["eta_per_s"], given["return_speed_rad_s"]
        bounds.narrow(*limit_reference.range_bounds(q, least, most, eta, back))
        self.margins = np.minimum(q - least, most - q).min(1)


class JointAcceleration(Constraint):
    """|u − u_before| ≤ A·T."""

    defaults: ClassVar[Mapping[str, Any]] = {"limit_rad_s2": None, "joints_rad_s2": None}

    def bound(self, states: States, cycles: Cycles, bounds: Bounds) -> None:
        """Narrow to what is near the last velocity of the reference."""
        super().bound(states, cycles, bounds)
        robot, given = self.description, self.settings
        own = given["joints_rad_s2"]
        A = _least(self, robot.setpoint_acceleration_max, given["limit_rad_s2"], own)
        before = reference_velocity(states, cycles, robot.period_s)
        bounds.narrow(before - A * robot.period_s, before + A * robot.period_s)


class Viability(Constraint):
    """A joint that can always stop before the end of its range, in steps of A·T."""

    defaults: ClassVar[Mapping[str, Any]] = {
        "limit_rad_s": None,
        "limit_rad_s2": None,
        "margin_rad": 0.0,
        "horizon_periods": 2.0,
    }

    def bound(self, states: States, cycles: Cycles, bounds: Bounds) -> None:
        """Narrow to the velocities from which braking ends inside the range."""
        robot, given, q = self.description, self.settings, states["reference"]
        least, most = _usable(self, given["margin_rad"], robot.joint_names)
        speed = np.minimum(robot.velocity, _number(given["limit_rad_s"]))
        brake = np.minimum(robot.brake_acceleration, robot.setpoint_acceleration_max)
        A, T = np.minimum(brake, _number(given["limit_rad_s2"])), robot.period_s
        v = reference_velocity(states, cycles, T)
        lower, upper = np.clip(v - A * T, -speed, speed), np.clip(v + A * T, -speed, speed)
        up, down = _stopping_speed(most - q, A, T), -_stopping_speed(q - least, A, T)
        upper = np.where(upper > 0.0, np.minimum(upper, up), upper)
        lower = np.where(lower < 0.0, np.maximum(lower, down), lower)
        one = np.where(v > 0.0, upper, lower)  # too fast to stop in time: brakes as it can
        late = lower > upper
        bounds.narrow(np.where(late, one, lower), np.where(late, one, upper))
        self.margins = np.minimum(q - least, most - q).min(1)


def reference_velocity(states: States, cycles: Cycles, period_s: float) -> Array:
    """How the applied reference moved before each cycle, (N, n); at the first one it is dq."""
    reference, known = states["reference"], np.nan_to_num(states["dq"], posinf=0.0, neginf=0.0)
    v = known.astype(float)
    passed = np.diff(cycles.periods)
    follows = ~cycles.fresh[1:] & (passed > 0)
    moved = np.diff(reference, axis=0)[follows] / (passed[follows, None] * period_s)
    v[1:][follows] = moved
    for again in np.flatnonzero(~cycles.fresh[1:] & (passed == 0)) + 1:
        v[again] = v[again - 1]
    return np.asarray(v)


def _stopping_speed(room: Array, A: Array, T: float) -> Array:
    """The largest speed from which a joint stops within its room, which may be infinite."""
    endless = np.isinf(room)
    return np.where(endless, np.inf, stopping_speed(np.where(endless, 0.0, room), A, T))


def _least(constraint: Constraint, robot: Array, common: object, own: object) -> Array:
    """The least of the robot's limits and those of the settings, (n,)."""
    wanted = np.full(constraint.description.n, _number(common))
    if own is not None and not isinstance(own, Mapping):
        raise UnverifiableError(f"limits of single joints are {own!r:.40}")
    for name, limit in (own or {}).items():
        wanted[constraint.joints([name])] = _number(limit)
    return np.asarray(np.minimum(wanted, robot))


def _usable(constraint: Constraint, margin: float, names: object) -> tuple[Array, Array]:
    """Ends of the usable ranges of named joints, less a margin; ∓inf of others."""
    robot, kept = constraint.description, constraint.joints(names)
    least, most = np.full(robot.n, -np.inf), np.full(robot.n, np.inf)
    least[kept], most[kept] = robot.lower[kept] + margin, robot.upper[kept] - margin
    return least, most


def _number(given: object) -> float:
    if given is None:
        return np.inf
    if not isinstance(given, int | float) or isinstance(given, bool):
        raise UnverifiableError(f"a limit is {given!r:.40}")
    return float(given)


def stopping_speed(room: Array, A: Array, T: float) -> Array:
    """The w that comes to rest within D, T(w + (w − AT) + …) = D, in the fewest steps."""
    D = np.maximum(room, 0.0)
    steps = np.maximum(1.0, np.ceil((np.sqrt(1.0 + 8.0 * D / (A * T * T)) - 1.0) / 2.0))
    return np.where(D > 0.0, (D / T + 0.5 * A * T * steps * (steps - 1.0)) / steps, 0.0)
