"""Other QP solvers of a `Program`, to compare with: osqp, proxqp, piqp and quadprog.

None is warm-started: an answer depends on its problem alone. quadprog is under the GPL, so nothing
that is shipped may need it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from importlib.util import find_spec
from typing import Any

import numpy as np
from scipy import sparse

from hoap3.remote_controller.solvers.qp.dense_qp import (
    EQUATION,
    NO_BOUND,
    Answer,
    Backend,
    Program,
    daqp,
)

Maker = Callable[[Program], Backend]

ENDS = {"osqp": 1e-7, "proxqp": 1e-9, "piqp": 1e-10}
"""Least tolerance of each: splitting and interior-point methods end near the optimum."""


def osqp(program: Program) -> Backend:
    """Operator splitting (Apache), polished; set up for each solve, not warm-started."""
    import osqp as library

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


def quadprog(program: Program) -> Backend:
    """Goldfarb and Idnani's own way (GPL), cold, with the bounds and sides that there are."""
    import quadprog as library

    v, one = program.f.size, np.eye(program.f.size)

    def solve(tolerance: float) -> Answer:
        del tolerance
        equal = program.sense == EQUATION
        lower = np.flatnonzero(~equal & (program.least > -NO_BOUND))
        upper = np.flatnonzero(~equal & (program.most < NO_BOUND))
        equations = np.flatnonzero(equal)
        all_rows, above = np.vstack((one, program.A)), np.concatenate((equations, lower))
        rows = np.vstack((all_rows[above], -all_rows[upper]))
        sides = np.concatenate((program.least[above], -program.most[upper]))
        try:
            found = library.solve_qp(program.H, -program.f, rows.T, sides, equations.size)
        except ValueError:  # "constraints are inconsistent", or H is not definite
            return False, np.full(v, np.nan), np.zeros(len(program.A))
        multipliers = np.zeros(len(all_rows))
        np.subtract.at(multipliers, above, found[4][: above.size])
        np.add.at(multipliers, upper, found[4][above.size :])
        return True, found[0], multipliers[v:]

    return solve


PEERS: dict[str, Maker] = {
    "daqp": daqp,
    "osqp": osqp,
    "proxqp": proxqp,
    "piqp": piqp,
    "quadprog": quadprog,
}
PACKAGES = {name: name for name in PEERS} | {"proxqp": "proxsuite"}
"""Name of the package of each."""


def missing(names: Iterable[str] = PEERS) -> dict[str, str]:
    """Those of some peers that are not installed, and their packages."""
    return {name: PACKAGES[name] for name in names if find_spec(PACKAGES[name]) is None}


def installed(names: Iterable[str] = PEERS) -> dict[str, Maker]:
    """Those of some peers that are, each as a call that binds it to a program."""
    absent = missing(names)
    return {name: PEERS[name] for name in names if name not in absent}
