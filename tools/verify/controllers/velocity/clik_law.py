"""The law dq = B(Λ e + x) of prioritised tasks, and what its gains certify, over many cycles.

Marti-Saumell et al., (7), (14) and (20). With J = R Qᵀ, Q's columns orthonormal and R lower
triangular, task i adds the columns Q_i, and N_{i−1} J_i⁺ = Q_i M_iᵀ, where M_iᵀ are the last rows
of R_i⁺: no projector is formed. Where rows depend on others, `clik_reference` has projectors.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from hoap3.remote_controller.solvers.clik.clik_reference import prioritised
from hoap3.remote_controller.solvers.clik.constant_gains_reference import feed_forward

Array = NDArray[np.float64]

EPS = float(np.finfo(float).eps)
DEPENDENT = 1e-6  # of a row's length: with less of it outside the rows above, projectors are used
SMALLEST = 1e-290  # 1/s: a β that near to 0 is 0
ROUNDED = 64.0  # units of the last place, times the condition squared, by which B and L may differ


@dataclass(frozen=True)
class Law:
    """B, L and how exactly they are known.

    Attributes:
        B: (N, n, m) of dq = B(Λ e + x).
        L: D J B D⁻¹, D = diag √w, (N, m, m).
        unsure: share of B and L that rounding may change, (N,).
        rank: of the stacked Jacobian, (N,), and whether it is beyond doubt,
        sure: (N,).
    """

    B: Array
    L: Array
    unsure: Array
    rank: Array
    sure: NDArray[np.bool_]

    def only(self, at: NDArray[np.bool_]) -> Law:
        """That of some cycles, (N,)."""
        return Law(self.B[at], self.L[at], self.unsure[at], self.rank[at], self.sure[at])

    def unsure_of(self, x: Array) -> Array:
        """By how much rounding may change any joint of B x, (N, 1), for x (N, m).

        Rounding is that of whole columns of B: an entry may be next to nothing, and all rounding.
        """
        found: Array = self.unsure * (np.linalg.norm(self.B, axis=1) * np.abs(x)).sum(1)
        return found[:, None]


def law_of(J: Array, sizes: Sequence[int], weights: Array, damping: float) -> Law:
    """The law for stacked Jacobians, (N, m, n).

    Args:
        J: ∂e/∂q of all tasks, the most important first.
        sizes: rows of each.
        weights: w of V = ½ Σ w e², (m,).
        damping: d of Jᵀ(JJᵀ + d²I)⁻¹ in place of J⁺.
    """
    N, m, n = J.shape
    ends = [0, *np.cumsum(sizes).tolist()]
    lengths = np.linalg.norm(J, axis=2)
    B, unsure, D = np.zeros((N, n, m)), np.full(N, np.inf), np.sqrt(weights)
    values = np.linalg.svd(J, compute_uv=False)
    shares = values / np.maximum(values[:, :1], 1e-300)
    rank = (shares > 1e-8).sum(1)
    sure = ~((shares > 1e-11) & (shares < 1e-5)).any(1)
    if m <= n:
        Q, T = np.linalg.qr(J.transpose(0, 2, 1))
        R = T.transpose(0, 2, 1)
        left = np.abs(np.diagonal(R, axis1=1, axis2=2)) / np.maximum(lengths, 1e-300)
        condition = 1.0 / np.maximum(left.min(1), 1e-300)
        for start, end in pairwise(ends):
            wide = R[:, start:end, :end]
            damped = np.broadcast_to(damping * np.eye(end - start), (N, end - start, end - start))
            inverse = np.linalg.pinv(np.concatenate([wide, damped], 2) if damping else wide, 1e-14)
            B[:, :, start:end] = Q[:, :, start:end] @ inverse[:, start:end]
            own = np.linalg.svd(wide, compute_uv=False)
            condition = np.maximum(condition, own[:, 0] / np.maximum(own[:, -1], 1e-300))
        unsure = ROUNDED * EPS * condition**2
    for k in np.flatnonzero(unsure > ROUNDED * EPS / DEPENDENT**2):
        B[k], _ = prioritised(sizes, J[k], np.ones(m), damping)
        above = shares[k][shares[k] > 1e-8]
        unsure[k] = ROUNDED * EPS / min(float(above.min(initial=1.0)), DEPENDENT) ** 2
    L = D[:, None] * (J @ B) / D
    return Law(B, L, unsure, rank, sure)


def stability(law: Law, gains: Array, dt: float) -> tuple[Array, Array]:
    """C(λ, 0) = LΛ + ΛLᵀ − Δt ΛLᵀLΛ of (20), (N, m, m), and LΛ."""
    step = law.L * gains[:, None, :]
    turned = step.transpose(0, 2, 1)
    return step + turned - dt * turned @ step, step


def certified_rates(law: Law, gains: Array, dt: float) -> tuple[Array, Array]:
    """The β [1/s] that gains certify, λ_min(C(λ, 0)), and how exactly it is known, both (N,)."""
    C, step = stability(law, gains, dt)
    near = 2.0 * np.linalg.norm(step, axis=(1, 2)) * (law.unsure + ROUNDED * EPS) + SMALLEST
    return np.asarray(np.linalg.eigvalsh(C)[:, 0], float), np.asarray(near)


def fed(
    law: Law, J: Array, rates: Array, lower: Array, upper: Array, damping: float
) -> tuple[Array, Array]:
    """B x (N, n) that targets take which move by σ̇* = `rates` (N, m), and how much of x, (N,)."""
    found, share = np.zeros(law.B.shape[:2]), np.ones(len(rates))
    for k in np.flatnonzero(rates.any(1)):
        B = law.B[k]
        found[k], share[k] = feed_forward(B, J[k] @ B, rates[k], lower[k], upper[k], damping)
    return found, share
