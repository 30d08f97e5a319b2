"""The general problem (3): stable by design, within all constraints.

    min  Φ(u)   subject to   ∇V·u + ∂V/∂t = −ρΨ,  A u ≤ b,  C u = c,  lower ≤ u ≤ upper

Gonçalves et al., IEEE T-RO 2020, (3) and (18).

ρ is the largest number up to 1 that the constraints allow, min(1, ρ*) of (6), found again at each
solve, unless `max_speed_ratio` damps it. The way to the answer, cheapest first:

1. QP12, then QP12 within the bounds by exact clamping, ρ in closed form. Where that keeps all
   rows, it is the answer.
2. The QP with ρ = 1: by Newton's method for its dual where there are equations or no rows of A,
   and no row of A is active; else by daqp.
3. If that has no solution, the LP (7), which is then bounded, and the QP with ρ a little below ρ*
   (by 1e-9 of it): at ρ* itself the feasible set is a point, which rounding may remove. While ρ
   stays below 1, the LP comes first at the next solves: that changes their time, not their answer.
   As V's rate is given by then, what the other rows have along ∇V is taken out of them: a row that
   is nearly parallel to ∇V, as where a target lies beyond an edge, would cost the QP solver digits.

Each answer comes with a KKT residual that is computed from the multipliers, not by the solver. It
proves u for the ρ that V̇ has; for a damped ρ also that no other is worth its speed; and for
``STATIONARY`` that V can fall no further, by the dual of the LP.

What cannot be done is named in ``status``, and u is then as still as the bounds allow, never NaN:

* ``STATIONARY``: V can fall no further (ρ* = 0), and u = 0 keeps all constraints.
* ``ZERO_GRADIENT``: ∇V = 0, but V should change. u = 0; where that breaks a constraint, the least
  u that keeps them.
* ``INFEASIBLE_CONSTRAINTS``: no u keeps the constraints. u is the point within the bounds nearest
  to 0: a robot whose constraints make no sense stands still rather than choose which one to break.
* ``UNSOLVED``: the QP solver gave up; as for ``INFEASIBLE_CONSTRAINTS``.

``CANNOT_DESCEND`` and ``DESCENDS_FASTER`` come with an answer: V cannot be kept from rising
(ρ < 0), or from falling faster than asked (ρ > 1), because of its drift or of the constraints; V̇ is
as close to −Ψ as it gets.
"""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hoap3.protocol.errors import BadProblemError
from hoap3.remote_controller.solvers.base import status
from hoap3.remote_controller.solvers.base.validation import KERNEL_ARRAYS
from hoap3.remote_controller.solvers.lyapunov_qp.max_descent_lp import MaxDescentLp
from hoap3.remote_controller.solvers.lyapunov_qp.program import (
    KEPT,
    MOST_GAMMA,
    NORM,
    SQUARES,
    StableProgram,
    kind_of,
)
from hoap3.remote_controller.solvers.qp.dense_qp import NO_BOUND

Array = NDArray[np.float64]

PATHS = ("still", "free", "clamped", "qp")
STILL, FREE, CLAMPED, QP = range(4)
RHO, RESIDUAL = 1, 3  # places in the results of `lyapunov_qp_kernels`
ROUNDING = 1e-14  # of ρ, or of what a fall sums up [W u]
CLOSE = 1e-9  # rates, divided by top, that rounding may take for each other
ATTEMPTS = ((1e-9, 1e-11), (1e-9, 1e-8), (1e-7, 1e-8), (1e-5, 1e-8), (1e-3, 1e-6))
"""How far to stay inside the feasible rates, relative, and daqp's tolerance, in units of W u."""
DAMPED_TOLERANCES = (1e-13, 1e-11, 1e-8)  # of daqp; the tighter, the better the proof


