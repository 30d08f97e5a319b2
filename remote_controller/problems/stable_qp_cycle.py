"""One answer of `stable_qp`: what its certificate claims, and the problems that it may solve."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from hoap3.protocol.messages import schema
from hoap3.remote_controller.problems.check import infeasibility, upper_bound
from hoap3.remote_controller.problems.history import is_finite
from hoap3.remote_controller.problems.oracles.tasks.curve_oracle import Curve
from hoap3.remote_controller.problems.oracles.tasks.task_oracle import Rows as TaskRows
from hoap3.remote_controller.problems.stable_qp_objective import TINY
from hoap3.remote_controller.problems.statement import (
    Array,
    Claim,
    ClosedForm,
    MaximalRate,
    Problem,
    Program,
    Rows,
    Statement,
)
from hoap3.remote_controller.problems.velocity_answer import VelocityAnswer
from hoap3.remote_controller.solvers.lyapunov_qp.reference import adapted_gamma, descent_rate

if TYPE_CHECKING:
    from hoap3.remote_controller.problems.stable_qp import StableQpProblems

CONSTANTS = schema("Setpoint").constants
CERTIFIED, AT_TARGET = CONSTANTS["STATUS_CERTIFIED"], CONSTANTS["STATUS_AT_TARGET"]
NO_ANSWER = CONSTANTS["STATUS_INFEASIBLE"]
OK, STATIONARY, ZERO_GRADIENT, INFEASIBLE, CANNOT_DESCEND, DESCENDS_FASTER = 0, 5, 6, 7, 9, 10
"""What the column `solver_status` says, of `solvers.base.status`."""
PROVEN = (OK, STATIONARY)
ANSWERED = (*PROVEN, CANNOT_DESCEND, DESCENDS_FASTER)
FOLLOWED = (*ANSWERED, ZERO_GRADIENT)  # else the robot brakes

RELATIVE = 1e-9  # of what is compared: rounding
SUMMED = 1e-12  # of a sum, relative to the sizes of its terms: rounding
PLACES = 8.0 * float(np.finfo(float).eps)  # m or rad: how exactly e and each column of J are known
AS_ASKED = 1e-9  # rad/s: speed by which V̇ may miss what is asked and counts as that
LARGEST_RHO = 1e9  # stands for infinity
OPTIMAL = 1e-9  # greatest relative residual of a certified answer
PROVED = 1e-8  # greatest one that shows an optimum: the optimum is known as exactly as it states
KEPT, SOLVED = 1e-9, 1e-8  # what a certified and any other answer may be beyond a row [rad/s]
CURVATURE = 1e-6  # of a margin: what a certified answer may find it below 0
RETREATS = 1e-9, 1e-7, 1e-5, 1e-3
"""Shares of the largest fall of V by which the solver stays inside: there the set is a point."""
SPARED = 0.1  # of the speeds that constraints leave, at each end where ζ of a curve is beyond it


@dataclass(frozen=True)
class Descent:
    """V and what it rests on in one cycle, and how exactly that is known.

    Attributes:
        V, psi, drift: V, Ψ and ∂V/∂t.
        gradient, gradient_error: ∇V and its error, (n,).
        psi_error, drift_error: of Ψ and ∂V/∂t.
        error, rate: |e| and |∂e/∂t|.
    """

    V: float
    psi: float
    drift: float
    gradient: Array
    gradient_error: Array
    psi_error: float
    drift_error: float
    error: float
    rate: float

    def speed(self, u: Array, u_error: Array) -> tuple[float, float]:
        """V̇ = ∇V·u + ∂V/∂t of an answer, (n,), and how exactly it is known."""
        each = self.gradient * u
        found = float(each.sum()) + self.drift
        exact = RELATIVE * abs(found) + SUMMED * (
            float(np.abs(each).sum()) + self.error * self.rate
        )
        exact += float(np.abs(self.gradient) @ u_error + self.gradient_error @ np.abs(u))
        return found, exact + PLACES * self.rate


class Cycle:
    """One answer and its problem.

    Args:
        builder: whose newest State it is an answer to.
        setpoint: as logged.
        answer: its velocity.
        task: the task's rows.
    """

    def __init__(
        self, builder: StableQpProblems, setpoint: Any, answer: VelocityAnswer, task: TaskRows
    ) -> None:
        self._builder, self._setpoint, self._task = builder, setpoint, task
        self._settings, self._objective = builder.settings, builder.objective
        self._answer, self.u, self.u_error = answer, answer.u, answer.error
        self.psi_stated, self.drift_stated, status = setpoint["extra"][builder.columns]
        self.status = int(status) if float(status).is_integer() else -1
        self.verdict = int(setpoint["solver_status"])
        self.answered, self.certified = self.status in ANSWERED, self.verdict == CERTIFIED
        self.kept = KEPT if self.certified else SOLVED
        self.equality = self._settings.rest["lyapunov"] == "equality"
        self.descent = self._descent()
        self.rejected = False
        self._lower, self._upper = builder.bounds.lower[-1], builder.bounds.upper[-1]
        self._limits = self._rows_of_constraints()
        curve = builder.task
        self._along = self._follow(curve) if isinstance(curve, Curve) else None
        self._gamma = float(self._settings.objective.get("gamma", 0.0))
        if self._settings.objective.get("adaptive_gamma"):
            slope = self._settings.objective["gamma_slope"]
            self._gamma = adapted_gamma(self.descent.gradient, self._gamma, slope)

    def statement(
        self,
        claims: Sequence[Claim],
        problems: Sequence[Any],
        unverified: tuple[tuple[str, str], ...] = (),
    ) -> Statement:
        """What is claimed, of the branch that the status names."""
        branch = f"solver_status {self.status}"
        return Statement(branch, tuple(problems), self.u, self.u_error, tuple(claims), unverified)

    def claims_of_v(self) -> list[Claim]:
        """V, Ψ and ∂V/∂t, and that the status agrees with whether there is an answer."""
        d, stated = self.descent, self._setpoint
        share = float(stated["rho"]) if self.answered and self.equality else 0.0
        near = abs(share) * (d.psi_error + RELATIVE * d.psi)
        claims = [
            Claim("V", stated["v"], d.V, RELATIVE * d.V + PLACES * d.error + PLACES**2),
            Claim("psi", self.psi_stated, d.psi, d.psi_error),
            Claim("drift", self.drift_stated, d.drift, d.drift_error),
            Claim("required V rate", stated["v_rate_required"], -share * d.psi, near),
            Claim("answered", float(self.verdict != NO_ANSWER), float(self.answered), 0.0),
        ]
        if not self.answered:
            names = ("rho", "v_rate_predicted", "kkt_residual")
            claims += [Claim(f"no answer: {name}", stated[name], 0.0, 0.0) for name in names]
        return claims

    def claims_of_speed(self) -> list[Claim]:
        """V̇ and ρ of the answer, and what `certified` and `at target` say of them."""
        d, stated, rho = self.descent, self._setpoint, float(self._setpoint["rho"])
        rate, near = d.speed(self.u, self.u_error)
        predicted = rate if self.answered else 0.0
        claims = [Claim("predicted V rate", stated["v_rate_predicted"], predicted, near)]
        if self.answered:
            claims.append(Claim("rho", rho, *self._share(rate, near)))
        if self.certified:
            required = -rho * d.psi if self.equality else 0.0
            short = abs(rate - required) if self.equality else rate - required
            allowed = OPTIMAL * abs(required) + near + abs(rho) * d.psi_error
            claims += [
                Claim("certified: V rate", short, 0.0, allowed, "at_most"),
                Claim("certified: rows left out", float(self.rejected), 0.0, 0.0),
                Claim("certified: rho", rho, 0.0, 0.0, "at_least"),
                Claim("certified: solved", float(self.status in PROVEN), 1.0, 0.0),
                Claim("certified: residual", stated["kkt_residual"], 0.0, OPTIMAL, "at_most"),
            ]
        if self.verdict == AT_TARGET:
            claims.append(Claim("at target: psi", d.psi, 0.0, 0.0))
            claims.append(Claim("at target: drift", d.drift, 0.0, d.drift_error))
            fastest, exact = float(np.abs(self.u).max()), float(self.u_error.max())
            claims.append(Claim("at target: u", fastest, 0.0, exact))
        return claims

    def claims_of_margin(self) -> list[Claim]:
        """Smallest margin: of the constraints, else of rows and bounds, else of speeds."""
        fastest = self._builder.history.description.velocity
        u, lower, upper = self.u, self._lower, self._upper
        sides = float(np.minimum(upper - u, u - lower).min())
        near = float(self.u_error.max())
        rows = self._limits
        used = ~rows.optional & (rows.lower != rows.upper)
        if used.any():
            A = rows.A[used]
            sides = min(sides, float((rows.upper[used] - A @ u).min()))
            near = max(near, float((np.abs(A) @ (self.u_error + RELATIVE * np.abs(u))).max()))
        margin, exact = self._nearest_constraint()
        known = np.isfinite(margin)
        found = margin if known else sides
        found = found if np.isfinite(found) else float((fastest - np.abs(u)).min())
        exact = (exact if known else near + float(self.u_error.max())) + RELATIVE * abs(found)
        claims = []
        if self.answered or known:
            claims.append(Claim("margin", self._setpoint["margin"], found, exact))
        if self.certified:
            claims.append(Claim("certified: rows and bounds", sides, 0.0, KEPT + near, "at_least"))
            claims.append(Claim("certified: margin", found, 0.0, CURVATURE + exact, "at_least"))
        return claims

    def claims_of_optimum(self) -> list[Claim]:
        """What no program says: Hölder's inequality, a stop, and the speed along a curve."""
        claims = [] if self._along is None else list(self._along[1])
        stated = self._setpoint["kkt_residual"]
        if self.answered and self._objective.alone and self.status != STATIONARY:
            gap = self._objective.holder_gap(self.descent.gradient, self.u)
            near = OPTIMAL
            if self.u.any():
                size = np.abs(self.descent.gradient).max(), np.abs(self.u).max()
                near += float(self.descent.gradient_error.max() / size[0])
                near += float(self.u_error.max() / size[1])
            most = math.sqrt(self.u.size) * float(stated)
            claims.append(Claim("optimum", gap, most, near, "at_most"))
            claims.append(Claim("largest rate", self._setpoint["rho"], 1.0, RELATIVE, "at_least"))
        if self.status == ZERO_GRADIENT:
            steepest = float(np.abs(self.descent.gradient).max())
            exact = float(self.descent.gradient_error.max())
            claims.append(Claim("zero gradient", steepest, 0.0, exact))
        if self.status == STATIONARY:
            fastest, exact = float(np.abs(self.u).max()), float(self.u_error.max())
            claims.append(Claim("stationary: u", fastest, 0.0, exact))
        if self.status == INFEASIBLE and self._begins_to_brake():
            broken = infeasibility(self._unit_rows())
            claims.append(Claim("infeasible", broken, 0.0, SOLVED, "at_least"))
        return claims

    @property
    def _unproved(self) -> bool:
        """Whether the controller states no proof of its answer: an infinite residual."""
        return not np.isfinite(self._setpoint["kkt_residual"])

    def unverified(self) -> tuple[tuple[str, str], ...]:
        """What neither claims nor problems can show of this answer, and why."""
        reasons = []
        if self.answered and not self._setpoint["kkt_residual"] <= PROVED:
            reasons.append(("optimum", "the controller states no proof"))
        if self.status not in {*FOLLOWED, INFEASIBLE}:
            reasons.append(("no answer", "that a solver finds none is not recomputed"))
        if self.status not in FOLLOWED and self._last() is None:
            reasons.append(("brake", "the answer before is not in the log"))
        return tuple(reasons)

    def problems(self) -> list[Any]:
        """What the answer solves, by its status; several where the status allows several."""
        if self.status not in FOLLOWED:
            return [] if self._last() is None else [self._brake]
        if self.status == STATIONARY:
            return [partial(self._largest_fall, wanted=np.inf)]
        if self.status == ZERO_GRADIENT:
            still = ClosedForm((np.zeros(self.u.size),), np.zeros(self.u.size))
            return [lambda: still, partial(self._program, rate=False)]
        if self._objective.alone or self._unproved:
            return []
        if not self.equality and self.status == CANNOT_DESCEND:
            return [partial(self._largest_fall, wanted=self.descent.drift)]
        if not (self.equality and float(self._setpoint["rho"]) < 1.0 - RELATIVE):
            return [self._program]
        largest = partial(self._largest_fall, wanted=self.descent.psi + self.descent.drift)
        damped = self._settings.rest["rho"] == "damped"
        return [self._priced, largest] if damped else [largest]

    def _descent(self) -> Descent:
        task, psi = self._task, self._settings.psi
        V, gradient = task.value, task.gradient
        error, rate = math.sqrt(2.0 * V), float(np.linalg.norm(task.rate))
        first, second = psi["u_max_rad_s"], psi["beta"]
        if psi["form"] in {"tanh", "exponential"}:
            first, second = psi["eta_per_s"], psi["kappa"]
        share = self._builder.history.share_of_ramp(psi["ramp_s"])
        needed = descent_rate(psi["form"], V, gradient, error, first, second) * share
        off = PLACES * (np.linalg.norm(task.jacobian, axis=0) + error)
        needed_error, drift = 0.0, task.value_rate
        if needed > 0.0:
            relative = PLACES / error + float(np.linalg.norm(off) / np.abs(gradient).max())
            needed_error = needed * (RELATIVE + relative)
        drift_error = RELATIVE * abs(drift) + SUMMED * error * rate + PLACES * rate
        return Descent(V, needed, drift, gradient, off, needed_error, drift_error, error, rate)

    def _share(self, rate: float, near: float) -> tuple[float, float]:
        """ρ = −V̇/Ψ, at most 1, and how exactly it is known."""
        d = self.descent
        if d.psi == 0.0:
            return (1.0 if rate <= near else -LARGEST_RHO), RELATIVE
        share = float(np.clip(-rate / d.psi, -LARGEST_RHO, LARGEST_RHO))
        missed = AS_ASKED * (float(np.abs(d.gradient).max()) + abs(d.psi + d.drift))
        exact = RELATIVE * abs(share) + (missed + near + d.psi_error) / d.psi
        return min(share, 1.0), exact

    def _rows_of_constraints(self) -> Rows:
        """Rows of all constraints that count for this ∇V, without bounds."""
        n, parts = self.u.size, []
        for constraint, rows in self._builder.limits:
            if not constraint.accepts(self.descent.gradient):
                self.rejected = True
                continue
            A, b = rows.A, rows.b
            length = np.linalg.norm(A, axis=1)
            error = self.kept * length
            if constraint.equality:
                parts.append(Rows.of(A, b, b, error=error))
                continue
            if constraint.yields and constraint.margins[-1] < 0.0:
                b = _slow_returns(A, b, self._lower, self._upper)
            used = (b < np.inf) & ((length > 0.0) | (b < 0.0))
            parts.append(
                Rows.of(A[used], -np.inf, b[used], error=error[used], optional=~rows.asked[used])
            )
        return Rows.stacked([Rows.of(np.zeros((0, n)), 0.0, 0.0), *parts])

    def _nearest_constraint(self) -> tuple[float, float]:
        """Smallest margin of the constraints, and how exactly it is known; inf where none has."""
        least, exact = np.inf, 0.0
        for each in self._builder.constraints:
            if each.margins[-1] < least:
                least, exact = float(each.margins[-1]), PLACES * each.amplifies
        return least, exact

    def _all_rows(self, *more: Rows) -> Rows:
        """Rows of constraints, bounds and the curve."""
        n = self.u.size
        bounds = Rows.of(np.eye(n), self._lower, self._upper, error=self.kept)
        parts = [self._limits, bounds, *more]
        if self._along is not None:
            parts.append(self._along[0])
        return Rows.stacked(parts)

    def _unit_rows(self) -> Rows:
        """The same, in units of weighted speeds: each row of W⁻¹ has the length 1."""
        rows = self._all_rows()
        length = np.linalg.norm(rows.A / self._objective.weights, axis=1)
        size = np.where(length > 0.0, length, 1.0)
        return replace(
            rows, A=rows.A / size[:, None], lower=rows.lower / size, upper=rows.upper / size
        )

    def _follow(self, curve: Curve) -> tuple[Rows, tuple[Claim, ...]]:
        """The motion along a curve, Tᵀẋ = ζ: with the speed that constraints leave of ζ."""
        row, speed = curve.motion_row, curve.speed
        size, taken = float(np.linalg.norm(row)), float(row @ self.u)
        near = AS_ASKED * size + float(np.abs(row) @ self.u_error)
        claims: tuple[Claim, ...] = ()
        if abs(taken - speed) > near:
            left, pull = self._speed_left(row, speed)
            near += self.kept * size * (1.0 + pull)
            claims = (Claim("speed along the curve", taken, left, near),)
            speed = taken
        return Rows.of(row[None], speed, speed, error=self.kept * size), claims

    def _speed_left(self, row: Array, speed: float) -> tuple[float, float]:
        """The speed next to ζ of those that the constraints leave, less some at an end.

        And by how much it changes, in units of the row, if limits are relaxed by 1.
        """
        size = float(np.linalg.norm(row)) or 1.0
        bounds = Rows.of(np.eye(self.u.size), self._lower, self._upper)
        rows = Rows.stacked([self._limits, bounds])
        slowest, fastest = upper_bound(-row / size, rows), upper_bound(row / size, rows)
        least, most = -size * slowest.value, size * fastest.value
        if most == -np.inf:
            return speed, 0.0
        room = min(most - least, 2.0 * most, 2.0 * max(abs(least), speed))
        spared = SPARED * max(room, 0.0)
        left = min(max(speed, least + spared), most - spared)
        return left, (1.0 + 2.0 * SPARED) * max(slowest.pull, fastest.pull)

    def _rate_row(self, *, fixed: bool) -> Rows:
        """V's rate as an equation with what the answer has, where it is `fixed`; or V̇ ≤ 0."""
        d = self.descent
        row, doubt = d.gradient[None], float(d.gradient_error.max())
        if fixed:
            rate = float(d.gradient @ self.u)
            near = SUMMED * float(np.abs(d.gradient) @ np.abs(self.u))
            return Rows.of(row, rate, rate, A_error=doubt, error=near)
        _, near = d.speed(self.u, self.u_error)
        near += self.kept * float(np.linalg.norm(d.gradient))
        return Rows.of(row, -np.inf, -d.drift, A_error=doubt, error=near)

    def _program(
        self, price: float | None = None, *, rate: bool = True, fixed: bool | None = None
    ) -> Program:
        """Min Φ within all rows, with a row for V's rate or a price of a faster fall.

        Args:
            price: of the fall of V, in units of the scaled Φ; None: V's rate has a row.
            rate: whether it has one.
            fixed: whether V's rate is that of the answer; by default where V̇ is given.
        """
        d, objective = self.descent, self._objective
        cost, cost_error = np.zeros(self.u.size), np.zeros(self.u.size)
        if price is not None:
            pull = price / max(self._steepest, TINY)
            rows, cost = self._all_rows(), pull * d.gradient
            cost_error = abs(pull) * d.gradient_error / objective.weights**2
        elif rate:
            row = self._rate_row(fixed=self.equality if fixed is None else fixed)
            rows = self._all_rows(row)
        else:
            rows = self._all_rows()
        program = objective.program(self.u, self._gamma, rows, cost, self._squares)
        residual = math.sqrt(self.u.size) * float(self._setpoint["kkt_residual"]) + OPTIMAL
        scale = objective.scale(self.u, self._lower, self._upper, self._gamma)
        return replace(program, error=residual * scale / objective.weights + cost_error)

    def _priced(self) -> Program:
        """The program of a damped ρ: a faster fall of V is worth no more than its price."""
        unit = self._unit_rows()
        limits = np.concatenate([unit.lower, -unit.upper])
        forced = float(np.where(np.isfinite(limits), limits, -np.inf).max(initial=-np.inf))
        wanted = (self.descent.psi + self.descent.drift) / max(self._steepest, TINY)
        ratio = float(self._settings.rest["max_speed_ratio"])
        return self._program(
            self._objective.price(self._gamma, wanted, forced, ratio, self._squares)
        )

    def _largest_fall(self, *, wanted: float) -> MaximalRate:
        """V falls as fast as the constraints allow, and of all such u this one is the best."""
        d, span = self.descent, max(float(np.abs(self.u).max()), 1.0)
        error = float(np.abs(d.gradient) @ self.u_error)
        error += 2.0 * span * float(d.gradient_error.sum()) + self.kept * self._steepest
        rows = self._all_rows()
        return MaximalRate(-d.gradient, wanted, rows, RETREATS, error, self._program(fixed=True))

    @property
    def _steepest(self) -> float:
        """max|W⁻¹∇V|."""
        return float(np.abs(self.descent.gradient / self._objective.weights).max())

    @property
    def _squares(self) -> tuple[Array, Array]:
        """M and y of ½|M u − y|², for least squares."""
        task, objective = self._task, self._settings.objective
        curve = self._builder.task
        if isinstance(curve, Curve):
            return np.sqrt(curve.weights)[:, None] * task.jacobian, np.zeros(task.error.size)
        return task.jacobian, -float(objective.get("gain_per_s", 0.0)) * task.error

    def _brake(self) -> Problem:
        """All joints brake in a straight line, within their bounds."""
        robot = self._builder.history.description
        last, last_error = self._last() or (np.zeros(self.u.size), np.zeros(self.u.size))
        periods = float(np.max(np.abs(last) / (robot.brake_acceleration * robot.period_s)))
        share = 1.0 - 1.0 / periods if periods > 1.0 else 0.0
        u = np.clip(share * last, self._lower, self._upper)
        return ClosedForm((u,), last_error + RELATIVE * np.abs(u))

    def _last(self) -> tuple[Array, Array] | None:
        """Return u of the last answer and its error, (n,); 0 after a reset, None if it is lost."""
        history, zero = self._builder.history, np.zeros(self.u.size)
        if history.fresh:
            return zero, zero
        setpoint = history.last_answer
        if setpoint is None or not is_finite(setpoint, "values", "decision"):
            return None
        T = history.description.period_s
        last = VelocityAnswer.of(history.last, setpoint, self._settings.rest, T)
        return last.u, last.error

    def _begins_to_brake(self) -> bool:
        """Whether the answer before was followed, or the robot was at rest."""
        history, last = self._builder.history, self._last()
        if history.fresh:
            return True
        if last is None or history.last_answer is None:
            return False
        status = history.last_answer["extra"][self._builder.columns[2]]
        return status in FOLLOWED or not last[0].any()


def _slow_returns(A: Array, b: Array, lower: Array, upper: Array) -> Array:
    """Limits b, (s,); no return from outside is faster than half of what the joints can do."""
    with np.errstate(invalid="ignore"):
        reach = np.where(A == 0.0, 0.0, np.minimum(A * lower, A * upper)).sum(1)
    return np.where(b < 0.0, np.maximum(b, 0.5 * reach), b)
