"""Our own dual active set for the arrays of a `Program`."""

from __future__ import annotations

import numpy as np

from hoap3.remote_controller.solvers.base import status
from hoap3.remote_controller.solvers.qp.dense_qp import Answer, Array, Program


def solve_bounded(
    H: Array, f: Array, rows: Array, lower: Array, upper: Array
) -> tuple[int, Array, Array]:
    """Minimise ½ xᵀHx − fᵀx within lower ≤ rows·x ≤ upper.

    Args:
        H: positive definite, (n, n).
        f: (n,).
        rows: (c, n), each of length 1 or 0.
        lower, upper: (c,), ∓inf where there is none.

    Returns:
        Status as of `ActiveSet.solve`; x (n,); multipliers of the rows (c,).
    """
    from hoap3.remote_controller.solvers.qp import active_set_kernels as kernels

    c, n = rows.shape
    values, multipliers = np.zeros(n + c), np.empty(n + c)
    found, _ = kernels.bounded_values_kernel(
        H.copy(),
        f.copy(),
        np.ascontiguousarray(rows),
        np.ascontiguousarray(lower),
        np.ascontiguousarray(upper),
        np.empty((n, n + c)),
        np.empty((n, n)),
        values,
        multipliers,
    )
    return found, values[:n], multipliers[n:]


class ActiveSet:
    """A `Backend` for a definite H: exact, also where equations depend on each other.

    Args:
        program: what is solved, with rows and bounds of any scale; `sense` is not looked at.
    """

    def __init__(self, program: Program) -> None:
        import hoap3.remote_controller.solvers.qp.active_set_kernels  # noqa: F401 - before a loop

        self._program = program

    def __call__(self, tolerance: float) -> Answer:
        """Whether there is a solution, x and the multipliers; the tolerance is its own."""
        del tolerance
        found, x, multipliers = self.solve()
        return found == status.OK, x, multipliers

    def solve(self) -> tuple[int, Array, Array]:
        """The solution as the arrays now are.

        Returns:
            `status.OK`, `INFEASIBLE`, `UNSOLVED`, or `BAD_INPUT` where H is not definite or
            something is not finite; x (v,); the multipliers of the rows of A (r,), positive where
            the upper side holds x back.
        """
        program = self._program
        v, r = program.f.size, len(program.A)
        if (program.least > program.most).any():
            return status.INFEASIBLE, np.zeros(v), np.zeros(r)
        V = np.vstack([np.eye(v), program.A])
        size = np.linalg.norm(V, axis=1)
        size[size == 0.0] = 1.0
        sides = program.least / size, program.most / size
        found, x, multipliers = solve_bounded(program.H, -program.f, V / size[:, None], *sides)
        return found, x, multipliers[v:] / size[v:]
