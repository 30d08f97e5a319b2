"""Generalized hierarchical control of velocities, condensed to the joints, over many cycles.

Liu, Tan and Padois (2015), (11) and (13) with the velocities of section 8: with H_i = J_iᵀJ_i + wI,

    min Σ |J_i x_i − b_i|² + w Σ |x_i|²  such that  u = Σ P_i x_i,  lower ≤ u ≤ upper

leaves, for a given u, ½(u − q₀)ᵀ S⁺ (u − q₀) with S = Σ P_i H_i⁻¹ P_i and
q₀ = Σ P_i J_iᵀ(J_i J_iᵀ + wI)⁻¹ b_i. So u is optimal where u = q₀ + Sμ, μ_j ≥ 0 at a lower bound,
≤ 0 at an upper one, and 0 elsewhere.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from hoap3.tools.verify.controllers.acceleration.projectors import Projectors

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


@dataclass(frozen=True)
class Condensed:
    """S and q₀ of each cycle, (N, n, n) and (N, n), and how far each |b_i| reaches, (N, k).

    |P_i J_iᵀ(J_i J_iᵀ + wI)⁻¹| ≤ max σ/(σ² + w), σ the singular values of J_i.
    """

    S: Array
    q0: Array
    reach: Array


def condensed(
    J: Array, b: Array, rows: Sequence[slice], alpha: Array, w: float, width: float
) -> Condensed:
    """The problem of each cycle.

    Args:
        J, b: of all tasks, (N, m, n) and (N, m).
        rows: those of each task.
        alpha: (N, k, k) priorities: [:, i, j] of task j over task i.
        w: ω_r.
        width: s₀; 0 for the exact projector.
    """
    N, _, n = J.shape
    S, q0, reach = np.zeros((N, n, n)), np.zeros((N, n)), np.zeros((N, len(rows)))
    projectors = Projectors(J, [0, *(each.stop for each in rows)], width)
    for i, mine in enumerate(rows):
        P = projectors.of(alpha[:, i])
        U, s, Vt = np.linalg.svd(J[:, mine], full_matrices=False)
        V = Vt.transpose(0, 2, 1)
        spread = (1.0 / (s**2 + w))[:, None, :]
        inverse = V * spread @ Vt + (np.eye(n) - V @ Vt) / w  # H_i⁻¹
        S += P @ inverse @ P
        within = U.transpose(0, 2, 1) @ b[:, mine, None]
        reach[:, i] = (s / (s**2 + w)).max(1)
        q0 += (P @ V @ ((s / (s**2 + w))[:, :, None] * within))[:, :, 0]
    return Condensed(S, q0, reach)


def multipliers(problem: Condensed, u: Array, lower: Flags, upper: Flags) -> Array:
    """The μ with which u is nearest to q₀ + Sμ, (N, n).

    Args:
        problem: S and q₀.
        u: (N, n).
        lower, upper: at which of its bounds each joint is, (N, n).
    """
    found = np.zeros(u.shape)
    for k in np.flatnonzero((lower | upper).any(1)):
        down, up = np.flatnonzero(lower[k]), np.flatnonzero(upper[k])
        A = np.hstack([problem.S[k][:, down], -problem.S[k][:, up]])
        size = np.linalg.norm(A, axis=0)
        size[size == 0.0] = 1.0
        x = nnls(A / size, u[k] - problem.q0[k])[0] / size
        found[k, down] += x[: len(down)]
        found[k, up] -= x[len(down) :]
    return found
