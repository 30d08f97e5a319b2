"""Problem (3), ρ and least ℓp norms in plain numpy: what the kernels are checked against.

Gonçalves et al., IEEE T-RO 2020.
"""

from __future__ import annotations

import math
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from hoap3.remote_controller.solvers.qp.reference import solve_qp

Array = NDArray[np.float64]

PARALLEL, INSIDE = 1e-9, 1e-11  # of planes with normals of length 1


def lp_norm(gradient: Array, decrease: float, p: float) -> Array:
    """(9): the u of least |u|_p with ∇V·u = −decrease, for p > 1 (∞ too), scaled to |∇V| ≤ 1."""
    top = np.abs(gradient).max()
    share = np.abs(gradient) / top
    powers = (0.0, 1.0) if math.isinf(p) else (1.0 / (p - 1.0), p / (p - 1.0))
    moves = gradient != 0.0
    size = moves * share ** powers[0] / (share[moves] ** powers[1]).sum()
    u: Array = -decrease / top * np.sign(gradient) * size
    return u


def lyapunov(
    error: Array, jacobian: Array, drift: Array, weights: Array
) -> tuple[float, Array, float]:
    """V = ½ eᵀWe, ∇V = JᵀWe (39) and, of (18), ∂V/∂t = eᵀW ∂e/∂t; W = diag(weights)."""
    W = np.diag(weights)
    return float(0.5 * error @ W @ error), jacobian.T @ W @ error, float(error @ W @ drift)


def max_descent(gradient: Array, A: Array, b: Array, lower: Array, upper: Array) -> float:
    """(7): the largest −∇V·v, at a vertex: n of the sides hold there. All bounds are finite."""
    n = gradient.size
    planes = np.vstack([np.eye(n), -np.eye(n), A])
    size = np.linalg.norm(planes, axis=1)
    planes, sides = planes / size[:, None], np.concatenate([upper, -lower, b]) / size
    chosen = np.array(list(combinations(range(len(sides)), n)))
    chosen = chosen[np.abs(np.linalg.det(planes[chosen])) > PARALLEL]
    vertices = np.linalg.solve(planes[chosen], sides[chosen][..., None])[..., 0]
    inside = (vertices @ planes.T <= sides + INSIDE).all(axis=1)
    return float((-vertices[inside] @ gradient).max())


def largest_rho(
    gradient: Array, psi: float, drift: float, A: Array, b: Array, lower: Array, upper: Array
) -> float:
    """(6) with ρ ≤ 1, from ∇V·u + ∂V/∂t = −ρΨ (18)."""
    return min(1.0, (max_descent(gradient, A, b, lower, upper) - drift) / psi)


def stable_qp(
    gradient: Array, rate: float, gamma: float, A: Array, b: Array, lower: Array, upper: Array
) -> Array | None:
    """(3) with Φ of (26) and ∇V·u = rate: u = p − m with p, m ≥ 0 makes a QP of |u|₁."""
    n, one = gradient.size, np.eye(2 * gradient.size)
    rows = np.vstack([gradient, A])
    V = np.vstack([one, np.hstack([rows, -rows])])
    least = np.concatenate([np.zeros(2 * n), [rate], np.full(b.size, -np.inf)])
    most = np.concatenate([np.maximum(upper, 0.0), np.maximum(-lower, 0.0), [rate], b])
    least[:n], least[n : 2 * n] = np.maximum(lower, 0.0), np.maximum(-upper, 0.0)
    x = solve_qp((1.0 - gamma) * one, np.full(2 * n, -gamma), V, least, most)
    return None if x is None else x[:n] - x[n:]
