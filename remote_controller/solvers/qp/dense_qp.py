"""A dense QP as arrays, and daqp, which solves it.

    min  ½ xᵀH x + fᵀx   subject to   least ≤ (x, A x) ≤ most

An answer is (solved, x, multipliers of the rows of A): H x + f + Aᵀ·multipliers + those of the
bounds = 0, so a multiplier is positive where the upper side is active. There is no warm start: an
answer depends on its problem alone.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Self, TypeAlias

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Answer: TypeAlias = tuple[bool, Array, Array]
Backend: TypeAlias = Callable[[float], Answer]

EQUATION = 5  # flag of daqp for an equation
SOFT = 8  # daqp's flag of a row that may be violated
SOLVED, VIOLATED = 1, 2  # daqp's exit flags
NO_BOUND = 1e30  # daqp's infinity


@dataclass
class Program:
    """The arrays of a QP, which may be written to, or replaced, from solve to solve.

    Attributes:
        H: (v, v), positive semidefinite, and definite but for one variable at most.
        f: (v,).
        A: (r, v).
        least: of the variables and the rows, (v + r,); −1e30 is no bound.
        most: upper limits of the same; 1e30 for none.
        sense: 0, or 5 where least = most, or 8 for `daqp` of what is soft; (v + r,), int32.
    """

    H: Array
    f: Array
    A: Array
    least: Array
    most: Array
    sense: NDArray[np.int32]

    @classmethod
    def unbounded(cls, variables: int, rows: int) -> Self:
        """½|x|² with rows of zeros, and nothing that limits x or them."""
        count = variables + rows
        return cls(
            np.eye(variables),
            np.zeros(variables),
            np.zeros((rows, variables)),
            np.full(count, -NO_BOUND),
            np.full(count, NO_BOUND),
            np.zeros(count, np.int32),
        )


def daqp(program: Program, *, soft: bool = False, **settings: float) -> Backend:
    """Return a solver for a program by daqp, a dual active set (MIT licence): exact.

    Args:
        program: what is solved.
        soft: whether an answer may violate rows whose `sense` is `SOFT`, at a price.
        settings: further ones, by daqp's names.
    """
    import daqp as library

    solve_it, variables = library.solve, program.f.size

    def solve(tolerance: float) -> Answer:
        x, _, flag, info = solve_it(
            program.H,
            program.f,
            program.A,
            program.most,
            program.least,
            program.sense,
            primal_tol=tolerance,
            **settings,
        )
        return flag == SOLVED or (soft and flag == VIOLATED), x, info["lam"][variables:]

    return solve
