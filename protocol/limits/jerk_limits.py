"""Greatest acceleration that a jerk limit allows; the proof is in docs/internals/proofs.md."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.robot.description import RobotDescription

Array = NDArray[np.float64]

INSIDE = 1.0 - 1e-9  # because of rounding


def kept_acceleration(
    lower: Array, upper: Array, velocity: Array, acceleration: Array, jerk: Array, T: float
) -> Array:
    """The greatest acceleration up to `acceleration` for which all limits have a common answer.

    A joint that brakes before one wall as hard as it can goes back towards the other by no more
    than 2/3·A³/J². And whoever releases A as soon as the joint turns round gains A²/2J. So

        2/3·A³/J² ≤ upper − lower    or    A ≤ JT
        T·((A − JT) + (A − 2JT) + …) ≤ V

    Args:
        lower, upper, velocity, acceleration: limits, (n,) [rad, s or m, s].
        jerk: J, (n,); inf: no limit, and A stays.
        T: period [s].
    """
    step, some = jerk * T, np.isfinite(jerk)
    with np.errstate(all="ignore"):
        turn = np.maximum(np.cbrt(1.5 * (upper - lower) * jerk**2), step)
        n = np.maximum(1.0, np.ceil(0.5 * (np.sqrt(1.0 + 8.0 * velocity / (step * T)) - 1.0)))
        gain = step + (velocity / T + 0.5 * step * n * (n - 1.0)) / n
    least = np.minimum(turn, gain)
    return np.where(some & (least < acceleration), INSIDE * least, acceleration)


def limits_with_jerk(robot: RobotDescription) -> Array:
    """What joints keep to, (5, n): least and greatest q, and greatest speed, acceleration and jerk.

    The acceleration is what can be let have. A jerk of 2A/T or more is inf: A alone keeps to it.
    """
    most, jerk, T = robot.setpoint_acceleration_max, robot.setpoint_jerk_max, robot.period_s
    binding = np.where(jerk < 2.0 * most / T, jerk, np.inf)
    limits = robot.lower, robot.upper, robot.velocity
    return np.array([*limits, kept_acceleration(*limits, most, binding, T), binding])
