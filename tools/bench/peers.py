"""QP12 by us and by other people's solvers, each in its best use: set up once, updated, warm.

All solve the canonical form: min γ·1ᵀx + (1−γ)/2·|x|² such that aᵀx = b, x ≥ 0. Peers read the
equation as (a/b)ᵀx = 1, so that one row is all that changes from call to call.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.errors import UnknownNameError
from hoap3.remote_controller.solvers import Qp12
from hoap3.remote_controller.solvers.qp12.osqp_qp12 import canonical_model

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Peer:
    """A solver for n joints.

    Attributes:
        solve: takes a problem, such as a, (n,), and b, and then whatever is in `fixed`.
        fixed: further arguments, the same for every problem.
        out: where the answer is; None where `solve` returns it.
    """

    solve: Callable[..., Any]
    fixed: tuple[Any, ...] = ()
    out: Array | None = None

    def __call__(self, *problem: Any) -> Array:
        """The answer x, (n,), or −x: ours are speeds that decrease V."""
        returned: Array = self.solve(*problem, *self.fixed)
        return returned if self.out is None else self.out


def qp12(n: int, gamma: float) -> Peer:
    """Our solver as a loop uses it: with all checks, and the KKT residual of the answer."""
    out = np.zeros(n)
    return Peer(Qp12(n).solve, (gamma, out), out)


def daqp(n: int, gamma: float) -> Peer:
    """daqp, a dual active set, from the last active set."""
    import daqp as library

    model: Any = library.Model()
    rows = np.ones((1, n))
    upper, lower = np.full(n + 1, 1e30), np.zeros(n + 1)
    upper[n] = lower[n] = 1.0
    sense = np.zeros(n + 1, np.int32)
    sense[n] = 5  # an equation
    model.setup((1.0 - gamma) * np.eye(n), np.full(n, gamma), rows, upper, lower, sense)
    update, solve_it, row, divide = model.update, model.solve, rows[0], np.divide

    def solve(a: Array, b: float) -> Array:
        divide(a, b, row)
        update(A=rows)
        x: Array = solve_it()[0]
        return x

    return Peer(solve)


def osqp(n: int, gamma: float) -> Peer:
    """OSQP by its documented Python interface, from the last solution."""
    model, entries = _osqp_model(n, gamma)
    update, solve_it, row, divide = model.update, model.solve, np.zeros(n), np.divide

    def solve(a: Array, b: float) -> Array:
        divide(a, b, row)
        update(Ax=row, Ax_idx=entries)
        x: Array = solve_it(raise_error=False).x
        return x

    return Peer(solve)


def osqp_bare(n: int, gamma: float) -> Peer:
    """OSQP without its Python interface, which takes longer than the solver: as C would call it."""
    model, entries = _osqp_model(n, gamma)
    solver = model._solver
    update, solve_it, row, divide = solver.update_data_mat, solver.solve, np.zeros(n), np.divide

    def solve(a: Array, b: float) -> Array:
        divide(a, b, row)
        update(None, None, row, entries)
        solve_it()
        x: Array = solver.solution.x
        return x

    return Peer(solve)


def _osqp_model(n: int, gamma: float) -> tuple[Any, NDArray[np.int32]]:
    """OSQP set up to be quick: for 1e-4 of the largest speed, which leaves polishing out."""
    return canonical_model(n, gamma, 1.0 - gamma, 1e-5, polishing=False)


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
    "qp12": qp12,
    "daqp": daqp,
    "osqp": osqp,
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
