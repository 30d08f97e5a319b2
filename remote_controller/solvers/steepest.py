"""How fast V can fall at the most: the LP (7), and ρ* from it.

    min  ∇V·v   subject to   A v ≤ b,  C v = c,  lower ≤ v ≤ upper

Gonçalves et al., IEEE T-RO 2020, (6) and (7). Their (6) has no solution where the constraints do
not bound the fall of V, and 0/0 where Ψ = 0; with ρ ≤ 1 added it is always bounded, gives
min(1, ρ*) at once, and 1 where nothing is asked for.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from protocol.errors import BadProblemError
from remote_controller.solvers.arrays import array
from remote_controller.solvers.status import CONTRADICTORY, OK, UNBOUNDED, UNSOLVED

Array = NDArray[np.float64]

NO_BOUND = 1e30
EQUATION = 5  # daqp's word for it
INFEASIBLE, BOUNDLESS = -1, -3  # flags of daqp
TOLERANCES = (1e-11, 1e-8)  # of daqp, in units of W u; the second where rounding misleads the first


class Steepest:
    """A problem's constraints, scaled (see `stable_kernels`), and the LP (7).

    Args:
        n: number of joints.
        m: rows of A.
        k: rows of C.
        weights: of the joints, (n,), positive; all 1 by default.
        kind: of the objective whose QP is written alongside.

    Attributes:
        n: number of joints.
        m: rows of A.
        weights: (n,).
        top: what ∇V was divided by.
        rows: of A, ∇V and C, (m + 1 + k, n), in y = W u, each of length 1, ∇V of largest entry 1.
        least: of y and the rows, (n + m + 1 + k,).
        most: likewise.
        qp_rows: of the QP; `qp_least` and `qp_most` are the limits of its variables and rows.
        v: where the last LP was solved, W v*, (n,).

    Raises:
        BadProblemError: the weights are not n positive numbers.
    """

    def __init__(
        self, n: int, m: int, k: int, weights: ArrayLike | None = None, kind: int = 2
    ) -> None:
        import daqp  # noqa: PLC0415 - only where somebody needs it

        from remote_controller.solvers import stable_kernels as kernels  # noqa: PLC0415 (compiles)

        self._fill, self._solve = kernels.fill_kernel, daqp.solve
        self.weights = np.ones(n) if weights is None else array("weights", weights, 1).copy()
        if self.weights.shape != (n,) or not np.all((self.weights > 0) & np.isfinite(self.weights)):
            raise BadProblemError(f"weights must be {n} positive numbers, one for each joint.")
        self.n, self.m, self._kind = n, m, kind
        count = m + 1 + k
        self.top, self.v = 0.0, np.zeros(n)
        self.rows = np.zeros((count, n))
        self.least, self.most = np.zeros(n + count), np.zeros(n + count)
        extra = 2 * n if kind == kernels.MAXIMUM else 0
        variables = {kernels.NORM: 2 * n, kernels.MAXIMUM: n + 1}.get(kind, n)
        self.qp_rows = np.zeros((count + extra, variables))
        self.qp_least = np.full(variables + count + extra, -NO_BOUND)
        self.qp_most = np.full(variables + count + extra, NO_BOUND)
        if extra:  # |y_i| ≤ the last variable
            one = np.eye(n)
            self.qp_rows[count:, :n] = np.vstack([one, -one])
            self.qp_rows[count:, n] = -1.0
            self.qp_most[variables + count :] = 0.0
            self.qp_least[n] = 0.0
        self._sense = np.zeros(n + count, np.int32)
        self._sense[n + m + 1 :] = EQUATION

    def fill(
        self, gradient: Array, A: Array, b: Array, C: Array, c: Array, lower: Array, upper: Array
    ) -> None:
        """Write the scaled rows of a problem that `cheap_kernel` found no fault with."""
        self.top = self._fill(
            gradient, A, b, C, c, lower, upper, self.weights, self._kind, self.rows, self.least,
            self.most, self.qp_rows, self.qp_least, self.qp_most,
        )  # fmt: skip

    def fall(self, direction: float = 1.0, enough: float = NO_BOUND) -> tuple[int, float]:
        """Largest −s·y, s = W⁻¹∇V/top, up to `enough`; the largest s·y for direction −1.

        Returns:
            `OK` and that; `CONTRADICTORY`: no y keeps the constraints; `UNBOUNDED`; `UNSOLVED`.
        """
        row = self.n + self.m
        self.least[row] = -enough if direction > 0.0 else -NO_BOUND
        self.most[row] = NO_BOUND if direction > 0.0 else enough
        slope = direction * self.rows[self.m]
        flag = 0
        for tolerance in TOLERANCES:
            x, _, flag, _ = self._solve(
                None, slope, self.rows, self.most, self.least, self._sense, primal_tol=tolerance
            )
            if flag == 1:
                self.v[:] = x
                return OK, -float(slope @ x)
            if flag == BOUNDLESS:
                return UNBOUNDED, math.inf
        return (CONTRADICTORY if flag == INFEASIBLE else UNSOLVED), 0.0
