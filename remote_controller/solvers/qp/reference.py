"""A strictly convex QP in plain numpy: what `active_set_kernels` is checked against.

Lawson and Hanson, Solving Least Squares Problems (1974), chapter 23: with H = LLᵀ and
y = Lᵀx − L⁻¹f the QP asks for the point of a polyhedron that is nearest to 0, and that is a
least-squares problem with coefficients that are not negative.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

Array = NDArray[np.float64]

KEPT = 1e-8  # of 1 + |x|: what is farther beyond a side has no solution


def holding_rows(G: Array, h: Array) -> NDArray[np.bool_]:
    """Which rows hold the y nearest to 0 with G y ≥ h, as (m,); nonsense where there is no y.

    (23.27): λ ≥ 0 minimises |[G h]ᵀλ − (0, …, 0, 1)|, and λ·(1 + |y|²) are the multipliers. Here h
    is divided by max|h|, which scales y: only where λ > 0 has a meaning.
    """
    E = np.vstack([G.T, h / np.abs(h).max(initial=1e-300)])
    share, _ = nnls(E, np.eye(len(E))[-1], maxiter=100 * E.shape[1])
    return np.asarray(share > 0.0) & bool((h > 0.0).any())


def solve_qp(H: Array, f: Array, V: Array, lower: Array, upper: Array) -> Array | None:
    """Minimise ½ xᵀHx − fᵀx within lower ≤ V x ≤ upper.

    Args:
        H: positive definite, (n, n).
        f: (n,).
        V: (c, n).
        lower, upper: (c,); equal ones are an equation, ∓inf is none.

    Returns:
        x, (n,); None where nothing is within all sides.
    """
    rows = np.vstack([V[lower > -np.inf], -V[upper < np.inf]])
    sides = np.concatenate([lower[lower > -np.inf], -upper[upper < np.inf]])
    size = np.linalg.norm(rows, axis=1)
    size[size == 0.0] = 1.0
    rows, sides = rows / size[:, None], sides / size
    G = np.linalg.solve(np.linalg.cholesky(H), rows.T).T
    held = holding_rows(G, sides - rows @ np.linalg.solve(H, f))
    N = rows[held]  # H x − Nᵀμ = f, N x = its sides
    kkt = np.block([[H, -N.T], [N, np.zeros((len(N), len(N)))]])
    right = np.concatenate([f, sides[held]])
    x: Array = np.linalg.lstsq(kkt, right, rcond=1e-14)[0][: f.size]
    return x if (rows @ x >= sides - KEPT * (1.0 + np.abs(x).max())).all() else None
