"""Task-space inverse dynamics as a QP of the accelerations (Del Prete, IEEE RA-L 2018, (33))."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from hoap3.remote_controller.solvers.base import status
from hoap3.remote_controller.solvers.qp.qp_backends import Program, daqp

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
    """min |y − J·ddq|² + w·|p − ddq|² such that lower ≤ ddq ≤ upper and |M·ddq + h| ≤ effort.

    The torques τ = M·ddq + h are eliminated: n variables, n bounds and n rows. Where no ddq
    satisfies both, the bounds are kept, and the efforts violated as little as possible: relative to
    the efforts, in squares, with a weight of `VIOLATION` beside the rest.

    Args:
        effort: greatest torques, (n,).
        scale: of ddq, (n,): what margins are relative to.

    Attributes:
        ddq, tau: the answer, (n,).
        kkt_residual: of ddq as the answer of the QP, computed without the solver; inf where it is
            none (`tsid_kernels.prove`).
        margin: least distance from a bound, relative to `scale` or the effort; 0 where one is
            reached, negative where a torque exceeds its effort.
        torque_margin: that of the torques alone.
        held: whether a bound of ddq is reached.
    """

    def __init__(self, effort: Array, scale: Array) -> None:
        from hoap3.remote_controller.solvers.tsid import tsid_kernels as kernels

        n = self.n = effort.size
        self._lay_out, self._prove = kernels.lay_out, kernels.prove
        self._effort, self._scale = np.ascontiguousarray(effort), np.ascontiguousarray(scale)
        self._program = _program(n, n)
        self._attempt = daqp(self._program)
        self._insist = daqp(self._program, sing_tol=SINGULAR)
        self._soft = _program(n, 2 * n)
        self._soften = daqp(self._soft, sing_tol=SINGULAR)
        self._none = np.zeros(n)
        self.ddq, self.tau = np.zeros(n), np.zeros(n)
        self.kkt_residual = self.margin = self.torque_margin = 0.0
        self.held = False

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
            `status.OK`; `INFEASIBLE` where efforts are too small for the bounds and ddq is the
            fallback; `UNSOLVED` where the solver gave up or erred and ddq is p within the bounds.
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
            program.H,
            program.f,
            program.least,
            program.most,
            program.sense,
        )
        program.A = mass
        solved, x, multipliers = self._attempt(TOLERANCE)
        if not solved:
            solved, x, multipliers = self._insist(TOLERANCE)
            solved = solved and self._keeps(x)
        found = status.OK
        if not solved:
            multipliers = self._none
            found, x = self._fall_back(posture)
        self.kkt_residual, self.margin, self.torque_margin, self.held = self._prove(
            x,
            multipliers,
            program.H,
            program.f,
            mass,
            bias,
            self._effort,
            lower,
            upper,
            self._scale,
            solved,
            self.ddq,
            self.tau,
        )
        return found

    def _keeps(self, ddq: Array) -> bool:
        """Whether ddq is within the bounds and its torques within the efforts, but for rounding."""
        hard = self._program
        both = np.concatenate([ddq, hard.A @ ddq])
        slack = KEPT * np.concatenate([1.0 + np.abs(ddq), self._effort])
        return bool(((both >= hard.least - slack) & (both <= hard.most + slack)).all())

    def _fall_back(self, posture: Array) -> tuple[int, Array]:
        """Least violation of the torques, then the task; the bounds of ddq are kept.

        The variables are ddq and s, with rows M·ddq − effort·s/√P and the cost ½·|s|²·largest H.
        """
        hard, soft, n = self._program, self._soft, self.n
        largest = float(hard.H.diagonal().max())
        soft.H[:n, :n], soft.f[:n] = hard.H, hard.f
        soft.H.flat[n * (2 * n + 1) :: 2 * n + 1] = largest
        soft.A[:, :n] = hard.A
        for mine, theirs in ((soft.least, hard.least), (soft.most, hard.most)):
            mine[:n], mine[2 * n :] = theirs[:n], theirs[n:]
        soft.sense[:n] = hard.sense[:n]
        for weight in VIOLATION:
            soft.A.flat[n :: 2 * n + 1] = -self._effort / math.sqrt(weight)
            solved, x, _ = self._soften(SOFT_TOLERANCE)
            ddq = np.clip(x[:n], soft.least[:n], soft.most[:n])
            if solved and self._meant(ddq, np.abs(x[n:]) / math.sqrt(weight)):
                return status.INFEASIBLE, ddq
        return status.UNSOLVED, posture

    def _meant(self, ddq: Array, violation: Array) -> bool:
        """Whether the torques of ddq violate their efforts as the solver says: relative to them."""
        hard, n = self._program, self.n
        tau = hard.A @ ddq
        beyond = np.maximum(tau - hard.most[n:], hard.least[n:] - tau) / self._effort
        true = np.maximum(0.0, beyond)
        return bool(np.abs(true - violation).max() <= ERRS * true.max() + SOFT_TOLERANCE)


def _program(rows: int, variables: int) -> Program:
    """A program without bounds on its variables."""
    count = variables + rows
    return Program(
        np.eye(variables),
        np.zeros(variables),
        np.zeros((rows, variables)),
        np.full(count, -1e30),
        np.full(count, 1e30),
        np.zeros(count, np.int32),
    )
