"""What a joint with a limit of jerk can do, by what it means.

`jerk_limits_kernels` is compared with it. Plain numpy, no formula: steps are summed up, bounds are
found by halving. All arrays are (n,), one joint each; what the kernels reserve for rounding is left
out.

The reference goes in straight lines, q' = q + Tw', w' = w + Tα', and |α' − α| ≤ JT, |α'| ≤ A.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Limits = tuple[Array, Array, Array, Array, Array]

HALVINGS = 50
MOST_PERIODS = 20_000


def brake_peak(v: Array, a: Array, A: Array, J: Array, T: float) -> Array:
    """How far a joint still rises under the maximal brake α_i = max(a − iJT, −A)."""
    place, highest = np.zeros_like(v), np.zeros_like(v)
    for _ in range(MOST_PERIODS):
        a = np.maximum(a - J * T, -A)
        v = v + a * T
        place = place + v * T
        highest = np.maximum(highest, place)
        if np.all((v <= 0.0) & (a <= 0.0)):
            return highest
    raise ArithmeticError("braking takes too long")


def release(a: Array, J: Array, T: float) -> Array:
    """Velocity that is gained while |a| is released to 0: T (|a| − JT) + T (|a| − 2JT) + …."""
    k = np.arange(1.0, np.max(np.abs(a) / (J * T), initial=0.0) + 2.0)[:, None]
    return np.asarray(T * np.maximum(np.abs(a) - k * J * T, 0.0).sum(axis=0))


def hardest_brake(v: Array, J: Array, T: float) -> Array:
    """The greatest b that can be released: T (b + … + (b − (n − 1)JT)) ≤ v for all n."""
    n = np.arange(1.0, np.sqrt(2.0 * np.max(v / J, initial=0.0)) / T + 2.0)[:, None]
    return np.asarray(((v / T + 0.5 * J * T * n * (n - 1.0)) / n).min(axis=0))


def stop_end(v: Array, a: Array, A: Array, J: Array, T: float) -> Array:
    """Where the stop ends, that brakes as hard as can still be released at rest."""
    side = np.where(v + np.sign(a) * release(a, J, T) >= 0.0, 1.0, -1.0)
    v, brake, way = side * v, -side * a, np.zeros_like(v)
    for _ in range(MOST_PERIODS):
        brake = np.minimum(np.minimum(brake + J * T, A), hardest_brake(v, J, T))
        v = v - brake * T
        way = way + v * T
        if np.all((np.abs(v) <= 1e-12 * A * T) & (np.abs(brake) <= 1e-9 * A)):
            return side * way
    raise ArithmeticError("stopping takes too long")


def _greatest(kept: Callable[[Array], NDArray[np.bool_]], least: Array, most: Array) -> Array:
    """The greatest value for which something is kept that all lesser ones keep; else the least."""
    low, high = least.copy(), most.copy()
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        fine = kept(middle)
        low, high = np.where(fine, middle, low), np.where(fine, high, middle)
    return np.where(kept(most), most, low)


def _most(room: Array, v: Array, a: Array, limits: Limits, T: float) -> Array:
    """The greatest next acceleration that keeps the upper limits of this joint, now and later."""
    _, _, speed, A, J = limits

    def kept(next_a: Array) -> NDArray[np.bool_]:
        w = v + next_a * T
        peak = w * T + brake_peak(w, next_a, A, J, T)
        gained = np.where(next_a > 0.0, release(next_a, J, T), 0.0)
        return np.asarray((peak <= room) & ((w + gained <= speed) | (next_a <= 0.0)))

    return _greatest(kept, np.maximum(a - J * T, -A), np.minimum(a + J * T, A))


def acceleration_bounds(
    q: Array, v: Array, a: Array, limits: Limits, T: float
) -> tuple[Array, Array]:
    """Least and greatest next acceleration after which all limits can be kept for ever.

    Args:
        q, v, a: place, and velocity and acceleration over the last period.
        limits: (5, n) least and greatest q, and greatest speed, acceleration and jerk.
        T: period.
    """
    most = _most(limits[1] - q, v, a, limits, T)
    least = -_most(q - limits[0], -v, -a, limits, T)
    return least, most


def next_for_stop(
    away: Array, v: Array, bounds: tuple[Array, Array], limits: Limits, T: float
) -> Array:
    """The next acceleration within bounds after which the stop ends `away`, or nearest to it."""
    _, _, _, A, J = limits

    def short(next_a: Array) -> NDArray[np.bool_]:
        w = v + next_a * T
        return np.asarray(w * T + stop_end(w, next_a, A, J, T) <= away)

    return _greatest(short, *bounds)
