"""The optimum where bounds alone are in the way, for many cycles at once.

Then one multiplier t ≥ 0 or ≤ 0 explains all joints: y_i is the point within its bounds that is
nearest to sign(r_i)·max(0, |r_i| − κ) with r_i = −t·s_i. Each joint leaves an interval of t, and y
is the optimum where these have one in common.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

HALVINGS = 60
LEAST = 1e-17  # below, a deviation is none


def multipliers(
    y: Array, slope: Array, kappa: Array, lower: Array, upper: Array, off: Array
) -> tuple[Array, Array]:
    """Least and greatest t for which no joint is further from the optimum than `off`.

    Args:
        y, slope, lower, upper: y, s and the bounds, (N, n).
        kappa: κ, (N,).
        off: (N,).

    Returns:
        (N,) and (N,); the first is above the second where there is no such t.
    """
    down = slope > 0.0  # of joints that move down where t grows, everything counts with its sign
    z, low = np.where(down, -y, y), np.where(down, -upper, lower)
    high, a = np.where(down, -lower, upper), np.abs(slope)
    k, off = kappa[:, None], off[:, None]
    p, q = z - off, z + off
    least = np.where(p > 0.0, p + k, p - k)
    most = np.where(q >= 0.0, q + k, q - k)
    least = np.where(low >= p, -np.inf, np.where(high < p, np.inf, least))
    most = np.where(high <= q, np.inf, np.where(low > q, -np.inf, most))
    fits = (least <= 0.0) & (most >= 0.0)  # where no t moves the joint
    with np.errstate(divide="ignore", invalid="ignore"):
        from_t = np.where(a > 0.0, least / a, np.where(fits, -np.inf, np.inf))
        to_t = np.where(a > 0.0, most / a, np.where(fits, np.inf, -np.inf))
    return from_t.max(1), to_t.min(1)


def deviation(y: Array, slope: Array, kappa: Array, lower: Array, upper: Array) -> Array:
    """The least `off` for which there is such a t, (N,), by halving its logarithm."""
    top = np.abs(y).max(1) + kappa + 1.0
    low, high = np.full(len(y), LEAST), top
    for _ in range(HALVINGS):
        middle = np.sqrt(low * high)
        least, most = multipliers(y, slope, kappa, lower, upper, middle)
        found = least <= most
        low, high = np.where(found, low, middle), np.where(found, middle, high)
    return np.where(high <= 2.0 * LEAST, 0.0, high)
