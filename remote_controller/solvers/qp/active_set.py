"""Our own dual active set for the arrays of a `Program`."""

from __future__ import annotations

import numpy as np

from hoap3.remote_controller.solvers.base import status
from hoap3.remote_controller.solvers.qp.qp_backends import Answer, Array, Program


class ActiveSet:
    """A `Backend` for a definite H: exact, also where equations depend on each other.

    Args:
        program: what is solved, with rows and bounds of any scale; `sense` is not looked at.
    """

    def __init__(self, program: Program) -> None:
        from hoap3.remote_controller.solvers.qp import active_set_kernels as kernels

        self._program, self._kernel = program, kernels.bounded_values_kernel

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
        values, multipliers = np.zeros(2 * v + r), np.empty(2 * v + r)
        found, _ = self._kernel(
            program.H.copy(),
            -program.f,
            V / size[:, None],
            program.least / size,
            program.most / size,
            np.empty((v, 2 * v + r)),
            np.empty((v, v)),
            values,
            multipliers,
        )
        return found, values[:v], multipliers[2 * v :] / size[v:]
