"""The logarithm of a pose error and its derivatives in plain numpy and scipy.

`se3_kernels` is compared with it. e = log(M_d⁻¹M), a twist (ρ, φ), is a logarithm of 4 × 4
matrices, and its derivative the upper right block of one of 8 × 8: log [[X, Ẋ], [0, X]] =
[[log X, d log X], [0, log X]] (Mathias 1996).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm, expm_frechet, logm

Array = NDArray[np.float64]


def cross_matrix(w: Array) -> Array:
    """The matrix [w]× of w × …, (3, 3)."""
    return np.array([[0.0, -w[2], w[1]], [w[2], 0.0, -w[0]], [-w[1], w[0], 0.0]])


def homogeneous(rotation: Array, position: Array, corner: float = 1.0) -> Array:
    """[[R, p], [0, 1]], (4, 4); its rate has 0 in the corner."""
    top = np.hstack([rotation, np.reshape(position, (3, 1))])
    return np.vstack([top, [0.0, 0.0, 0.0, corner]])


def twist(logarithm: Array) -> Array:
    """(ρ, φ), (6,), of [[[φ]×, ρ], [0, 0]]."""
    return np.hstack([logarithm[:3, 3], logarithm[2, 1], logarithm[0, 2], logarithm[1, 0]])


def pose_error(
    position: Array, rotation: Array, twists: Array, target: Array, target_rate: Array
) -> tuple[Array, Array, Array]:
    """The error e = log(M_d⁻¹M), (6,); ∂e/∂q, (6, n); and ∂e/∂t, (6,).

    Args:
        position, rotation: of M.
        twists: (6, n), v of its origin and ω for each joint, in the axes of p and p_d.
        target, target_rate: (6,), p_d and the rotation vector of R_d, and their rates.
    """
    turn, turning = cross_matrix(target[3:]), cross_matrix(target_rate[3:])
    M, goal = homogeneous(rotation, position), homogeneous(expm(turn), target[:3])
    goal_rate = homogeneous(expm_frechet(turn, turning)[1], target_rate[:3], 0.0)
    back = np.linalg.inv(goal)
    X = back @ M
    rates = [homogeneous(cross_matrix(t[3:]) @ rotation, t[:3], 0.0) for t in twists.T]
    rates = [back @ rate for rate in rates] + [-back @ goal_rate @ X]

    def log_rate(rate: Array) -> Array:
        return twist(np.real(logm(np.block([[X, rate], [np.zeros((4, 4)), X]]))[:4, 4:]))

    columns = np.array([log_rate(rate) for rate in rates]).T
    return twist(np.real(logm(X))), columns[:, :-1], columns[:, -1]


def rotation_vector(rotation: Array, near: Array) -> Array:
    """Of the rotation vectors φ and (1 − 2π/|φ|)φ of a rotation the one nearer to `near`."""
    phi = twist(np.real(logm(homogeneous(rotation, np.zeros(3)))))[3:]
    other = (1.0 - 2.0 * np.pi / np.linalg.norm(phi)) * phi
    return phi if np.linalg.norm(phi - near) <= np.linalg.norm(other - near) else other
