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

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

LEAST_WIDTH = 1e-5  # of |J_l|_F: the least s₀
DEPENDENT = 1e-8  # of a singular value of unit rows: less is rounding


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
    for i, mine in enumerate(rows):
        P = projectors(J, rows, alpha[:, i], width)
        U, s, Vt = np.linalg.svd(J[:, mine], full_matrices=False)
        V = Vt.transpose(0, 2, 1)
        spread = (1.0 / (s**2 + w))[:, None, :]
        inverse = V * spread @ Vt + (np.eye(n) - V @ Vt) / w  # H_i⁻¹
        S += P @ inverse @ P
        within = U.transpose(0, 2, 1) @ b[:, mine, None]
        reach[:, i] = (s / (s**2 + w)).max(1)
        q0 += (P @ V @ ((s / (s**2 + w))[:, :, None] * within))[:, :, 0]
    return Condensed(S, q0, reach)


def projectors(J: Array, rows: Sequence[slice], alpha: Array, width: float) -> Array:
    """P = (1 − a_1)I + Σ (a_l − a_{l+1}) N_l, (N, n, n), a_1 > a_2 > … the priorities over a task.

    Args:
        J, rows, width: as above.
        alpha: of each task over this one, (N, k).
    """
    N, _, n = J.shape
    found = np.zeros((N, n, n))
    order = (alpha[:, :, None] > alpha[:, None, :]).sum(2) * (alpha > 0.0) + (alpha > 0.0)
    orders, which = np.unique(order, axis=0, return_inverse=True)
    for number, ranks in enumerate(orders):
        at = np.flatnonzero(which.ravel() == number)
        levels = sorted({rank for rank in ranks.tolist() if rank > 0}, reverse=True)
        a = [alpha[at, ranks.tolist().index(level)] for level in levels] + [np.zeros(len(at))]
        found[at] += (1.0 - a[0])[:, None, None] * np.eye(n)
        for place, level in enumerate(levels):
            above = [slice_ for slice_, rank in zip(rows, ranks, strict=True) if rank >= level]
            stack = np.concatenate([J[at, each] for each in above], 1)
            share = (a[place] - a[place + 1])[:, None, None]
            found[at] += share * null_spaces(stack, width)
    return found


def null_spaces(J: Array, width: float) -> Array:
    """N_l = I − V diag(φ) Vᵀ of stacked rows, (N, n, n): φ = 1, or 3t² − 2t³, t = min(σ/s₀, 1)."""
    if width > 0.0:
        size = np.linalg.norm(J, axis=(1, 2))
        _, s, Vt = np.linalg.svd(J, full_matrices=False)
        t = np.minimum(s / np.maximum(width, LEAST_WIDTH * size)[:, None], 1.0)
        kept = 3.0 * t**2 - 2.0 * t**3
    else:
        lengths = np.linalg.norm(J, axis=2, keepdims=True)
        _, s, Vt = np.linalg.svd(J / np.where(lengths > 0.0, lengths, 1.0), full_matrices=False)
        kept = (s > DEPENDENT).astype(float)
    return np.asarray(np.eye(J.shape[2]) - (Vt.transpose(0, 2, 1) * kept[:, None, :]) @ Vt)


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
