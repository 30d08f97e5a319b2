"""Limits of speeds and of margins in plain numpy: QP12, (25), and its second order.

`limit_kernels` is compared with it. Intervals are (least, most), each (n,); m are margins, (s,),
A = −∇m, (s, n); the h of (25), h ≤ 0, is −m. r is kept inside, v_r is the fastest return from
outside, for accelerations twice that.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Interval = tuple[Array, Array]

STILL = 1e-12  # a gradient that small: no joint moves the margin


def meet(these: Interval, those: Interval) -> Interval:
    """What is in both; where nothing is, what of the first is nearest to the second."""
    return np.clip(those[0], *these), np.clip(those[1], *these)


def range_bounds(q: Array, least: Array, most: Array, eta: float, v_r: float) -> Interval:
    """(25) of a joint's range: −η(q − q_min) ≤ u ≤ η(q_max − q); from outside at v_r at most."""
    return np.minimum(-eta * (q - least), v_r), np.maximum(eta * (most - q), -v_r)


def speed_changes(dq: Array, speed: Array, brake: Array, T: float) -> Interval:
    """The q̈ with |q̇ + T·q̈| ≤ ω; who is faster slows down with `brake` at most."""
    return np.minimum((-speed - dq) / T, brake), np.maximum((speed - dq) / T, -brake)


def room(m: Array, r: float, furthest: float) -> Array:
    """What is left of m: m − r inside, not below 0; m outside, not below −furthest."""
    return np.where(m >= 0.0, np.maximum(m - r, 0.0), np.maximum(m, -furthest))


def rows(m: Array, A: Array, eta: float, r: float, v_r: float) -> Interval:
    """(25): A u ≤ η(m − r). Rows outside that no joint moves ask for nothing: 0·u ≤ ∞."""
    lost = (np.abs(A).max(axis=1) < STILL) & (m < 0.0)
    b = eta * room(m, r, v_r / eta)
    return np.where(lost[:, None], 0.0, A), np.where(lost, np.inf, b)


def accelerations(
    m: Array, A: Array, dq: Array, bend: Array, eta: float, r: float, v_r: float
) -> Interval:
    """A q̈ ≤ 2ηṁ + η²(m − r) − Ȧq̇, ṁ = −A q̇: (25) once more, for ṁ + ηm in place of m.

    From far outside ṁ settles at v_r/2.
    """
    still = np.abs(A).max(axis=1) < STILL
    upper = eta * (-A @ dq) + eta * (-A @ dq + eta * room(m, r, v_r / eta)) - bend
    return np.where(still[:, None], 0.0, A), np.where(still, np.inf, upper)


def slow_returns(A: Array, b: Array, box: Interval) -> Array:
    """The sides b; those that ask for a return not below half of the least A u in the box."""
    least = np.minimum(A * box[0], A * box[1]).sum(axis=1)
    return np.where(b < 0.0, np.maximum(b, 0.5 * least), b)


def held(A: Array, x: Array, sides: Interval, owners: NDArray[np.int64], near: float) -> set[int]:
    """Whose rows x holds at an end, to `near` of 1 + Σ|A_i x_i|; equations do not count."""
    size = 1.0 + np.abs(A * x).sum(axis=1)
    apart = np.minimum(A @ x - sides[0], sides[1] - A @ x)
    return {int(i) for i in owners[(apart <= near * size) & (sides[0] < sides[1])]}
