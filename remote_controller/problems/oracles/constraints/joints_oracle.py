"""Constraints of single joints: they are bounds, and need no rows."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from hoap3.remote_controller.constraints import limit_reference
from hoap3.remote_controller.problems.oracles import acceleration_bounds_oracle
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
    """|u_i| ≤ ω_i; |q̇ + T·q̈| ≤ ω."""

    limits_speed: ClassVar[bool] = True

    defaults: ClassVar[Mapping[str, Any]] = {"limit_rad_s": None, "joints_rad_s": None}

    def prepare(self) -> None:
        """Read ω."""
        own = self.settings["joints_rad_s"]
        robot = self.description.velocity
        self.speed_max = _least(self, robot, self.settings["limit_rad_s"], own)

    def bound(self, states: States, cycles: Cycles, bounds: Bounds) -> None:
        """Narrow to ±ω."""
        super().bound(states, cycles, bounds)
        most, shape = self.speed_max, bounds.lower.shape
        bounds.narrow(np.broadcast_to(-most, shape), np.broadcast_to(most, shape))

    def fit(self, speed: Array, brake: Array) -> None:
        """Keep what a joint that is faster brakes with."""
        self._brake = brake

    def interval(self, q: Array, dq: Array) -> limit_reference.Interval:
        """(±ω − q̇)/T."""
        T = self.description.period_s
        return limit_reference.speed_changes(dq, np.asarray(self.speed_max), self._brake, T)


class Ranged(Constraint):
    """A joint that is able to stop within a range, for accelerations."""

    horizon: float
    """Periods that an acceleration may be held."""
    speed_max: Array | float

    def prepare(self) -> None:
        """Find the range."""
        given = self.settings
        named = given.get("joints")
        names = self.description.joint_names if named is None else named
        self.least, self.most = _usable(self, given["margin_rad"], names)

    def fit(self, speed: Array, brake: Array) -> None:
        """Lay out the bounds, for what joints brake with."""
        fastest = np.broadcast_to(self.speed_max, brake.shape)
        held = self.horizon * self.description.period_s
        given = self.least, self.most, fastest, brake, brake, brake, held
        self._bounds = acceleration_bounds_oracle.Bounds("viability", *given, 1.0, 0.0)

    def interval(self, q: Array, dq: Array) -> limit_reference.Interval:
        """Those of Del Prete (2018)."""
        self.margins = np.minimum(q - self.least, self.most - q)
        return self._bounds.at(q, dq)


class JointPosition(Ranged):
    """−η(q − q_min) ≤ u ≤ η(q_max − q), (25)."""

    defaults: ClassVar[Mapping[str, Any]] = {
        "eta_per_s": 10.0,
        "margin_rad": 0.0,
        "return_speed_rad_s": 0.1,
        "joints": None,
        "positions_from": SOURCES,
    }
    horizon = 2.0

    def bound(self, states: States, cycles: Cycles, bounds: Bounds) -> None:
        """Narrow to what (25) leaves; the margin is that of the joint nearest to an end."""
        q, given, least, most = self.positions(states), self.settings, self.least, self.most
        eta, back = given["eta_per_s"], given["return_speed_rad_s"]
        bounds.narrow(*limit_reference.range_bounds(q, least, most, eta, back))
        self.margins = np.minimum(q - least, most - q).min(1)


class JointAcceleration(Constraint):
    """|u − u_before| ≤ A·T; |q̈| ≤ A."""

    defaults: ClassVar[Mapping[str, Any]] = {"limit_rad_s2": None, "joints_rad_s2": None}
    limits_accelerations: ClassVar[bool] = True

    def prepare(self) -> None:
        """Read A."""
        most, given = self.description.setpoint_acceleration_max, self.settings
        self.acceleration_max = _least(self, most, given["limit_rad_s2"], given["joints_rad_s2"])

    def bound(self, states: States, cycles: Cycles, bounds: Bounds) -> None:
        """Narrow to what is near the last velocity of the reference."""
        super().bound(states, cycles, bounds)
        T = self.description.period_s
        before, change = reference_velocity(states, cycles, T), self.acceleration_max * T
        bounds.narrow(before - change, before + change)

    def interval(self, q: Array, dq: Array) -> limit_reference.Interval:
        """±A."""
        most = np.asarray(self.acceleration_max)
        return -most, most


class JointTorque(Constraint):
    """|τ_i| ≤ τ_max,i, for accelerations alone."""

    defaults: ClassVar[Mapping[str, Any]] = {"limit_nm": None, "joints_nm": None}

    def prepare(self) -> None:
        """Read the limits."""
        own = self.settings["joints_nm"]
        self.torque_max = _least(self, self.description.effort, self.settings["limit_nm"], own)


class Viability(Ranged):
    """A joint that can always stop before the end of its range, in steps of A·T."""

    defaults: ClassVar[Mapping[str, Any]] = {
        "limit_rad_s": None,
        "limit_rad_s2": None,
        "margin_rad": 0.0,
        "horizon_periods": 2.0,
    }

    def prepare(self) -> None:
        """Read the limits."""
        super().prepare()
        robot, given = self.description, self.settings
        self.horizon = given["horizon_periods"]
        self.speed_max = np.minimum(robot.velocity, _number(given["limit_rad_s"]))
        brake = np.minimum(robot.brake_acceleration, robot.setpoint_acceleration_max)
        self.acceleration_max = np.minimum(brake, _number(given["limit_rad_s2"]))

    def bound(self, states: States, cycles: Cycles, bounds: Bounds) -> None:
        """Narrow to the velocities from which braking ends inside the range."""
        q, least, most, speed = states["reference"], self.least, self.most, self.speed_max
        A, T = np.asarray(self.acceleration_max), self.description.period_s
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
