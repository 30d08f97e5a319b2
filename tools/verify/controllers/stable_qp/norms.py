"""Whether |u|_p is the least where nothing but V's rate is asked for: Hölder's inequality.

    |s·u| ≤ |s|_q·|u|_p,   1/p + 1/q = 1,   q = ∞ for p ≤ 1

(Gonçalves et al., IEEE T-RO 2020, Example 2). Where both sides are equal no shorter u does as much.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def holder_gap(slope: Array, u: Array, p: float) -> float:
    """1 − |s·u|/(|s|_q·|u|_p), 0 where nothing moves.

    Args:
        slope, u: (n,).
        p: > 0, may be inf.
    """
    if not u.any():
        return 0.0
    q = np.inf if p <= 1.0 else 1.0 if np.isinf(p) else p / (p - 1.0)
    span, top = np.abs(u).max(), np.abs(slope).max()
    lengths = np.linalg.norm(slope / top, q) * np.linalg.norm(u / span, p)
    return float(1.0 - abs(slope @ u) / (top * span) / lengths)
