"""QP12 by other people's solvers, each in its best use: set up once, updated, warm-started.

All solve the canonical form: min γ·1ᵀx + (1−γ)/2·|x|² such that aᵀx = b, x ≥ 0.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from protocol.errors import UnknownNameError
from remote_controller.solvers import Qp12
from remote_controller.solvers.osqp_qp12 import OsqpQp12

Array = NDArray[np.float64]
Solve = Callable[[Array, float], Array]
"""Coefficients a, (n,), and b to x, (n,)."""


def ours(n: int, gamma: float) -> Solve:
    """Our compiled kernel, as the loop calls it."""
    solver, out = Qp12(n), np.zeros(n)

    def solve(a: Array, b: float) -> Array:
        solver.solve(a, b, gamma, out)
        return out

    return solve


def osqp(n: int, gamma: float) -> Solve:
    """OSQP, polished, from the last solution."""
    solver, out = OsqpQp12(n), np.zeros(n)

    def solve(a: Array, b: float) -> Array:
        solver.solve(a, b, gamma, out)
        return out

    return solve


def daqp(n: int, gamma: float) -> Solve:
    """daqp, a dual active set, from the last active set."""
    import daqp as library  # noqa: PLC0415 - each peer only where it is asked for

    model: Any = library.Model()
    row = np.ones((1, n))
    upper = np.full(n + 1, 1e30)
    lower = np.zeros(n + 1)
    upper[n] = lower[n] = 1.0
    sense = np.zeros(n + 1, np.int32)
    sense[n] = 5  # an equation
    model.setup((1.0 - gamma) * np.eye(n), np.full(n, gamma), row, upper, lower, sense)

    def solve(a: Array, b: float) -> Array:
        row[0] = a
        upper[n] = lower[n] = b
        model.update(A=row, bupper=upper, blower=lower)
        x: Array = model.solve()[0]
        return x

    return solve


def quadprog(n: int, gamma: float) -> Solve:
    """quadprog, Goldfarb and Idnani; it knows no warm start."""
    import quadprog as library  # noqa: PLC0415

    hessian, linear = (1.0 - gamma) * np.eye(n), np.full(n, -gamma)
    constraints = np.hstack([np.ones((n, 1)), np.eye(n)])
    bounds = np.zeros(n + 1)

    def solve(a: Array, b: float) -> Array:
        constraints[:, 0] = a
        bounds[0] = b
        x: Array = library.solve_qp(hessian, linear, constraints, bounds, 1)[0]
        return x

    return solve


def proxqp(n: int, gamma: float) -> Solve:
    """ProxQP, dense, with bounds as a box, from the last solution."""
    from proxsuite import proxqp as library  # noqa: PLC0415

    solver: Any = library.dense.QP(n, 1, 0, True)
    solver.settings.eps_abs = 1e-9
    solver.settings.initial_guess = library.InitialGuess.WARM_START_WITH_PREVIOUS_RESULT
    row, target = np.ones((1, n)), np.ones(1)
    far = np.full(n, 1e20)
    solver.init(
        (1.0 - gamma) * np.eye(n), np.full(n, gamma), row, target, None, None, None,
        np.zeros(n), far,
    )  # fmt: skip
    solver.solve()

    def solve(a: Array, b: float) -> Array:
        row[0], target[0] = a, b
        solver.update(A=row, b=target)
        solver.solve()
        x: Array = solver.results.x
        return x

    return solve


PEERS: dict[str, Callable[[int, float], Solve]] = {
    "qp12": ours,
    "daqp": daqp,
    "osqp": osqp,
    "quadprog": quadprog,
    "proxqp": proxqp,
}
OPTIONAL = {"quadprog", "proxqp"}


def peer(name: str, n: int, gamma: float) -> Solve | None:
    """A solver by name, or None where an optional one is not installed.

    Raises:
        UnknownNameError: there is no such solver.
    """
    if name not in PEERS:
        raise UnknownNameError("solver", name, PEERS)
    try:
        return PEERS[name](n, gamma)
    except ImportError:
        if name in OPTIONAL:
            return None
        raise
