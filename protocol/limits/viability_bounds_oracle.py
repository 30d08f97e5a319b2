"""Bounds of the acceleration by what they mean, in plain numpy: no formula, only halving.

Del Prete, IEEE RA-L 2018, (1) to (18): an acceleration may be held for T if until then all limits
are kept, also between the ends, and the joint can still stop after it. `viability_bounds_kernels`
is compared with it. All arrays are (n,), one joint each; rooms are exact where q and a limit would
cancel.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

HALVINGS = 200


def keeps_upper(a: Array, room: Array, v: Array, speed: Array, down: Array, T: float) -> Array:
    """Whether `a`, held for T, keeps the upper limit and the joint able to stop before it.

    Args:
        a: acceleration.
        room: D = q_max − q ≥ 0.
        v, speed: velocity, and the largest one.
        down: A, what it brakes with.
        T: for which `a` is held.
    """
    way, after = T * (v + 0.5 * a * T), v + a * T  # (1)
    with np.errstate(divide="ignore", invalid="ignore"):
        turns = (v > 0.0) & (after < 0.0)  # within T, (16), at v²/(−2a), (18)
        peak = np.where(turns, v * v / (-2.0 * a), np.maximum(way, 0.0))  # (15)
    stops = (after <= 0.0) | (after * after <= 2.0 * down * (room - way))  # (7), (8)
    return np.asarray((peak <= room) & (after <= speed) & stops)


def greatest(room: Array, v: Array, speed: Array, up: Array, down: Array, T: float) -> Array:
    """The greatest acceleration from −down to up that keeps the upper limit.

    Less of it is always kept too: where a joint is does not decrease with the acceleration, (15).
    """
    low, high = -down, up
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        kept = keeps_upper(middle, room, v, speed, down, T)
        low, high = np.where(kept, middle, low), np.where(kept, high, middle)
    return np.where(keeps_upper(up, room, v, speed, down, T), up, low)


def bounds(
    above: Array, below: Array, v: Array, speed: Array, up: Array, down: Array, T: float
) -> tuple[Array, Array]:
    """Least and greatest acceleration in states from which a joint can stop, Algorithm 3.

    Args:
        above, below: q_max − q and q − q_min; the rest is as above. The lower side is the upper
            one, seen in a mirror.
    """
    return -greatest(below, -v, speed, down, up, T), greatest(above, v, speed, up, down, T)


def naive_bounds(
    above: Array, below: Array, v: Array, speed: Array, up: Array, T: float
) -> tuple[Array, Array]:
    """The bounds of (2), which look one step ahead only: q and v after T within their limits."""
    least = np.maximum(np.maximum((-speed - v) / T, 2.0 * (-below - T * v) / T**2), -up)
    most = np.minimum(np.minimum((speed - v) / T, 2.0 * (above - T * v) / T**2), up)
    return least, most
