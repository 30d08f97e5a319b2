"""Task-space inverse dynamics as a QP of the accelerations (Del Prete, IEEE RA-L 2018, (33))."""

from __future__ import annotations

import math
from itertools import product

import numpy as np
from numpy.typing import NDArray

from hoap3.remote_controller.solvers.base import status
from hoap3.remote_controller.solvers.qp.active_set import ActiveSet
from hoap3.remote_controller.solvers.qp.dense_qp import Program, daqp

Array = NDArray[np.float64]

TOLERANCE = 1e-11  # of the solver: rad/s², and what that is as a torque
SOFT_TOLERANCE = 1e-9
SINGULAR = 1e-14  # daqp takes more for singular, and problems of different scales for infeasible
VIOLATION = 1e4, 1e2, 1.0
"""Weight of a torque's violation, relative to its effort, beside the task's; the next one where
the solver gives up or errs, as it may where all has different scales."""
KEPT = 1e-9  # relative: what a second answer of daqp, which errs more, may exceed
ERRS = 1e-3  # of the greatest violation: by that much the solver's may differ from the torques'


class Tsid:
    """min |y − J·ddq|² + w·|p − ddq|² within bounds, efforts and rows.

        lower ≤ ddq ≤ upper,   |M·ddq + h| ≤ effort,   rows_lower ≤ R·ddq ≤ rows_upper

    The torques τ = M·ddq + h are eliminated: n variables, n bounds and n + s rows. Where no ddq
    satisfies all, bounds and rows R are kept, and the efforts violated as little as possible:
    relative to the efforts, in squares, with a weight of `VIOLATION` beside the rest. Where bounds
    and rows R have no common point either, there is no answer, and the status says so.

    Args:
        effort: greatest torques, (n,).
        rows: s, the number of rows R.

    Attributes:
        rows: R (s, n), to be written to; at first 0.
        rows_lower, rows_upper: (s,), to be written to: ∓inf, as at first, where a row is off; equal
            where it is an equation.
        ddq, tau: the answer, (n,).
        kkt_residual: of ddq as the answer of the QP, computed without the solver; inf where it is
            none (`tsid_kernels.prove`).
    """

    def __init__(self, effort: Array, rows: int = 0) -> None:
        from hoap3.remote_controller.solvers.tsid import tsid_kernels as kernels

        n = self.n = effort.size
        self._lay_out, self._prove = kernels.lay_out, kernels.prove
        self._effort = np.ascontiguousarray(effort)
        self._program = Program.unbounded(n, n + rows)
        self.rows = self._program.A[n:]
        self.rows_lower, self.rows_upper = np.full(rows, -np.inf), np.full(rows, np.inf)
        self._attempt = daqp(self._program)
        self._insist = daqp(self._program, sing_tol=SINGULAR)
        self._soft = Program.unbounded(2 * n, n + rows)
        self._soften = [daqp(self._soft, sing_tol=SINGULAR)]
        self._none = np.zeros(n + rows)
        self._given = rows > 0
        if self._given:  # where equations among them depend on each other, daqp may give up
            self._soften.append(ActiveSet(self._soft))
            self._nearest = Program.unbounded(n, rows)
            self._nearest.A = self.rows
            self._find_nearest = ActiveSet(self._nearest)
        self.ddq, self.tau = np.zeros(n), np.zeros(n)
        self.kkt_residual = 0.0

    def solve(
        self,
        jacobian: Array,
        wanted: Array,
        weight: float,
        posture: Array,
        mass: Array,
        bias: Array,
        lower: Array,
        upper: Array,
    ) -> int:
        """Find ddq and τ; all arrays are contiguous and finite.

        Args:
            jacobian, wanted: J (m, n) and y (m,).
            weight: w > 0.
            posture: p (n,).
            mass, bias: M (n, n) and h (n,).
            lower, upper: of ddq, (n,), lower ≤ upper; ∓1e30 is no bound.

        Returns:
            `status.OK`; `INFEASIBLE` where efforts are too small for bounds and rows and ddq is the
            fallback; `INFEASIBLE_CONSTRAINTS` where bounds and rows have no common point, and
            `UNSOLVED` where the solver gave up or erred: there ddq is p within the bounds.
        """
        program = self._program
        self._lay_out(
            jacobian,
            wanted,
            weight,
            posture,
            bias,
            self._effort,
            lower,
            upper,
            self.rows_lower,
            self.rows_upper,
            program.H,
            program.f,
            program.least,
            program.most,
            program.sense,
        )
        if self._given:
            program.A[: self.n] = mass
        else:
            program.A = mass
        solved, x, multipliers = self._attempt(TOLERANCE)
        if not solved or (self._given and not self._keeps(x)):
            solved, x, multipliers = self._insist(TOLERANCE)
            solved = solved and self._keeps(x)
        found = status.OK
        if not solved:
            multipliers = self._none
            found, x = self._fall_back(posture)
        self.kkt_residual = self._prove(
            x,
            multipliers,
            program.H,
            program.f,
            mass,
            bias,
            self._effort,
            lower,
            upper,
            self.rows,
            self.rows_lower,
            self.rows_upper,
            solved,
            self.ddq,
            self.tau,
        )
        return found

    def _keeps(self, ddq: Array) -> bool:
        """Whether ddq is within bounds and rows, its torques within the efforts; but for rounding.

        Rounding of a row R counts as that of the accelerations in it.
        """
        hard, size = self._program, 1.0 + np.abs(ddq)
        both = np.concatenate([ddq, hard.A @ ddq])
        slack = KEPT * np.concatenate([size, self._effort, np.abs(self.rows) @ size])
        return bool(((both >= hard.least - slack) & (both <= hard.most + slack)).all())

    def _fall_back(self, posture: Array) -> tuple[int, Array]:
        """Least violation of the torques, then the task; bounds of ddq and rows are kept.

        The variables are ddq and s, with rows M·ddq − effort·s/√P and the cost ½·|s|²·largest H.
        """
        hard, soft, n = self._program, self._soft, self.n
        if self._given and self._contradictory():
            return status.INFEASIBLE_CONSTRAINTS, posture
        largest = float(hard.H.diagonal().max())
        soft.H[:n, :n], soft.f[:n] = hard.H, hard.f
        soft.H.flat[n * (2 * n + 1) :: 2 * n + 1] = largest
        soft.A[:, :n] = hard.A
        for mine, theirs in ((soft.least, hard.least), (soft.most, hard.most)):
            mine[:n], mine[2 * n :] = theirs[:n], theirs[n:]
        soft.sense[:n], soft.sense[2 * n :] = hard.sense[:n], hard.sense[n:]
        for weight, soften in product(VIOLATION, self._soften):
            soft.A[:n].flat[n :: 2 * n + 1] = -self._effort / math.sqrt(weight)
            solved, x, _ = soften(SOFT_TOLERANCE)
            ddq = np.clip(x[:n], soft.least[:n], soft.most[:n])
            if solved and self._meant(ddq, np.abs(x[n:]) / math.sqrt(weight)):
                return status.INFEASIBLE, ddq
        return status.UNSOLVED, posture

    def _meant(self, ddq: Array, violation: Array) -> bool:
        """Whether ddq keeps the rows, and its torques violate their efforts as the solver says."""
        hard, n = self._program, self.n
        tau = hard.A[:n] @ ddq
        beyond = np.maximum(tau - hard.most[n : 2 * n], hard.least[n : 2 * n] - tau) / self._effort
        true = np.maximum(0.0, beyond)
        meant = np.abs(true - violation).max() <= ERRS * true.max() + SOFT_TOLERANCE
        if not self._given:
            return bool(meant)
        values, slack = self.rows @ ddq, KEPT * (np.abs(self.rows) @ (1.0 + np.abs(ddq)))
        kept = (values >= hard.least[2 * n :] - slack) & (values <= hard.most[2 * n :] + slack)
        return bool(meant and kept.all())

    def _contradictory(self) -> bool:
        """Whether no ddq is within bounds and rows: the one nearest to 0 is looked for."""
        hard, nearest, n = self._program, self._nearest, self.n
        for mine, theirs in ((nearest.least, hard.least), (nearest.most, hard.most)):
            mine[:n], mine[n:] = theirs[:n], theirs[2 * n :]
        return self._find_nearest.solve()[0] == status.INFEASIBLE
