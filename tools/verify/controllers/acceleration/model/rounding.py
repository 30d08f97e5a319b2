"""How exactly the equation of motion is known."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hoap3.tools.verify.controllers.acceleration.model.wanted import ROUNDING

Array = NDArray[np.float64]


def rounding_of(M: Array, h: Array, dq: Array, ddq: Array) -> Array:
    """How exactly M·q̈ + h is known, (N, 1), of M (N, n, n) and the rest (N, n).

    Inertias of light links are differences of what they are about the root, so each entry of M has
    the rounding of the largest.
    """
    motion = np.abs(ddq).sum(1) + np.abs(dq).sum(1) ** 2
    found = np.abs(M).max((1, 2)) * motion + np.abs(h).max(1)
    return np.asarray(ROUNDING * found[:, None])
