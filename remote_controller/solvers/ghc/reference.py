"""Generalized hierarchical control in plain numpy: what its kernels are checked against.

Liu, Tan and Padois, Autonomous Robots 2015, by the paper's equations. Slow, and without numba.
"""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

RANK = 1e-8  # of a singular value of unit rows: less is rounding
SINGULAR = 1e-10  # of the largest eigenvalue of S: less is rounding
MET = 1e-9  # of 1 + |h|: a row that is violated by less holds


def projector(alpha: Array, J: Array, width: float = 0.0) -> Array:
    """(11) in closed form: P = (1 − a_1) I + Σ (a_l − a_{l+1}) N_l, a_1 > … > a_L > a_{L+1} = 0.

    Args:
        alpha: priorities of the rows over the task, (m,).
        J: all rows, (m, n).
        width: s₀; 0 for the exact projector.
    """
    levels = [*sorted({a for a in alpha if a > 0.0}, reverse=True), 0.0]
    P: Array = (1.0 - levels[0]) * np.eye(J.shape[1])
    for upper, lower in itertools.pairwise(levels):
        P += (upper - lower) * null_space(J[alpha >= upper], width)
    return P


def null_space(J: Array, width: float = 0.0) -> Array:
    """N_l = I − V diag(φ) Vᵀ, J_l = Q diag(σ) Vᵀ: φ = 1 of all σ > 0, or φ(σ/s₀) = 3t² − 2t³.

    The kernels raise s₀ to 1e-5 |J_l|_F where it is less; here it is as given.
    """
    n = J.shape[1]
    if width > 0.0:
        _, s, Vt = np.linalg.svd(J, full_matrices=False)
        t = np.minimum(s / width, 1.0)
        return np.asarray(np.eye(n) - Vt.T * (3.0 * t**2 - 2.0 * t**3) @ Vt)
    largest = np.abs(J).max(axis=1, initial=0.0)
    rows = J[largest > 0.0] / largest[largest > 0.0, None]
    if not len(rows):
        return np.eye(n)
    _, s, Vt = np.linalg.svd(rows / np.linalg.norm(rows, axis=1)[:, None])
    V = Vt[: int((s > RANK).sum())]
    return np.asarray(np.eye(n) - V.T @ V)


def condensed(
    jacobians: list[Array], targets: list[Array], alpha: Array, w: float, width: float = 0.0
) -> tuple[Array, Array]:
    """S = Σ P_i H_i⁻¹ P_i and q₀ = Σ P_i H_i⁻¹ J_iᵀ b_i, H_i = J_iᵀJ_i + wI: (13a) and (13d).

    Half of min Σ |J_i x_i − b_i|² + w Σ |x_i|² with Σ P_i x_i = q̈ leaves, but for a constant,
    ½ (q̈ − q₀)ᵀ S⁺ (q̈ − q₀).
    """
    sizes, stack = [len(J) for J in jacobians], np.vstack(jacobians)
    n = stack.shape[1]
    S, q0 = np.zeros((n, n)), np.zeros(n)
    for row, J, b in zip(alpha, jacobians, targets, strict=True):
        P = projector(np.repeat(row, sizes), stack, width)
        PH = P @ np.linalg.inv(J.T @ J + w * np.eye(n))
        S += PH @ P
        q0 += P @ J.T @ np.linalg.solve(J @ J.T + w * np.eye(len(J)), b)  # H_i⁻¹ J_iᵀ b_i
    return S, q0


def optimum(
    S: Array, q0: Array, w: float, M: Array, pull: Array, G: Array, h: Array
) -> tuple[Array, float] | None:
    """Min ½ (q̈ − q₀)ᵀ S⁺ (q̈ − q₀) + w/2 |M q̈ + pull|² with G q̈ ≥ h, rows of unit length.

    With S = UᵀU and q̈ = q₀ + Uᵀy the Hessian is I + w TᵀT = KᵀK, T = M Uᵀ; with z = K (y − y*),
    y* the free optimum, it is min ½|z|² with D z ≥ d, Lawson and Hanson's LDP (1974, chapter 23):
    non-negative u with the least r = [Dᵀ; dᵀ] u − [0; 1] gives z = −r/r_last, or r = 0 where
    nothing satisfies the rows. What is active is then solved for once more by its KKT equations.

    Returns:
        q̈ (n,), and the condition number of what was solved; None where nothing satisfies G q̈ ≥ h.
    """
    value, V = np.linalg.eigh(S)
    largest = max(float(value[-1]), 1e-300)
    kept = value > SINGULAR * largest
    Ut = V[:, kept] * np.sqrt(value[kept])
    T = M @ Ut
    K = np.linalg.cholesky(np.eye(kept.sum()) + w * T.T @ T).T
    step = np.linalg.solve(K, np.eye(kept.sum()))  # K⁻¹
    free = q0 - Ut @ step @ step.T @ T.T @ (w * (M @ q0 + pull))
    D, d = G @ Ut @ step, h - G @ free
    moved = np.linalg.norm(D, axis=1) > 1e-7 * np.sqrt(largest)
    if (d > MET * (1.0 + np.abs(h)))[~moved].any():
        return None
    size = max(1.0, float(np.abs(d[moved]).max(initial=0.0)))
    E = np.vstack([D[moved].T, d[moved] / size])
    u, r = non_negative(E, np.eye(len(E))[-1])
    if np.linalg.norm(r) < 1e-9:
        return None
    on = D[moved][u > 0.0]
    z = np.linalg.lstsq(on, d[moved][u > 0.0], rcond=1e-10)[0]
    spread = np.linalg.svd(on, compute_uv=False) if on.size else np.ones(1)
    within = spread[spread > 1e-10 * spread[0]]
    least = value[kept].min(initial=largest)
    return free + Ut @ step @ z, float(within[0] / within[-1] * largest / least)


def non_negative(E: Array, f: Array) -> tuple[Array, Array]:
    """Min |E u − f| over u ≥ 0 (Lawson and Hanson's NNLS); u and E u − f."""
    scale = np.linalg.norm(E, axis=0)
    E = E / np.where(scale > 0.0, scale, 1.0)
    u, on = np.zeros(E.shape[1]), np.zeros(E.shape[1], bool)
    for _ in range(10 * E.shape[1] + 10):
        rise = np.where(on, -np.inf, E.T @ (f - E @ u))
        if not on.size or on.all() or rise.max() <= 1e-13:
            break
        on[int(np.argmax(rise))] = True
        while True:
            s = np.zeros(u.size)
            s[on] = np.linalg.lstsq(E[:, on], f, rcond=None)[0]
            if (s[on] > 0.0).all():
                break
            out = on & (s <= 0.0)
            u += np.min(u[out] / (u[out] - s[out])) * (s - u)
            on &= u > 1e-14
            u[~on] = 0.0
        u = s
    return u, E @ u - f
