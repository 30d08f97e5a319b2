"""QP solvers behind one call: daqp, which loops use, and peers to compare it with.

    min  ½ xᵀH x + fᵀx   subject to   least ≤ (x, A x) ≤ most

Each answers (solved, x, multipliers of the rows of A): H x + f + Aᵀ·multipliers + those of the
bounds = 0, so a multiplier is positive where the upper side holds x back. None is warm-started: an
answer depends on its problem alone, whatever was solved before.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.errors import NotInstalledError, UnknownNameError

Array = NDArray[np.float64]
Answer: TypeAlias = tuple[bool, Array, Array]
Backend: TypeAlias = Callable[[float], Answer]

EQUATION = 5  # daqp's word for it
SOFT = 8  # likewise, for a row that may be violated
SOLVED, VIOLATED = 1, 2  # what daqp says of an answer
NO_BOUND = 1e30  # likewise
ENDS = {"daqp": 0.0, "osqp": 1e-7, "proxqp": 1e-9, "piqp": 1e-10}
"""Each one's tolerance at the least: splitting and interior-point methods end near the optimum."""


@dataclass
class Program:
    """The arrays of a QP, which may be written to, or replaced, from solve to solve.

    Attributes:
        H: (v, v), positive semidefinite, and definite but for one variable at most.
        f: (v,).
        A: (r, v).
        least: of the variables and the rows, (v + r,); −1e30 is no bound.
        most: likewise, 1e30.
        sense: 0, or 5 where least = most, or 8 for `daqp` of what is soft; (v + r,), int32.
    """

    H: Array
    f: Array
    A: Array
    least: Array
    most: Array
    sense: NDArray[np.int32]


def daqp(program: Program, *, soft: bool = False, **settings: float) -> Backend:
    """A dual active set (MIT licence): exact, and the only one that no vertex confuses.

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


def osqp(program: Program) -> Backend:
    """Operator splitting (Apache), polished; set up anew, as its answers depend on the past."""
    import osqp as library
    from scipy import sparse

    variables = program.f.size
    solved = library.SolverStatus.OSQP_SOLVED

    def solve(tolerance: float) -> Answer:
        model: Any = library.OSQP()
        model.setup(
            P=sparse.csc_matrix(np.triu(program.H)),
            q=program.f,
            A=sparse.vstack([sparse.eye(variables), sparse.csc_matrix(program.A)], "csc"),
            l=np.where(program.least <= -NO_BOUND, -np.inf, program.least),
            u=np.where(program.most >= NO_BOUND, np.inf, program.most),
            verbose=False,
            eps_abs=max(tolerance, ENDS["osqp"]),
            eps_rel=max(tolerance, ENDS["osqp"]),
            polishing=True,
            max_iter=20_000,
        )
        result = model.solve(raise_error=False)
        fine = result.info.status_val == solved
        return fine, np.asarray(result.x), np.asarray(result.y)[variables:]

    return solve


def proxqp(program: Program) -> Backend:
    """Proximal augmented Lagrangian (BSD), dense, with bounds as a box."""
    from proxsuite import proxqp as library

    variables = program.f.size
    solved = library.QPSolverOutput.PROXQP_SOLVED

    def solve(tolerance: float) -> Answer:
        equal = program.sense[variables:] == EQUATION
        least, most = program.least, program.most
        model: Any = library.dense.QP(variables, int(equal.sum()), int((~equal).sum()), True)
        model.settings.eps_abs, model.settings.eps_rel = max(tolerance, ENDS["proxqp"]), 0.0
        model.init(
            program.H,
            program.f,
            program.A[equal],
            most[variables:][equal],
            program.A[~equal],
            least[variables:][~equal],
            most[variables:][~equal],
            least[:variables],
            most[:variables],
        )
        model.solve()
        multipliers = np.zeros(program.A.shape[0])
        multipliers[equal] = model.results.y
        multipliers[~equal] = np.asarray(model.results.z)[: int((~equal).sum())]
        return model.results.info.status == solved, np.asarray(model.results.x), multipliers

    return solve


def piqp(program: Program) -> Backend:
    """Proximal interior point (BSD), dense."""
    import piqp as library

    variables = program.f.size

    def solve(tolerance: float) -> Answer:
        equal = program.sense[variables:] == EQUATION
        least = np.where(program.least <= -NO_BOUND, -np.inf, program.least)
        most = np.where(program.most >= NO_BOUND, np.inf, program.most)
        model: Any = library.DenseSolver()
        model.settings.eps_abs, model.settings.eps_rel = max(tolerance, ENDS["piqp"]), 0.0
        model.setup(
            program.H,
            program.f,
            program.A[equal],
            most[variables:][equal],
            program.A[~equal],
            least[variables:][~equal],
            most[variables:][~equal],
            least[:variables],
            most[:variables],
        )
        status = model.solve()
        multipliers = np.zeros(program.A.shape[0])
        multipliers[equal] = model.result.y
        multipliers[~equal] = np.asarray(model.result.z_u) - np.asarray(model.result.z_l)
        return status == library.PIQP_SOLVED, np.asarray(model.result.x), multipliers

    return solve


BACKENDS: dict[str, Callable[[Program], Backend]] = {
    "daqp": daqp,
    "osqp": osqp,
    "proxqp": proxqp,
    "piqp": piqp,
}
PACKAGES = {"daqp": "daqp", "osqp": "osqp", "proxqp": "proxsuite", "piqp": "piqp"}


def installed() -> list[str]:
    """Names of the solvers that can be used, daqp first."""
    return [name for name in BACKENDS if find_spec(PACKAGES[name]) is not None]


def backend(name: str, program: Program) -> Backend:
    """A solver by name, for one program.

    Raises:
        UnknownNameError: there is no such solver.
        NotInstalledError: there is, but its package is not installed.
    """
    if name not in BACKENDS:
        raise UnknownNameError("QP solver", name, BACKENDS)
    if name not in installed():
        raise NotInstalledError("QP solver", name, PACKAGES[name], installed())
    return BACKENDS[name](program)
