"""A frame that stays where it is, in plain numpy: how far it is away, and the slope of that.

`fixed_frame_kernels` is compared with it. R·R₀ᵀ turns by θ about the unit axis a.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def displacement(p: Array, R: Array, p_kept: Array, R_kept: Array) -> Array:
    """e, (6,): p − p₀ [m] over sin θ·a, of which R·R₀ᵀ less its transpose has twice [rad]."""
    D = R @ R_kept.T
    twice = D - D.T
    return np.hstack([p - p_kept, 0.5 * twice[2, 1], 0.5 * twice[0, 2], 0.5 * twice[1, 0]])


def slope(R: Array, R_kept: Array, jacobian: Array) -> Array:
    """∂e/∂q, (6, n), of a Jacobian of velocities over angular velocities ω: Ḋ = ω × D."""
    D = R @ R_kept.T
    turning = 0.5 * (np.trace(D) * np.eye(3) - D)
    return np.vstack([jacobian[:3], turning @ jacobian[3:]])
