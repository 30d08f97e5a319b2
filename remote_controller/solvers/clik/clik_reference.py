"""The law of prioritised tasks and its certificate in plain numpy, as the paper writes them.

Marti-Saumell et al.; `clik_kernels` and `lmi_kernels` are compared with it. Every projector,
inverse and eigenvalue is written out, so it is slow and allocates.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

RANK = 1e-8  # singular values up to that of the largest one are 0


def inverse(J: Array, damping: float = 0.0) -> Array:
    """J⁺, (joints, rows), the pseudoinverse of (2); with damping d: Jᵀ(J Jᵀ + d²I)⁻¹.

    Both are the first rows of [J | dI]⁺.
    """
    wide = np.hstack([J, damping * np.eye(len(J))])
    return np.asarray(np.linalg.pinv(wide, rcond=RANK)[: J.shape[1]])


def null_space_projector(J: Array) -> Array:
    """N = I − J⁺J, (joints, joints), of stacked Jacobians (3), (4)."""
    return np.asarray(np.eye(J.shape[1]) - inverse(J) @ J)


def prioritised(
    sizes: Sequence[int], J: Array, weights: Array, damping: float = 0.0
) -> tuple[Array, Array]:
    """B and L, for dq = B Λ e (7) and ė = −L Λ e.

    Args:
        sizes: rows of each task, the most important first; n in all.
        J: stacked Jacobian (4), (n, joints).
        weights: w of V = ½ Σ w_i e_i² (9), (n,).
        damping: d.

    Returns:
        B = [J_1⁺ | N_1 J_2⁺ | … | N_{h−1} J_h⁺], (joints, n), and L = D J B D⁻¹ with D = diag √w,
        (n, n), block lower triangular, of which A = −LΛ is (14).
    """
    ends = np.cumsum(sizes)
    blocks = [
        null_space_projector(J[: end - d]) @ inverse(J[end - d : end], damping)
        for d, end in zip(sizes, ends, strict=True)
    ]
    B, D = np.hstack(blocks), np.sqrt(weights)
    return B, D[:, None] * (J @ B) / D


def stability_matrix(L: Array, gains: Array, beta: float, dt: float) -> Array:
    """C(λ, β) = −A − Aᵀ − βI − Δt AᵀA, (n, n): C ⪰ 0 is (20), the Schur complement of (21)."""
    A = -L * gains
    return np.asarray(-A - A.T - beta * np.eye(len(L)) - dt * A.T @ A)


def certified(L: Array, gains: Array, dt: float) -> float:
    """The largest β [1/s] with V⁺ ≤ (1 − β Δt) V for every e (12), (20): λ_min of C(λ, 0)."""
    return float(np.linalg.eigvalsh(stability_matrix(L, gains, 0.0, dt))[0])
