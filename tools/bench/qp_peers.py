"""Other people's solvers for quadratic programs, each as its documentation calls it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

FAR = 1e30
"""A bound that is none, daqp's infinity."""

EQUATION = 5  # daqp's word


@dataclass(frozen=True)
class Program:
    """min ½xᵀHx + fᵀx such that lower ≤ x ≤ upper and least ≤ Ax ≤ most, `equal` rows equations."""

    H: Array
    f: Array
    A: Array
    least: Array
    most: Array
    lower: Array
    upper: Array
    equal: int


Solve = Callable[[Any], Array]


def daqp() -> Solve:
    """daqp, cold: every entry of the program may be another one at the next call."""
    import daqp as library

    def solve(it: Program) -> Array:
        most, least = np.concatenate((it.upper, it.most)), np.concatenate((it.lower, it.least))
        sense = np.zeros(most.size, np.int32)
        sense[it.f.size : it.f.size + it.equal] = EQUATION
        x: Array = library.solve(it.H, it.f, it.A, most, least, sense)[0]
        return x

    return solve


def quadprog() -> Solve:
    """quadprog, Goldfarb and Idnani, cold, with the bounds that there are."""
    import quadprog as library

    def solve(it: Program) -> Array:
        held = np.flatnonzero(it.upper < FAR)
        one = np.zeros((held.size, it.f.size))
        one[np.arange(held.size), held] = 1.0
        more, e = it.A[it.equal :], it.equal
        rows = np.vstack((it.A[:e], more, -more, one, -one))
        sides = (it.least, -it.most[e:], it.lower[held], -it.upper[held])
        x: Array = library.solve_qp(it.H, -it.f, rows.T, np.concatenate(sides), e)[0]
        return x

    return solve


def proxqp() -> Solve:
    """ProxQP, dense, of inequalities and a box, from its last answer."""
    from proxsuite import proxqp as library

    solver: Any = None

    def solve(it: Program) -> Array:
        nonlocal solver
        arrays = (it.H, it.f, None, None, it.A, it.least, it.most, it.lower, it.upper)
        if solver is None:
            solver = library.dense.QP(len(it.f), 0, len(it.A), True)
            solver.settings.eps_abs = 1e-9
            guess = library.InitialGuess.WARM_START_WITH_PREVIOUS_RESULT
            solver.settings.initial_guess = guess
            solver.init(*arrays)
        else:
            solver.update(*arrays)
        solver.solve()
        x: Array = solver.results.x
        return x

    return solve


PEERS: dict[str, tuple[str, Callable[[], Solve]]] = {
    "daqp": ("daqp", daqp),
    "quadprog": ("quadprog", quadprog),
    "proxqp": ("proxsuite", proxqp),
}
"""Package and maker of each."""
