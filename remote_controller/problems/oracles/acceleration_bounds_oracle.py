"""Bounds of accelerations from which a joint can stop (Del Prete, IEEE RA-L 2018, Algorithm 3).

D = q_max − q, T is how long an acceleration is held, A the deceleration that a stop relies on. The
acceleration towards a limit is bounded by the largest acceleration and speed, (23); by the ability
to stop, w² + A·T·w ≤ 2·A·E with w = v + a·T and E = D − T·v/2, (24); and, for E < 0, by turning
round before the limit, (19). `protocol.limits.viability_bounds_oracle` is the definition by
bisection; a test compares the two.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.robot.description import RobotDescription
from hoap3.remote_controller.problems.oracles.parameters import UnverifiableError

Array = NDArray[np.float64]

ROUNDING = 2.0**-46  # of a position: so far outside counts as at the limit
KINDS = ("viability", "naive", "none")
DEFAULTS: dict[str, Any] = {
    "kind": "viability",
    "horizon_periods": 2.0,
    "acceleration_max": (),
    "acceleration_share": 1.0 - 1e-6,
    "margin_rad": 1e-9,
    "speed_share": 1.0 - 1e-9,
    "brake_share": 1.0,
    "softness_rad": 0.0,
    "shrink": False,
}
HIERARCHY_DEFAULTS: dict[str, Any] = {
    **DEFAULTS,
    "acceleration_share": 0.95,
    "margin_rad": 4e-3,
    "speed_share": 0.97,
    "brake_share": 0.85,
    "softness_rad": 1e-6,
    "speed_max": (),
    "torque_max": (),
}


@dataclass(frozen=True)
class Bounds:
    """Of n joints; all arrays are (n,), or broadcast to (N, n).

    Attributes:
        kind: `viability`, `naive` or `none`.
        least, most: limits of the positions [rad or m].
        speed, up, down: largest speed and accelerations, as magnitudes.
        scale: acceleration that margins are relative to.
        T: how long an acceleration is held [s].
        brake_share: of the deceleration that a stop relies on.
        softness: so far outside counts as at the limit [rad or m].
    """

    kind: str
    least: Array
    most: Array
    speed: Array
    up: Array
    down: Array
    scale: Array
    T: float
    brake_share: float
    softness: float

    @classmethod
    def of(cls, robot: RobotDescription, settings: Mapping[str, Any]) -> Bounds:
        """Return those of a config, complete with its defaults."""
        greatest = np.minimum(robot.brake_acceleration, robot.setpoint_acceleration_max)
        if settings["acceleration_max"]:
            greatest = np.broadcast_to(np.array(settings["acceleration_max"], float), robot.n)
        greatest = greatest * settings["acceleration_share"]
        slowest = np.minimum(robot.velocity, settings.get("speed_max") or (np.inf,))
        found = cls(
            settings["kind"],
            robot.lower + settings["margin_rad"],
            robot.upper - settings["margin_rad"],
            slowest * settings["speed_share"],
            greatest,
            greatest,
            greatest,
            robot.period_s * settings["horizon_periods"],
            settings["brake_share"],
            settings["softness_rad"],
        )
        return found._shrunk() if settings["shrink"] else found

    def begun(self, q: Array) -> Bounds:
        """Return those of a robot that starts at q, (n,): a joint outside may stay where it is."""
        if not np.isfinite(q).all() or ((self.least <= q) & (q <= self.most)).all():
            return self
        least, most = np.minimum(self.least, q), np.maximum(self.most, q)
        return replace(self, least=least, most=most, up=self.scale, down=self.scale)

    def at(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Return least and greatest accelerations at positions and velocities, all (…, n)."""
        if self.kind == "none":
            return np.full(q.shape, -np.inf), np.full(q.shape, np.inf)
        below, above = q - self.least, self.most - q
        if self.kind == "naive":
            upper = np.minimum((self.speed - v) / self.T, 2.0 * (above - self.T * v) / self.T**2)
            lower = -np.minimum((self.speed + v) / self.T, 2.0 * (below + self.T * v) / self.T**2)
            upper = np.clip(upper, -self.down, self.up)
            return np.minimum(np.maximum(lower, -self.down), upper), upper
        size = np.maximum(_finite_size(self.least), _finite_size(self.most))
        near = np.maximum(ROUNDING * np.maximum(size, np.abs(q)), self.softness)
        upper = self._towards(above, v, self.up, self.down, near)
        lower = -self._towards(below, -v, self.down, self.up, near)
        back = np.where(above < 0.0, lower, np.where(below < 0.0, upper, 0.5 * (lower + upper)))
        crossed = lower > upper
        return np.where(crossed, back, lower), np.where(crossed, back, upper)

    def _towards(self, room: Array, v: Array, forward: Array, brake: Array, near: Array) -> Array:
        """Return the greatest acceleration towards a limit; brake: the largest one away from it."""
        T, A = self.T, self.brake_share * brake
        with np.errstate(all="ignore"):
            E = room - 0.5 * T * v
            root = 1.0 + np.sqrt(1.0 + 8.0 * np.maximum(E, 0.0) / (A * T * T))
            stops = (np.where(E > 0.0, 4.0 * E / (T * root), 2.0 * E / T) - v) / T
            turns = np.where(room > 0.0, -v * v / (2.0 * room), -brake)
            returns = 2.0 * (room - T * v) / T**2
            beyond = np.where(v > 0.0, turns, returns)
            a = np.where(np.isinf(E), np.inf, np.where(-near <= E, stops, beyond))
            return np.clip(np.minimum(a, (self.speed - v) / T), -brake, forward)

    def _shrunk(self) -> Bounds:
        """Return those with less acceleration where speeds or ranges are too small, (11)."""
        span, T = self.brake_share * (self.most - self.least), self.T
        slow = np.minimum(self.up, np.minimum(self.speed / T, span / T**2))
        with np.errstate(invalid="ignore", over="ignore"):
            fast = 0.5 * slow * (np.sqrt(1.0 + 8.0 * span / (slow * T**2)) - 1.0)
        fast = np.where(np.isinf(slow) | np.isinf(span), np.inf, np.maximum(fast, slow))
        fast = np.minimum(np.minimum(self.down, self.speed / T), fast)
        return replace(self, up=slow, down=fast, scale=np.minimum(slow, fast))


def _finite_size(ends: Array) -> Array:
    return np.where(np.isfinite(ends), np.abs(ends), 0.0)


def check_settings(settings: Mapping[str, Any], n: int) -> None:
    """Raise an UnverifiableError for invalid bounds of a config, complete with defaults."""
    if settings["kind"] not in KINDS:
        raise UnverifiableError(f"bounds are {settings['kind']!r:.40}")
    for key in ("acceleration_max", "speed_max", "torque_max"):
        if len(settings.get(key, ())) not in {0, 1, n}:
            raise UnverifiableError(f"bounds.{key} has {len(settings[key])} values")
    for key in ("acceleration_share", "speed_share", "brake_share", "horizon_periods"):
        if not settings[key] > 0.0:
            raise UnverifiableError(f"bounds.{key} is {settings[key]}")
