"""More solvers of QP12 than `hoap3 bench solvers` has."""

from __future__ import annotations

from collections.abc import Callable
from importlib.util import find_spec
from typing import Any

import numpy as np

from hoap3.protocol.errors import UnknownNameError
from hoap3.tools.bench import peers
from hoap3.tools.bench.peers import Array, Peer, osqp_model


def osqp_bare(n: int, gamma: float) -> Peer:
    """OSQP without its Python interface, which takes longer than the solver: as C would call it."""
    model, entries = osqp_model(n, gamma)
    solver = model._solver
    update, solve_it, row, divide = solver.update_data_mat, solver.solve, np.zeros(n), np.divide

    def solve(a: Array, b: float) -> Array:
        divide(a, b, row)
        update(None, None, row, entries)
        solve_it()
        x: Array = solver.solution.x
        return x

    return Peer(solve)


def quadprog(n: int, gamma: float) -> Peer:
    """quadprog, Goldfarb and Idnani; it knows no warm start, but takes H already factorised."""
    import quadprog as library

    root = np.eye(n) / np.sqrt(1.0 - gamma)  # R⁻¹ of H = RᵀR
    linear, constraints = np.full(n, -gamma), np.hstack([np.ones((n, 1)), np.eye(n)])
    bounds = np.zeros(n + 1)
    bounds[0] = 1.0
    row, divide, solve_it = constraints[:, 0], np.divide, library.solve_qp

    def solve(a: Array, b: float) -> Array:
        divide(a, b, row)
        x: Array = solve_it(root, linear, constraints, bounds, 1, True)[0]
        return x

    return Peer(solve)


def proxqp(n: int, gamma: float) -> Peer:
    """ProxQP, dense, with bounds as a box, from the last solution."""
    from proxsuite import proxqp as library

    box, hessian = True, (1.0 - gamma) * np.eye(n)
    solver: Any = library.dense.QP(n, 1, 0, box, library.dense.HessianType.Diagonal)
    solver.settings.eps_abs = 1e-5
    solver.settings.initial_guess = library.InitialGuess.WARM_START_WITH_PREVIOUS_RESULT
    rows, target = np.ones((1, n)), np.ones(1)
    nothing, far = np.zeros(n), np.full(n, 1e20)
    solver.init(hessian, np.full(n, gamma), rows, target, None, None, None, nothing, far)
    solver.solve()
    row, divide, results = rows[0], np.divide, solver.results

    def solve(a: Array, b: float) -> Array:
        divide(a, b, row)
        solver.update(A=rows, update_preconditioner=False)
        solver.solve()
        x: Array = results.x
        return x

    return Peer(solve)


PEERS: dict[str, Callable[[int, float], Peer]] = {
    **peers.PEERS,
    "osqp_bare": osqp_bare,
    "quadprog": quadprog,
    "proxqp": proxqp,
}
OPTIONAL = {"quadprog": "quadprog", "proxqp": "proxsuite"}
"""Peers that need not be installed, and the packages that have them."""


def missing() -> dict[str, str]:
    """Optional peers that are not installed, and their packages."""
    return {name: package for name, package in OPTIONAL.items() if find_spec(package) is None}


def installed() -> list[str]:
    """Names of the solvers that can be raced, ours first."""
    absent = missing()
    return [name for name in PEERS if name not in absent]


def peer(name: str, n: int, gamma: float) -> Peer:
    """A solver by name.

    Raises:
        UnknownNameError: there is no such solver, or it is not installed.
    """
    known = installed()
    if name not in known:
        raise UnknownNameError("solver", name, known)
    return PEERS[name](n, gamma)