class StableQp:
    """Solves (3) for n joints, m inequality rows and k equality rows.

    Args:
        n: number of joints.
        m: rows of A.
        k: rows of C.
        objective: `"qp12"`: γ|W u|₁ + (1−γ)/2·|W u|²; 1, 2 or inf: |W u|_p, to which ½·1e-6·|W u|²
            is added for 1 and inf, which makes u unique; `"least_squares"`: ½|M u − y|² +
            ½·1e-6·|u|² with M and y given to each solve.
        gamma: γ of `"qp12"`. 1 − γ counts as 1e-6 at least.
        weights: of the joints, (n,), positive; all 1 by default. Least squares have none.
        lyapunov: `"equality"` as above, or `"descent"`: ∇V·u + ∂V/∂t ≤ 0, whatever Ψ (Remark 1),
            for least squares: with a norm u = 0 would be the optimum.
        max_speed_ratio: 0: ρ is the largest feasible one, whatever speed it costs. Above, ρ is
            damped: where bounds alone are not the answer, V falls as asked only while that costs no
            more than so many times the speed that one joint alone would need, and else by less.

    Attributes:
        u: the answer, (n,).
        rho: ρ = −V̇/Ψ, within ±1e9, which stands for infinity.
        rate: V̇ = ∇V·u + ∂V/∂t of the answer.
        path: index into `PATHS`.
        margin: smallest b − A u or distance to a bound, each in its own unit; inf without any.
        kkt_residual: how far u is from optimal, relative; inf where there is no proof.
        status: index into `status.NAMES`.
        gamma: γ; may be changed between solves.

    Raises:
        BadProblemError: a p that constraints are not supported for, a γ outside [0, 1], weights
            that are not n positive numbers, or another word for `lyapunov`.
    """

    def __init__(
        self,
        n: int,
        m: int = 0,
        k: int = 0,
        *,
        objective: str | float = "qp12",
        gamma: float = 0.5,
        weights: ArrayLike | None = None,
        lyapunov: Literal["equality", "descent"] = "equality",
        max_speed_ratio: float = 0.0,
    ) -> None:
        from hoap3.remote_controller.solvers.lyapunov_qp import lyapunov_qp_kernels as kernels

        self._cheap = kernels.try_closed_form
        self._finish, self._verdict = kernels.finish_kernel, kernels.rate_status
        self._forced_by = kernels.forced_kernel
        self.n, self.m, self.k = n, m, k
        if not 0.0 <= gamma <= 1.0:
            raise BadProblemError(f"gamma must lie between 0 and 1 (found {gamma!r}).")
        if lyapunov not in ("equality", "descent"):
            raise BadProblemError(f"lyapunov must be 'equality' or 'descent' (found {lyapunov!r}).")
        self._kind, gamma = kind_of(objective, gamma)
        self.gamma = gamma
        self._equality = lyapunov == "equality"
        self._steepest = MaxDescentLp(n, m, k, weights, self._kind)
        self._work = np.ones((4, n))
        self.weights = self._work[0]
        self.weights[:] = self._steepest.weights
        self._steepest.weights = self.weights
        self._program = StableProgram(self._kind, self._steepest, equality=self._equality)
        self._none_C, self._none_c = np.zeros((0, n)), np.zeros(0)
        self._max_speed_ratio = max_speed_ratio
        self._result, self._reached = np.zeros(4), False
        self._limited = False  # whether the last QP had to go below the ρ it was asked for
        self._size = np.array([n, m, k])
        self.u = np.zeros(n)
        self.path, self.status = STILL, status.UNSOLVED
        self.rho, self.rate = 0.0, 0.0
        self.margin, self.kkt_residual = -math.inf, math.inf

    def forget(self) -> None:
        """Try ρ = 1 first at the next solve."""
        self._limited = False

    def solve(
        self,
        gradient: Array,
        psi: float,
        drift: float,
        A: Array,
        b: Array,
        lower: Array,
        upper: Array,
        C: Array | None = None,
        c: Array | None = None,
        M: Array | None = None,
        y: Array | None = None,
    ) -> int:
        """Find u and what is known of it; see the attributes.

        Args:
            gradient: ∇V, (n,).
            psi: Ψ ≥ 0.
            drift: ∂V/∂t.
            A: (m, n).
            b: (m,), inf switches a row off, whatever stands in it.
            lower: (n,), −inf where there is none.
            upper: (n,), inf where there is none.
            C: (k, n), where k > 0.
            c: (k,).
            M: (any, n), for least squares.
            y: as many.

        Returns:
            The status.

        Raises:
            BadProblemError: an argument of the wrong type.
        """
        equal = self._none_C if C is None else C
        values = self._none_c if c is None else c
        ceiling = 1.0 if self._equality else 0.0
        gamma = min(self.gamma, MOST_GAMMA) if self._kind == NORM else -1.0
        try:
            self.status, self.path = self._cheap(
                self._size,
                gradient,
                psi,
                drift,
                ceiling,
                gamma,
                A,
                b,
                equal,
                values,
                lower,
                upper,
                self._work,
                self.u,
                self._result,
            )
        except TypeError as error:
            self._refuse(status.BAD_INPUT)
            raise BadProblemError(f"stable QP: wrong type of argument. {KERNEL_ARRAYS}") from error
        if self.path == QP:
            self._steepest.fill(gradient, A, b, equal, values, lower, upper)
            if self._kind == SQUARES and not self._program.weigh(M, y):
                return self._refuse(status.BAD_INPUT)
            self._search(gamma, drift, ceiling * psi + drift)
            if self.status == status.STATIONARY or self.path == STILL:
                self._program.y[:], self.path = 0.0, STILL
                still = self.status == status.STATIONARY
                self._result[RESIDUAL] = max(self._steepest.proved(), 0.0) if still else math.inf
            else:
                self._result[RESIDUAL] = self._program.residual
            self._finish(
                self._program.y,
                gradient,
                psi,
                drift,
                A,
                b,
                lower,
                upper,
                self.weights,
                self.u,
                self._result,
            )
            if self._reached:
                self._result[RHO] = ceiling
        self.rate, self.rho, self.margin, self.kkt_residual = self._result.tolist()
        return self.status

    def _search(self, gamma: float, drift: float, asked: float) -> None:
        """Solve the QP, with a lower ρ if need be; sets status, path and y."""
        top, run, self._reached = self._steepest.top, self._program.run, False
        exactly = self._program.run_exactly
        if top == 0.0:  # V̇ is the drift, whatever u
            if not self._equality and drift <= 0.0:
                self.status = status.OK
            if not any(run(gamma, None, tolerance) for _, tolerance in ATTEMPTS):
                self._give_up(self._steepest.fall()[0])
            return
        wanted = asked / top
        if self._max_speed_ratio and self._equality and self._damped(gamma, drift / top, wanted):
            return
        possible = abs(wanted) < NO_BOUND
        if possible and not self._limited and exactly(gamma, wanted, ATTEMPTS[0][1]):
            self._reached = self._equality
            return
        found, best = self._steepest.fall()
        sure = self._steepest.sure
        enough = best >= wanted - CLOSE * (1.0 + abs(wanted)) or not sure
        if possible and self._limited and enough and exactly(gamma, wanted, ATTEMPTS[0][1]):
            self._reached, self._limited = self._equality, False
            return
        self._limited, inwards = True, -1.0
        if best >= wanted:  # rounding misled the QP, or the rates end on the other side
            reserve = best - wanted
            found, rise = self._steepest.fall(-1.0)
            best = max(wanted, -rise)
            inwards = 1.0 if wanted + rise < reserve else -1.0
        if found not in (status.OK, status.UNBOUNDED) or not abs(best) < NO_BOUND:
            self._give_up(found)
            return
        self.status = self._verdict(best, wanted, drift / top, 1.0, self._forced() <= 0.0)
        if self.status == status.STATIONARY:
            if not sure:
                self._give_up(status.UNSOLVED)
            return
        near = [(best + inwards * inside * abs(best), limit) for inside, limit in ATTEMPTS]
        if not self._program.run_some(gamma, near, across=True) and not self._take_vertex(best):
            self._give_up(status.UNSOLVED)

    def _take_vertex(self, best: float) -> bool:
        """Answer with the point that the last LP found, if V falls by `best` there; no proof.

        Where limits are as tight as rounding, the LP has a point within them and the QP none.
        """
        v = self._steepest.v
        reached = -float(self._steepest.slope @ v)
        if abs(reached - best) > CLOSE * (1.0 + abs(best)) or not self._steepest.keeps(v, KEPT):
            return False
        self._program.y[:], self._program.residual = v, math.inf
        return True

    def _damped(self, gamma: float, drift: float, wanted: float) -> bool:
        """Find the answer for a damped ρ; False where there is none."""
        program, forced = self._program, self._forced()
        kappa = gamma / (1.0 - gamma) if self._kind == NORM else 0.0
        worth = self._max_speed_ratio * (kappa + abs(wanted) + max(forced, 0.0))
        if not abs(wanted) < NO_BOUND or not any(
            program.run_damped(gamma, wanted, worth, tolerance) for tolerance in DAMPED_TOLERANCES
        ):
            return False
        slope = self._steepest.slope
        fall = -float(slope @ program.y)
        self._reached = abs(fall - wanted) <= ROUNDING * (1.0 + abs(wanted))
        if not self._reached:
            self.status = self._verdict(fall, wanted, drift, 1.0, forced <= 0.0)
            if self.status == status.STATIONARY and self._steepest.fall()[1] > CLOSE:
                self.status = status.OK  # it could fall, but that is not worth the speed
        return True

    def _forced(self) -> float:
        """Fastest speed that a constraint asks for [of W u]; 0 or less: u = 0 keeps them all."""
        steepest = self._steepest
        least, most, row = steepest.least, steepest.most, self.n + steepest.used
        least[row], most[row] = -NO_BOUND, NO_BOUND
        return self._forced_by(least, most)

    def _give_up(self, why: int) -> None:
        self.status, self.path = (why if why != status.OK else status.UNSOLVED), STILL

    def _refuse(self, why: int) -> int:
        """A problem that cannot be read: u = 0, and nothing is known of it."""
        self.u[:] = 0.0
        self.status, self.path = why, STILL
        self.rate, self.rho, self.margin, self.kkt_residual = 0.0, 0.0, -math.inf, math.inf
        return why
