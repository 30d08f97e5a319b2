"""All solvers of a `Program` that controllers can have, and quadprog, to compare them with.

quadprog is under the GPL, so nothing that is shipped may need it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from importlib.util import find_spec

import numpy as np

from hoap3.remote_controller.solvers.qp import qp_backends
from hoap3.remote_controller.solvers.qp.qp_backends import (
    EQUATION,
    NO_BOUND,
    Answer,
    Backend,
    Program,
)

Maker = Callable[[Program], Backend]


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


PEERS: dict[str, Maker] = {**qp_backends.BACKENDS, "quadprog": quadprog}
PACKAGES = {**qp_backends.PACKAGES, "quadprog": "quadprog"}
"""Name of the package of each."""


def missing(names: Iterable[str] = PEERS) -> dict[str, str]:
    """Those of some peers that are not installed, and their packages."""
    return {name: PACKAGES[name] for name in names if find_spec(PACKAGES[name]) is None}


def installed(names: Iterable[str] = PEERS) -> dict[str, Maker]:
    """Those of some peers that are, each as a call that binds it to a program."""
    absent = missing(names)
    return {name: PEERS[name] for name in names if name not in absent}
