"""The most that something can be within the constraints, proved by multipliers: Farkas' lemma.

Whatever λ ≥ 0 and μ are, g·y ≤ λ·b + μ·c + Σ max over the bounds of (g − Aᵀλ − Cᵀμ)_i·y_i. The
multipliers come from scipy's linprog; the bound holds even where they are not the best.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog

from support.oracles.stable_qp_arrays.scaled import Scaled

Array = NDArray[np.float64]

CLOSE = {"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10}
INFEASIBLE, UNBOUNDED = 2, 3  # scipy's words


@dataclass(frozen=True)
class Sides:
    """A y ≤ b, C y = c, lower ≤ y ≤ upper."""

    A: Array
    b: Array
    C: Array
    c: Array
    lower: Array
    upper: Array

    @classmethod
    def of(cls, p: Scaled) -> Sides:
        """Those of a problem."""
        return cls(p.rows, p.sides, p.equations, p.values, p.lower, p.upper)


class Most(NamedTuple):
    """What g·y does not exceed.

    Attributes:
        bound: inf: nothing is proved, or there is no end; −inf: nothing keeps the sides.
        pull: by how much more it is for sides that give way by 1: the sum of all multipliers.
        span: the largest entry of the y that has the most.
    """

    bound: float
    pull: float = 0.0
    span: float = 0.0


def most(g: Array, sides: Sides) -> Most:
    """What g·y within all sides does not exceed.

    A joint without bounds counts as if it had those of the fastest that was found.

    Args:
        g: (n,), of the size of 1.
        sides: of y.
    """
    bounds = np.stack([sides.lower, sides.upper], axis=1)
    found = linprog(
        -g, sides.A, sides.b, sides.C, sides.c, bounds, method="highs", options=CLOSE
    )  # fmt: skip
    if found.status:
        return Most(-np.inf if found.status == INFEASIBLE else np.inf)
    held, tied = np.maximum(-found.ineqlin.marginals, 0.0), -found.eqlin.marginals
    rest = g - held @ sides.A - tied @ sides.C
    span = 1.0 + np.abs(found.x).max()
    low, high = np.maximum(sides.lower, -span), np.minimum(sides.upper, span)
    bound = held @ sides.b + tied @ sides.c + np.maximum(rest * low, rest * high).sum()
    pull = held.sum() + np.abs(tied).sum() + np.abs(rest).sum()
    return Most(float(bound), float(pull), float(span - 1.0))


def most_fall(p: Scaled) -> Most:
    """What −s·y within all constraints does not exceed."""
    return most(-p.slope, Sides.of(p))


def broken(p: Scaled) -> float:
    """By how much every y within its bounds breaks some row, at the least; 0 or less: none."""
    A = np.vstack([p.rows, p.equations, -p.equations])
    sides = np.concatenate([p.sides, p.values, -p.values])
    A = np.hstack([A, -np.ones((len(A), 1))])
    cost = np.append(np.zeros(p.slope.size), 1.0)
    bounds = [*zip(p.lower, p.upper, strict=True), (-1.0, None)]
    found = linprog(cost, A, sides, bounds=bounds, method="highs", options=CLOSE)
    return float(found.fun) if found.status == 0 else np.inf
