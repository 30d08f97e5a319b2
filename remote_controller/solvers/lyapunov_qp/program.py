"""The QP of the general problem (3), for each objective Φ: set up once, solved for a rate of V.

In the variables y = W u: for QP12, ℓ1 and ℓ2 y = p − m with p, m ≥ 0, which is strictly convex and
exact (p·m = 0 at the optimum); for ℓ∞ y and max|y|; for least squares y alone.

For QP12, ℓ1 and ℓ2 Newton's method for the dual (`dual_newton_kernels`) comes before daqp where
there are equations, or no rows of A: if no row of A is active, it finds the answer sooner. With
bounds alone it is needed where 0 is not within them, which exact clamping requires.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.errors import BadProblemError
from hoap3.remote_controller.solvers.lyapunov_qp.max_descent_lp import MaxDescentLp
from hoap3.remote_controller.solvers.qp.dense_qp import EQUATION, NO_BOUND, Program, daqp

Array = NDArray[np.float64]

NORM, MAXIMUM, SQUARES = range(3)
SMALL_SQUARES = 1e-6  # weight of ½|u|² beside ℓ1, ℓ∞ and least squares: makes u unique
MOST_GAMMA = 1.0 / (1.0 + SMALL_SQUARES)
PROXIMAL_STEPS = 10
PROVED = 1e-8  # residual: less is one
EXACT = 1e-11  # residual of what Newton's method finds; where it is more, daqp solves the QP
KEPT = 1e-8  # [of W u] how far beyond a bound or a row an answer may be, whatever the tolerance


class StableProgram:
    """The QP over the rows that a `MaxDescentLp` writes.

    Args:
        kind: `NORM`, `MAXIMUM` or `SQUARES`.
        scaled: the rows.
        equality: whether V has to fall as fast as asked, or at least so.

    Attributes:
        y: the last answer, W u, (n,).
        residual: its KKT residual, see `kkt_residual_kernels`.
    """

    def __init__(self, kind: int, scaled: MaxDescentLp, *, equality: bool) -> None:
        from hoap3.remote_controller.solvers.lyapunov_qp import (
            dual_newton_kernels,
            kkt_residual_kernels,
            row_projection_kernels,
        )

        self._prove, self._across = (
            kkt_residual_kernels.residual_kernel,
            row_projection_kernels.across_kernel,
        )
        self._misjudged = kkt_residual_kernels.misjudged_kernel
        self._kind, self._scaled, self._equality = kind, scaled, equality
        self._program = _program(kind, scaled)
        self._attempt = daqp(self._program)
        self._newton = dual_newton_kernels.dual_newton
        bounds_only = len(scaled.rows) == 1 + scaled.k  # and ∇V's, and equations
        self._newton_first = kind == NORM and (scaled.k > 0 or bounds_only)
        count = len(scaled.rows)
        self._newton_work = np.zeros((6, 2 * scaled.n)), np.zeros((2, count))
        self._factor, self._multipliers = np.zeros((count, count)), np.zeros(count)
        self._pull, self._wanted = np.zeros(scaled.n), np.zeros(scaled.n)
        self.y, self.residual, self._held = np.zeros(scaled.n), math.inf, 0.0
        self._turned = [each.copy() for each in (scaled.qp_rows, scaled.qp_least, scaled.qp_most)]
        self._turns = np.zeros((len(scaled.rows), 2))

    def run(
        self, gamma: float, fall: float | None, tolerance: float, *, across: bool = False
    ) -> bool:
        """Solve the QP with −s·y = fall (or ≥), or without; False where the solver gave up.

        γ, at most `MOST_GAMMA`, is QP12's, and without effect for other kinds. With `across` an
        equation −s·y = fall is taken out of the other rows before: slower, and right even where
        they are nearly parallel to s.
        """
        program, row = self._laid_out(), self._program.f.size + self._scaled.used
        target = NO_BOUND if fall is None else -fall
        equation = fall is not None and self._equality
        program.most[row] = target
        program.least[row] = target if equation else -NO_BOUND
        program.sense[row] = EQUATION if equation else 0
        if not (across and equation):
            return self._solve(gamma, tolerance, 0.0, target, self._equality)
        turns = self._turn(target)
        return self._solve(gamma, tolerance, 0.0, target, self._equality, turns)

    def run_exactly(self, gamma: float, fall: float, tolerance: float) -> bool:
        """As `run`; an equation once more with rows across s where the answer has no proof."""
        attempt = [(fall, tolerance)]
        if not self.run_some(gamma, attempt):
            return False
        if self._equality and not self._proved():
            residual, y = self.residual, self.y.copy()
            if not self.run_some(gamma, attempt, across=True) or not self._proved():
                self.residual, self.y[:] = residual, y
        return True

    def run_some(
        self, gamma: float, attempts: list[tuple[float, float]], *, across: bool = False
    ) -> bool:
        """Run with one fall and tolerance after the other until an answer has a proof.

        Else the one that is nearest to it counts; False where there is none.
        """
        best: tuple[float, Array] | None = None
        for fall, tolerance in attempts:
            if self.run(gamma, fall, tolerance, across=across):
                if self._proved():
                    return True
                if best is None or self.residual < best[0]:
                    best = self.residual, self.y.copy()
        if best is not None:
            self.residual, self.y[:] = best
        return best is not None

    def _proved(self) -> bool:
        return self.residual <= PROVED

    def run_damped(self, gamma: float, fall: float, worth: float, tolerance: float) -> bool:
        """Solve the QP with −s·y ≤ fall and a reward for −s·y; False where the solver gave up.

        The reward is what moving one joint faster costs at the speed `worth`. The answer is the
        optimum for the fall that it has. A negative fall is a rise: −s·y ≥ fall, and the reward
        is for s·y.
        """
        program, n = self._laid_out(), self._scaled.n
        row = program.f.size + self._scaled.used
        program.most[row] = -fall if fall < 0.0 else NO_BOUND
        program.least[row] = -fall if fall >= 0.0 else -NO_BOUND
        program.sense[row] = 0
        price = worth
        if self._kind == NORM:
            price += gamma / (1.0 - gamma)
        elif self._kind == MAXIMUM:
            price += 1.0 / SMALL_SQUARES
        else:
            price = price * float(program.H.diagonal().max()) + float(np.abs(program.f[:n]).max())
        price = math.copysign(price, fall)
        solved = self._solve(gamma, tolerance, price, None, True)
        if solved:
            slope = self._scaled.slope
            wrong = self._misjudged(self.y, slope, price, fall, self._held)
            self.residual = max(self.residual, wrong)
        return solved

    def _turn(self, target: float) -> Array:
        """Give the solver rows without what is along s, s·y = target; returns their λ, μ."""
        program, scaled = self._program, self._scaled
        turned, least, most = self._turned
        turns = self._turns[: len(scaled.rows)]
        rows, limits = len(program.A), program.most.size
        turned, least, most = turned[:rows], least[:limits], most[:limits]
        self._across(
            scaled.used, target, program.A, program.least, program.most, turns, turned, least, most
        )
        program.A, program.least, program.most = turned, least, most
        return turns

    def _laid_out(self) -> Program:
        """The program over the rows that were written last."""
        program, scaled = self._program, self._scaled
        if program.A is not scaled.qp_rows:
            program.A, program.sense = scaled.qp_rows, scaled.qp_sense
            program.least, program.most = scaled.qp_least, scaled.qp_most
        return program

    def _solve(
        self,
        gamma: float,
        tolerance: float,
        price: float,
        target: float | None,
        equality: bool,
        turns: Array | None = None,
    ) -> bool:
        """Solve, and prove the answer for s·y = target, or for the s·y that it has.

        `turns` has λ and μ of rows that were turned. False where there is no answer, or what the
        solver calls one is beyond a bound or a row.
        """
        kappa = self._kappa(gamma)
        if self._newton_first and turns is None:
            proof = self._by_newton(price, kappa)
            if proof is not None:
                broken = self._judge(proof, price, kappa, target, equality)
                if broken <= tolerance and self.residual <= EXACT:
                    return True
        proof = self._by_daqp(price, kappa, tolerance)
        if proof is None:
            return False
        if turns is not None:
            proof *= turns[:, 0]
            proof[self._scaled.used] -= float(turns[:, 1] @ proof)
        broken = self._judge(proof, price, kappa, target, equality)
        return broken <= min(tolerance, KEPT)

    def _judge(
        self, proof: Array, price: float, kappa: float, target: float | None, equality: bool
    ) -> float:
        """Set the residual of y, by the multipliers of the rows; how far y is beyond a limit."""
        rows = self._scaled
        self._held = float(proof[rows.used])
        if target is None:
            proof[rows.used] += price  # the reward stands for part of the equation's multiplier
            target = float(rows.slope @ self.y)
        self.residual, broken = self._prove(
            self.y,
            self._pull,
            proof,
            rows.rows,
            rows.least,
            rows.most,
            rows.used,
            target,
            self._kind,
            kappa,
            equality,
            self._wanted,
        )
        return broken

    def _kappa(self, gamma: float) -> float:
        """Weight of |y|₁, or of max|y|, beside ½|y|²."""
        if self._kind == SQUARES:
            return 0.0
        return 1.0 / SMALL_SQUARES if self._kind == MAXIMUM else gamma / (1.0 - gamma)

    def _by_newton(self, price: float, kappa: float) -> Array | None:
        """Set y where equations and bounds alone hold it back; multipliers of the rows."""
        program, rows = self._program, self._scaled
        row, multipliers = program.f.size + rows.used, self._multipliers[: len(rows.rows)]
        found = self._newton(
            rows.rows,
            rows.used,
            rows.least,
            rows.most,
            program.least[row],
            program.most[row],
            price,
            kappa,
            *self._newton_work,
            self._factor,
            self.y,
            multipliers,
        )
        return multipliers if found else None

    def _by_daqp(self, price: float, kappa: float, tolerance: float) -> Array | None:
        """Set y as daqp finds it; multipliers of the rows, None where it gave up."""
        program, rows, n = self._program, self._scaled, self._scaled.n
        f, slope = program.f, rows.slope
        if self._kind == SQUARES:
            self._pull[:] = f
            f += price * slope
        elif self._kind == MAXIMUM:
            np.multiply(slope, price, out=f[:n])
            f[-1] = kappa
        else:
            f.fill(kappa)
            if price != 0.0:
                f[:n] += price * slope
                f[n:] -= price * slope
        solved, x, multipliers = self._attempt(tolerance)
        if solved and self._kind == MAXIMUM:  # which has no square of its own
            solved, x, multipliers = self._settle(tolerance, x, multipliers)
        if self._kind == SQUARES:
            f[:] = self._pull
        if not solved:
            return None
        if self._kind == NORM:
            np.subtract(x[:n], x[n:], out=self.y)
        else:
            self.y[:] = x[:n]
        if self._kind == SQUARES:
            self._pull[:] = self.y - (program.H @ self.y + f)
        return multipliers[: len(rows.rows)]

    def _settle(self, tolerance: float, x: Array, multipliers: Array) -> tuple[bool, Array, Array]:
        """Proximal steps for max|y|: its square is added around its last value until it stays."""
        solved, f = True, self._program.f
        for _ in range(PROXIMAL_STEPS):
            last = -f[-1] + 1.0 / SMALL_SQUARES
            if not solved or abs(x[-1] - last) <= 1e-9 * abs(x[-1]):
                break
            f[-1] = 1.0 / SMALL_SQUARES - x[-1]
            solved, x, multipliers = self._attempt(tolerance)
        return solved, x, multipliers

    def weigh(self, M: Array | None, y: Array | None) -> bool:
        """Set the objective ½|M u − y|² + ½·1e-6·|u|²; False if shapes or numbers forbid it."""
        if M is None or y is None or M.ndim != 2 or M.shape != (y.size, self._scaled.n):
            return False
        program = self._program
        np.matmul(M.T, M, out=program.H)
        program.H.flat[:: self._scaled.n + 1] += SMALL_SQUARES
        np.matmul(-y, M, out=program.f)
        return bool(np.isfinite(program.H).all() and np.isfinite(program.f).all())


def kind_of(objective: str | float, gamma: float) -> tuple[int, float]:
    """Kind of objective, and the γ that makes QP12 of it."""
    kinds = {
        "qp12": (NORM, gamma),
        1: (NORM, MOST_GAMMA),
        2: (NORM, 0.0),
        math.inf: (MAXIMUM, 0.0),
        "least_squares": (SQUARES, 0.0),
    }
    if objective not in kinds:
        raise BadProblemError(
            f"the objective {objective!r} is not supported with constraints. Choose 'qp12', an ℓp "
            "norm with p = 1, 2 or inf, or 'least_squares'."
        )
    return kinds[objective]


def _program(kind: int, scaled: MaxDescentLp) -> Program:
    """The QP of a kind of objective, over the rows that `scaled` writes."""
    size = scaled.qp_rows.shape[1]
    H, f = np.eye(size), np.zeros(size)
    if kind == MAXIMUM:
        f[-1] = 1.0 / SMALL_SQUARES
    return Program(H, f, scaled.qp_rows, scaled.qp_least, scaled.qp_most, scaled.qp_sense)
