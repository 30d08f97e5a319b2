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

from hoap3.protocol.errors import BadProblemError
from hoap3.remote_controller.solvers.base.status import (
    INFEASIBLE_CONSTRAINTS,
    OK,
    UNBOUNDED,
    UNSOLVED,
)
from hoap3.remote_controller.solvers.qp.dense_qp import EQUATION, NO_BOUND

Array = NDArray[np.float64]

INFEASIBLE, BOUNDLESS, TIRED = -1, -3, -4  # flags of daqp
STEPS = 1000  # of daqp: ten times what a vertex takes
SETTLED = 1e-10  # of W u: daqp stops where its proximal steps move by less; by default at 1e-6
BROKEN = 1e-9  # by so much a point may be beyond its limits and count as within
TOLERANCES = (1e-11, 1e-8)  # of daqp, in units of W u; the second where rounding misleads the first


class MaxDescentLp:
    """A problem's constraints, scaled (see `lyapunov_qp_kernels`), and the LP (7).

    Args:
        n: number of joints.
        m: rows of A.
        k: rows of C.
        weights: of the joints, (n,), positive; all 1 by default.
        kind: of the objective whose QP is written alongside.

    Attributes:
        n: number of joints.
        k: rows of C.
        weights: (n,).
        top: what ∇V was divided by.
        used: number of rows of A that are in use; only these are written.
        rows: of A, ∇V and C, (used + 1 + k, n), in y = W u, each of length 1, ∇V of largest
            entry 1.
        slope: that of ∇V, (n,).
        least: of y and the rows, (n + used + 1 + k,).
        most: likewise.
        qp_rows: of the QP; `qp_least` and `qp_most` are the limits of its variables and rows, and
            `qp_sense` says which are equations.
        v: where the last LP was solved, W v*, (n,).
        sure: whether nothing falls faster than it said.

    Raises:
        BadProblemError: the weights are not n positive numbers.
    """

    def __init__(
        self, n: int, m: int, k: int, weights: ArrayLike | None = None, kind: int = 2
    ) -> None:
        import daqp

        from hoap3.remote_controller.solvers.lyapunov_qp import lyapunov_qp_kernels as kernels

        self._fill, self._solve = kernels.fill_kernel, daqp.solve
        self.weights = np.ones(n) if weights is None else np.array(weights, float)
        if self.weights.shape != (n,) or not np.all((self.weights > 0) & np.isfinite(self.weights)):
            raise BadProblemError(f"weights must be {n} positive numbers, one for each joint.")
        self.n, self._kind = n, kind
        count = m + 1 + k
        self.k, self.top, self.v, self.sure = k, 0.0, np.zeros(n), True
        self._multipliers = np.zeros(count)
        extra = 2 * n if kind == kernels.MAXIMUM else 0
        variables = {kernels.NORM: 2 * n, kernels.MAXIMUM: n + 1}.get(kind, n)
        self._variables, self._extra = variables, extra
        self._rows, self._qp_rows = np.zeros((count, n)), np.zeros((count + extra, variables))
        self._least, self._most = np.zeros(n + count), np.zeros(n + count)
        self._qp_least = np.full(variables + count + extra, -NO_BOUND)
        self._qp_most = np.full(variables + count + extra, NO_BOUND)
        if extra:  # |y_i| ≤ the last variable
            one = np.eye(n)
            self._qp_rows[count:, :n] = np.vstack([one, -one])
            self._qp_rows[count:, n] = -1.0
            self._qp_most[variables + count :] = 0.0
            self._qp_least[n] = 0.0
        self._sense = np.zeros(n + count, np.int32)
        self._qp_sense = np.zeros(variables + count + extra, np.int32)
        self._use(m)

    def fill(
        self, gradient: Array, A: Array, b: Array, C: Array, c: Array, lower: Array, upper: Array
    ) -> None:
        """Write the scaled rows of a problem that `try_closed_form` found no fault with."""
        self.top, used = self._fill(
            gradient, A, b, C, c, lower, upper, self.weights, self._kind, self._rows, self._least,
            self._most, self._qp_rows, self._qp_least, self._qp_most,
        )  # fmt: skip
        if used != self.used:
            self._use(used)

    def _use(self, used: int) -> None:
        """Lay out views of so many rows of A, and what follows them."""
        n, count = self.n, used + 1 + self.k
        self.used, self.slope = used, self._rows[used]
        self.rows, self.least, self.most = (
            self._rows[:count],
            self._least[: n + count],
            self._most[: n + count],
        )
        self.sense, first = self._sense[: n + count], n + used + 1
        self.sense[n:first], self.sense[first:] = 0, EQUATION
        rows, first = count + self._extra, self._variables + used + 1
        last = self._variables + rows
        self.qp_rows, self.qp_least = self._qp_rows[:rows], self._qp_least[:last]
        self.qp_most, self.qp_sense = self._qp_most[:last], self._qp_sense[:last]
        self.qp_sense[self._variables :] = 0
        self.qp_sense[first : first + self.k] = EQUATION

    def fall(self, direction: float = 1.0, enough: float = NO_BOUND) -> tuple[int, float]:
        """Largest −s·y, s = W⁻¹∇V/top, up to `enough`; the largest s·y for direction −1.

        Where rows are within 1e-4 of parallel, the solver may not get to the vertex in time: then
        it is what the last point within all limits has, and `sure` is False.

        Returns:
            `OK` and that; `INFEASIBLE_CONSTRAINTS`: no y keeps the constraints; `UNBOUNDED`;
            `UNSOLVED`.
        """
        row = self.n + self.used
        self.least[row] = -enough if direction > 0.0 else -NO_BOUND
        self.most[row] = NO_BOUND if direction > 0.0 else enough
        slope = direction * self.slope
        flag, self.sure = 0, True
        for tolerance in TOLERANCES:
            x, _, flag, info = self._solve(
                None, slope, self.rows, self.most, self.least, self.sense,
                primal_tol=tolerance, iter_limit=STEPS, eta_prox=SETTLED,
            )  # fmt: skip
            if flag == 1 or (flag == TIRED and self.keeps(x, BROKEN)):
                self.sure = flag == 1
                self.v[:], self._multipliers = x, info["lam"][self.n :]
                return OK, -float(slope @ x)
            if flag == BOUNDLESS:
                return UNBOUNDED, math.inf
        return (INFEASIBLE_CONSTRAINTS if flag == INFEASIBLE else UNSOLVED), 0.0

    def keeps(self, y: Array, slack: float) -> bool:
        """Whether a point is within all limits, (n,) [of W u], or beyond by `slack` at most."""
        limits = self.n + len(self.rows)
        values = np.concatenate([y, self.rows @ y])
        room = np.minimum(values - self.least[:limits], self.most[:limits] - values)
        return bool(room.min() >= -slack)

    def proved(self) -> float:
        """What no −s·y within the constraints exceeds, by the multipliers of the last LP.

        It is a bound whatever they are, for s·y ≥ min (s + rowsᵀλ)·y − Σ λ_j·(its side). A joint
        without bounds counts as if it had those of the fastest that was found.
        """
        limits, multipliers = slice(self.n, None), self._multipliers
        reduced = self.slope + self.rows.T @ multipliers
        span = 1.0 + float(np.abs(self.v).max())
        least = np.where(self.least[: self.n] <= -NO_BOUND, -span, self.least[: self.n])
        most = np.where(self.most[: self.n] >= NO_BOUND, span, self.most[: self.n])
        sides = np.where(multipliers > 0.0, self.most[limits], self.least[limits])
        held = multipliers != 0.0
        lowest = np.minimum(reduced * least, reduced * most).sum()
        return -float(lowest - multipliers[held] @ sides[held])
