"""The approach to a moving target in plain numpy: `approach_kernels` is compared with it.

x(t) = x₀ + s(t/d)·(c(t) − x₀), where s rises from 0 to 1 with ds = d²s = 0 at both ends: its
derivative is proportional to z²(1 − z)².
"""

from __future__ import annotations

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import NDArray

Array = NDArray[np.float64]

RISE = (Polynomial([0.0, 1.0]) ** 2 * Polynomial([1.0, -1.0]) ** 2).integ()
S = RISE / RISE(1.0)


def approach(
    start: Array, position: Array, velocity: Array, elapsed: float, duration: float
) -> tuple[Array, Array]:
    """Give x and ẋ, (m,), for c and ċ at a time within the approach, both in s."""
    z = elapsed / duration
    s, s_rate = S(z), S.deriv()(z) / duration
    return start + s * (position - start), s_rate * (position - start) + s * velocity
