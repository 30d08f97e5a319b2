"""The tangent of a curve and the velocity that circulates it in plain numpy: QP12, (22) and (23).

`curve_kernels` is compared with it. A curve is α(x) = 0, with gradients g = ∂α/∂x, (m − 1, m).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def tangent(gradients: Array, direction: float, last: Array) -> Array:
    """T of (22), (m,): a unit vector orthogonal to every gradient.

    Its sign is that of a turn below 90° from `last`, or, where that is 0, such that the
    determinant of gradients and tangent has the sign of `direction`.
    """
    T = np.asarray(np.linalg.svd(gradients)[2][-1])
    sign = last @ T if last.any() else direction * np.linalg.det(np.vstack([gradients, T]))
    return T if sign >= 0.0 else -T


def velocity(
    gradients: Array, alpha: Array, weights: Array, T: Array, speed: float, decrease: float
) -> Array:
    """ẋ = ζT + g⁺y of (23), (m,): y least in ½ Σ w_i y_i² with αᵀy = −ρΨ, by Lagrange."""
    y = alpha / weights
    return np.asarray(speed * T - np.linalg.pinv(gradients) @ y * decrease / (alpha @ y))
