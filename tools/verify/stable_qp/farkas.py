"""The most that V can fall within the constraints, proved by multipliers: (7) and Farkas' lemma.

Whatever λ ≥ 0 and μ are, −s·y ≤ λ·b + μ·c + Σ max over the bounds of −(s + Aᵀλ + Cᵀμ)_i·y_i. The
multipliers come from scipy's linprog; the bound holds even where they are not the best.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog

from hoap3.tools.verify.stable_qp.scaled import Scaled

Array = NDArray[np.float64]


def most_fall(p: Scaled, direction: float = 1.0) -> float:
    """What −s·y within all constraints does not exceed; for direction −1, s·y.

    A joint without bounds counts as if it had those of the fastest that was found. inf: nothing is
    proved; −inf: nothing keeps the constraints.
    """
    slope = direction * p.slope
    found = linprog(
        slope, p.rows, p.sides, p.equations, p.values,
        np.stack([p.lower, p.upper], axis=1), method="highs",
    )  # fmt: skip
    if found.status == 2:  # infeasible
        return -np.inf
    if found.status != 0:
        return np.inf
    held, tied = np.maximum(-found.ineqlin.marginals, 0.0), -found.eqlin.marginals
    rest = slope + held @ p.rows + tied @ p.equations
    span = 1.0 + np.abs(found.x).max()
    low, high = np.maximum(p.lower, -span), np.minimum(p.upper, span)
    return float(held @ p.sides + tied @ p.values + np.maximum(-rest * low, -rest * high).sum())


def broken(p: Scaled) -> float:
    """By how much every y within its bounds breaks some row, at the least; 0 or less: none."""
    n = p.slope.size
    A = np.vstack([p.rows, p.equations, -p.equations])
    sides = np.concatenate([p.sides, p.values, -p.values])
    A = np.hstack([A, -np.ones((len(A), 1))])
    cost = np.append(np.zeros(n), 1.0)
    bounds = [*zip(p.lower, p.upper, strict=True), (-1.0, None)]
    found = linprog(cost, A, sides, bounds=bounds, method="highs")
    return float(found.fun) if found.status == 0 else np.inf
