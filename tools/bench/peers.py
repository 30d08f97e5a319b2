"""QP12 by our solver, daqp and OSQP, each in its best use: set up once, updated, warm.

All solve the canonical form: min γ·1ᵀx + (1−γ)/2·|x|² such that aᵀx = b, x ≥ 0. Peers read the
equation as (a/b)ᵀx = 1, so that one row is all that changes from call to call.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

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
    model, entries = osqp_model(n, gamma)
    update, solve_it, row, divide = model.update, model.solve, np.zeros(n), np.divide

    def solve(a: Array, b: float) -> Array:
        divide(a, b, row)
        update(Ax=row, Ax_idx=entries)
        x: Array = solve_it(raise_error=False).x
        return x

    return Peer(solve)


def osqp_model(n: int, gamma: float) -> tuple[Any, NDArray[np.int32]]:
    """OSQP set up to be quick: for 1e-4 of the largest speed, which leaves polishing out."""
    return canonical_model(n, gamma, 1.0 - gamma, 1e-5, polishing=False)


PEERS: dict[str, Callable[[int, float], Peer]] = {"qp12": qp12, "daqp": daqp, "osqp": osqp}
