"""Solvers beside ours on the QP of task-space inverse dynamics, torques eliminated."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Program:
    """min ½xᵀHx + fᵀx such that lower ≤ x ≤ upper and least ≤ Ax ≤ most."""

    H: Array
    f: Array
    A: Array
    least: Array
    most: Array
    lower: Array
    upper: Array


def program(given: tuple[Any, ...], effort: Array) -> Program:
    """What `Tsid.solve` is given, as a QP."""
    jacobian, wanted, weight, posture, mass, bias, lower, upper = given
    return Program(
        jacobian.T @ jacobian + weight * np.eye(len(posture)),
        -(jacobian.T @ wanted + weight * posture),
        mass,
        -effort - bias,
        effort - bias,
        lower,
        upper,
    )


def daqp() -> Callable[[Program], Array]:
    """daqp, as its documentation calls it."""
    import daqp as library

    def solve(problem: Program) -> Array:
        most = np.concatenate((problem.upper, problem.most))
        least = np.concatenate((problem.lower, problem.least))
        sense = np.zeros(len(most), np.int32)
        x: Array = library.solve(problem.H, problem.f, problem.A, most, least, sense)[0]
        return x

    return solve


def quadprog() -> Callable[[Program], Array]:
    """quadprog, Goldfarb and Idnani."""
    import quadprog as library

    def solve(problem: Program) -> Array:
        one = np.eye(len(problem.f))
        rows = np.vstack((one, -one, problem.A, -problem.A))
        bounds = np.concatenate((problem.lower, -problem.upper, problem.least, -problem.most))
        x: Array = library.solve_qp(problem.H, -problem.f, rows.T, bounds)[0]
        return x

    return solve


def proxqp() -> Callable[[Program], Array]:
    """ProxQP, dense, with bounds as a box, from its last answer."""
    from proxsuite import proxqp as library

    solver: Any = None

    def solve(problem: Program) -> Array:
        nonlocal solver
        p = problem
        arrays = (p.H, p.f, None, None, p.A, p.least, p.most, p.lower, p.upper)
        if solver is None:
            solver = library.dense.QP(len(p.f), 0, len(p.A), True)
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


PEERS: dict[str, tuple[str, Callable[[], Callable[[Program], Array]]]] = {
    "daqp": ("daqp", daqp),
    "quadprog": ("quadprog", quadprog),
    "proxqp": ("proxsuite", proxqp),
}
"""Package and maker of each."""
