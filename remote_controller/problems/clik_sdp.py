"""`clik_sdp` and `clik`: dq follows from gains, which are the best ones, and V falls as certified.

Marti-Saumell et al., (7), (12), (20), (27), and σ̇* of moving targets: dq = B(Λ e + x), where x is
fed forward, and e = σ* − σ is minus the error of the tasks here.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any, ClassVar, NamedTuple

import numpy as np

from hoap3.protocol.messages import Setpoint
from hoap3.remote_controller.problems.gain_program import gap_of
from hoap3.remote_controller.problems.statement import Array, Claim, GainProgram, Problem, Statement
from hoap3.remote_controller.problems.velocity import (
    PLACE,
    Cycle,
    VelocityProblems,
    claim,
    claim_each,
    of_rows,
)
from hoap3.remote_controller.problems.velocity_answer import RELATIVE
from hoap3.remote_controller.solvers.clik.clik_reference import RANK, certified, prioritised
from hoap3.remote_controller.solvers.clik.constant_gains_reference import (
    constant_gains,
    feed_forward,
)

STATUS = Setpoint.schema.constants
WEIGHT, GAIN_PER_S = 1.0, 1.0  # of a task
FASTEST = 100.0  # of 1/T: a larger β̃ counts as this
FIGURES = ("beta", "beta_actual", "rank", "task_rank", "slack", "remainder", "floor")
MAX_LOGGED = 36  # rows whose gains are columns
OPTIMAL = 1e-9  # greatest gap of optimal gains, of β̃²
OVER = 1e-9  # of β̃ + |limit|: what is cut off as rounding
IDLE = 1e-12  # of a column of B, and rad/s: what is less is none
AT_TARGET = 1e-5  # of |e|, all tasks [m or rad]
FIRST_ORDER = 0.01  # of β: by how much V may fall slower
STATIONARY = 1  # `fallback` where no gains have a certificate: all are 0
TINY, SMALLEST = 1e-300, 1e-290  # 1/s: a positive β is not less; a β that near to 0 is 0
EPS = float(np.finfo(float).eps)
ROUNDED = 64.0 * EPS  # times the condition squared, by which B and L may differ
DEPENDENT = 1e-6  # of the length of a row outside others: where rows depend on each other
UNCLEAR = "a joint that only rounding moves is at its bound, and may hold all others back"
UNPROVED = "no multipliers are found that prove it"
NO_GAINS = "the log has no gains"

Optimality = tuple[list[Claim], tuple[Callable[[], Problem], ...], tuple[tuple[str, str], ...]]


class Law(NamedTuple):
    """B, L and how exactly they are known.

    Attributes:
        B: (n, m) of dq = B(Λ e + x).
        L: D J B D⁻¹, D = diag √w, (m, m).
        unsure: share of a column of B, or of L, that rounding may change.
        rank: of the stacked Jacobian; None where rounding may decide it.
    """

    B: Array
    L: Array
    unsure: float
    rank: int | None

    def error_of(self, x: Array) -> float:
        """By how much rounding may change any joint of B x, x (m,): whole columns round alike."""
        return self.unsure * float(np.linalg.norm(self.B, axis=0) @ np.abs(x))


def law_of(J: Array, sizes: Sequence[int], weights: Array, damping: float) -> Law:
    """The law for a stacked Jacobian.

    Args:
        J: ∂e/∂q of all tasks, (m, n), the most important first.
        sizes: rows of each.
        weights: w of V = ½ Σ w e², (m,).
        damping: d of Jᵀ(JJᵀ + d²I)⁻¹ in place of J⁺.
    """
    B, L = prioritised(sizes, J, weights, damping)
    lengths = np.linalg.norm(J, axis=1)
    values = np.linalg.svd(J / np.maximum(lengths, TINY)[:, None], compute_uv=False)
    shares = values / max(values[0], TINY)
    rank, smallest = int((shares > RANK).sum()), float(shares[shares > RANK].min(initial=1.0))
    if rank < len(J):
        smallest = min(smallest, DEPENDENT)
    clear = not ((shares > 1e-3 * RANK) & (shares < 1e3 * RANK)).any()
    return Law(B, L, ROUNDED / smallest**2, rank if clear else None)


@dataclass(frozen=True)
class Motion:
    """What is fed forward of dq = B(Λ e + x), B x.

    Attributes:
        fed, near: B x, and how exactly it is known, (n,).
        least, most: limits of dq that allow to stand still, (n,).
        within: whether they allow B x.
        clear: whether rounding cannot decide that.
    """

    fed: Array
    near: Array
    least: Array
    most: Array
    within: bool
    clear: bool


def motion_of(cycle: Cycle, law: Law, damping: float, T: float) -> Motion:
    """Feed forward how far targets go in the next period, over T."""
    least, most = np.minimum(cycle.lower, 0.0), np.maximum(cycle.upper, 0.0)
    if not cycle.moving:
        none = np.zeros(len(least))
        return Motion(none, none, least, most, within=True, clear=True)
    rates = (cycle.e - cycle.along) / T
    fed, share = feed_forward(law.B, cycle.J @ law.B, rates, least, most, damping)
    near = RELATIVE * np.abs(fed) + law.error_of(rates) + np.abs(law.B) @ (2.0 * cycle.place / T)
    room = np.minimum(fed - least, most - fed)
    clear = bool((np.abs(room) > near).all()) and (share == 1.0 or share < 1.0 - RELATIVE)
    return Motion(fed, near, least, most, bool((room >= 0.0).all()) and share == 1.0, clear)


@dataclass(frozen=True)
class Answer:
    """An answer with all that its law is made of.

    Attributes:
        setpoint, cycle, law, motion: of the cycle.
        gains: λ [1/s], (m,).
        figures: columns of `extra`, by name.
    """

    setpoint: Any
    cycle: Cycle
    law: Law
    motion: Motion
    gains: Array
    figures: Mapping[str, float]

    @cached_property
    def fed_back(self) -> Array:
        """B Λ e, (n,)."""
        return np.asarray(self.law.B @ (self.gains * -self.cycle.e))

    @cached_property
    def near(self) -> Array:
        """How exactly dq is known, (n,)."""
        cycle, asked, B = self.cycle, self.gains * -self.cycle.e, np.abs(self.law.B)
        size = RELATIVE * np.abs(asked) + np.abs(self.gains) * cycle.place
        return self.motion.near + self.law.error_of(asked) + cycle.u_error + B @ size

    @cached_property
    def dq(self) -> Array:
        """What the gains ask for, within the limits that allow to stand still, (n,)."""
        motion = self.motion
        return np.clip(motion.fed + self.fed_back, motion.least, motion.most)

    def exactness(self) -> tuple[bool, bool]:
        """Whether u is what the best gains ask for, and whether rounding cannot decide that.

        A bound that excludes 0 is replaced by 0 in the limits of dq; u is cut to it.
        """
        cycle, dq, near = self.cycle, self.dq, self.near
        forced = (cycle.lower > 0.0) | (cycle.upper < 0.0)
        off = np.maximum(np.maximum(cycle.lower - dq, dq - cycle.upper), 0.0) * forced
        beside = np.minimum(np.abs(dq - cycle.lower), np.abs(cycle.upper - dq)) <= near
        best, cut = bool(self.setpoint["fallback"] == 0), bool((off > near).any())
        sure = not best or (self.motion.clear and (cut or not (forced & beside).any()))
        return best and self.motion.within and not cut, sure


class _ClikProblems(VelocityProblems):
    """What both have.

    Attributes:
        weights: w of V = ½ Σ w e², (m,).
        wanted: gains of the config [1/s], (m,), where it has them.
    """

    weights: Array
    wanted: Array

    def adopt(self, parameters: Mapping[str, Any]) -> None:
        """Take weights as well."""
        super().adopt(parameters)
        self.weights = of_rows(self.entries, self.sizes, "weight", WEIGHT)

    def figures(self) -> list[str]:
        """Of the certificate, and gains of each row."""
        if sum(self.sizes) > MAX_LOGGED:
            return list(FIGURES)
        gains = [
            f"gain_{label}_{row + 1}" if size > 1 else f"gain_{label}"
            for label, size in zip(self.labels, self.sizes, strict=True)
            for row in range(size)
        ]
        return [*FIGURES, *gains]

    @abstractmethod
    def optimality(self, answer: Answer) -> Optimality:
        """Claims, problems and what is unverified of how good the gains are."""

    def may_hold_back(self, cycle: Cycle) -> bool:
        """Whether a joint that only rounding moves may change the answer at its bound."""
        del cycle
        return True

    def used_gains(self, stated: Array | None, parts: tuple[Cycle, Law, Motion]) -> Array | None:
        """λ [1/s] to go on with, (m,)."""
        del parts
        return stated

    def cycle_problem(self, setpoint: Any, cycle: Cycle, claims: list[Claim]) -> Statement:
        """The gains, the velocity that follows from them, and the certificate."""
        damping = self.settings["damping"]
        law = law_of(cycle.J, self.sizes, self.weights, damping)
        if self.may_hold_back(cycle) and self._has_idle_joint(cycle, law):
            return self.unverifiable("unclear", setpoint, claims, [("u", UNCLEAR)])
        motion = motion_of(cycle, law, damping, self.T)
        extra, names = setpoint["extra"], self.columns()
        logged, shown = setpoint["gains"], extra[len(self.labels) + len(FIGURES) :]
        if len(logged) and len(shown):
            claims.append(claim_each("gain in a column", shown, logged, 0.0))
        stated = logged if len(logged) else shown if len(shown) else None
        gains = self.used_gains(stated, (cycle, law, motion))
        if gains is None:
            return self.unverifiable("unclear", setpoint, claims, [("certificate", NO_GAINS)])
        numbers = bool(np.isfinite(gains).all())
        claims.append(claim("gains are numbers", numbers, 1.0, 0.0))
        if not numbers:
            return self.unverifiable("no gains", setpoint, claims, [])
        answer = Answer(setpoint, cycle, law, motion, gains, dict(zip(names, extra, strict=True)))
        u = np.clip(answer.dq, cycle.lower, cycle.upper)
        claims += [claim_each("u", cycle.u, u, answer.near), *self._rate_claims(answer)]
        if stated is not None and stated is not gains:
            claims.append(self._gain_claim(answer, stated))
        more, problems, unverified = self.optimality(answer)
        claims += more + self._value_claims(answer)
        branch, values = f"fallback {int(setpoint['fallback'])}", setpoint["values"]
        return Statement(branch, problems, values, 0.0 * values, tuple(claims), unverified)

    def _has_idle_joint(self, cycle: Cycle, law: Law) -> bool:
        """Whether a joint that only rounding moves may not move one way: it may hold all back."""
        rounding = IDLE * np.linalg.norm(law.B, axis=0)
        idle = (np.abs(law.B) <= rounding).all(1)
        room = np.minimum(np.maximum(cycle.upper, 0.0), np.maximum(-cycle.lower, 0.0))
        moved = np.logical_or.reduce([task.moved(self.robot) for task in self.tasks])
        return bool((idle & (room <= IDLE) & moved).any())

    def _rate_claims(self, answer: Answer) -> list[Claim]:
        """What β the gains certify, λ_min(C(λ, 0)), and the rank of the Jacobian."""
        law, figures = answer.law, answer.figures
        beta = certified(law.L, answer.gains, self.T)
        size = float(np.linalg.norm(law.L * answer.gains))
        near = RELATIVE * abs(beta) + 2.0 * size * (law.unsure + ROUNDED) + SMALLEST
        claims = [claim("beta", figures["beta"], beta, near)]
        if law.rank is not None:
            claims.append(claim("task_rank", figures["task_rank"], law.rank, 0.0))
        return claims

    def _gain_claim(self, answer: Answer, stated: Array) -> Claim:
        """Constant gains, shortened alike: rounding moves the joint that holds them back."""
        way, dq, motion = answer.law.B @ (self.wanted * -answer.cycle.e), answer.dq, answer.motion
        held = ((dq == motion.least) | (dq == motion.most)) & (way != 0.0)
        size = (np.abs(motion.fed) + np.abs(dq))[held] / np.abs(way[held])
        near = RELATIVE + answer.law.unsure + PLACE * size.max(initial=0.0)
        return claim_each("gain", stated, answer.gains, near * self.wanted)

    def _value_claims(self, answer: Answer) -> list[Claim]:
        """V = ½ Σ w e², how fast it falls, and what is certified of it."""
        setpoint, cycle, T, w = answer.setpoint, answer.cycle, self.T, self.weights
        place, e, ahead = cycle.place, np.abs(cycle.e), np.abs(cycle.ahead)
        V, end = 0.5 * float(cycle.e**2 @ w), 0.5 * float(cycle.ahead**2 @ w)
        V_near = RELATIVE * V + float((e * place + place**2) @ w)
        slope = np.abs((w * cycle.e) @ cycle.J)
        rounded = 8.0 * EPS * (V + end) + float(((e + ahead) * place + 2.0 * place**2) @ w)
        fall_near = rounded / T + float(slope @ cycle.u_error)
        actual = (V - end) / (V * T) if V > 0.0 else 0.0
        near = (fall_near + abs(actual) * V_near) / V + RELATIVE * abs(actual) if V > 0.0 else 0.0
        (exact, sure), rho = answer.exactness(), float(setpoint["rho"])
        found = float(exact) if sure else float(rho > 0.5)
        claims = [
            claim("V", setpoint["v"], V, V_near),
            claim("beta_actual", answer.figures["beta_actual"], actual, near),
            claim("rho", rho, found),
        ]
        if setpoint["solver_status"] in {STATUS["STATUS_CERTIFIED"], STATUS["STATUS_AT_TARGET"]}:
            claims.append(claim("certified: rho", rho, 1.0))
        if cycle.moving:
            fall = (end - V) / T
            exactly = RELATIVE * abs(fall) + fall_near
            claims.append(claim("predicted V rate", setpoint["v_rate_predicted"], fall, exactly))
            return claims + self._moving_claims(answer)
        return claims + self._standing_claims(answer, actual, near)

    def _standing_claims(self, answer: Answer, actual: float, near: float) -> list[Claim]:
        """With targets that stand: V⁺ ≤ (1 − βT) V, (12)."""
        setpoint, cycle, w = answer.setpoint, answer.cycle, self.weights
        pull, size = w * cycle.e, np.abs(cycle.J) @ np.abs(cycle.u)
        exactly = float((RELATIVE * np.abs(pull) + PLACE * w) @ size)
        exactly += float(np.abs(pull @ cycle.J) @ cycle.u_error)
        beta, status = answer.figures["beta"], setpoint["solver_status"]
        arrived = status == STATUS["STATUS_AT_TARGET"]
        required = 0.0 if arrived else -max(beta, 0.0) * float(setpoint["v"])
        rate = float(pull @ (cycle.J @ cycle.u))
        claims = [
            claim("predicted V rate", setpoint["v_rate_predicted"], rate, exactly),
            claim("required V rate", setpoint["v_rate_required"], required),
            claim("remainder", answer.figures["remainder"], 0.0),
            claim("floor", answer.figures["floor"], 0.0),
        ]
        length = float(np.linalg.norm(setpoint["extra"][: len(self.labels)]))
        if arrived and abs(length - AT_TARGET) > RELATIVE * AT_TARGET:
            claims.append(claim("at_target", 1.0, setpoint["rho"] == 1.0 and length <= AT_TARGET))
        if status == STATUS["STATUS_CERTIFIED"]:
            slow = (1.0 - FIRST_ORDER) * beta - actual
            claims.append(claim("certified: V falls", slow, 0.0, near, "at_most"))
            claims.append(claim("certified: beta", beta, TINY, 0.0, "at_least"))
        return claims

    def _moving_claims(self, answer: Answer) -> list[Claim]:
        """With moving targets: √V⁺ ≤ √(1 − βT)·√V + r, and the floor that follows."""
        setpoint, cycle, figures, T = answer.setpoint, answer.cycle, answer.figures, self.T
        w, V, status = self.weights, float(setpoint["v"]), setpoint["solver_status"]
        back = cycle.u - answer.motion.fed
        rest = cycle.e + T * (cycle.J @ back) - cycle.ahead  # −ρ, of e⁺ = (I − T L Λ)e + ρ
        r = float(np.sqrt(0.5 * (rest**2 @ w)))
        off = T * (RELATIVE + answer.law.unsure) * (np.abs(cycle.J) @ np.abs(back))
        off += 4.0 * EPS * np.abs(cycle.e)
        near = float(np.sqrt(0.5 * (off**2 @ w)) + 3.0 * np.sqrt(0.5 * (cycle.place**2 @ w)))
        stated = figures["remainder"]
        kept = np.sqrt(max(1.0 - max(figures["beta"], 0.0) * T, 0.0))
        bound = (kept * np.sqrt(V) + stated) ** 2
        exactly = (RELATIVE * abs(bound - V) + 8.0 * EPS * (bound + V)) / T
        floor = np.sqrt(2.0) * stated / (1.0 - kept) if kept < 1.0 else np.inf
        told = floor if kept < 1.0 else -1.0
        floor_near = abs(told) * (RELATIVE + 4.0 * EPS / (1.0 - kept if kept < 1.0 else 1.0))
        claims = [
            claim("remainder", stated, r, near + RELATIVE * r),
            claim("required V rate", setpoint["v_rate_required"], (bound - V) / T, exactly),
            claim("floor", figures["floor"], told, floor_near),
            claim("at_target", status == STATUS["STATUS_AT_TARGET"], 0.0),
        ]
        if status == STATUS["STATUS_CERTIFIED"]:
            most = self.settings["floor_tolerance"]
            claims.append(claim("certified: floor", floor, most, floor_near, "at_most"))
        return claims


class ClikSdpProblems(_ClikProblems):
    """`clik_sdp`: the gains are the optimum of a semidefinite program, to `kkt_residual`."""

    controller = "clik_sdp"
    defaults: ClassVar[Mapping[str, Any]] = {
        "damping": 0.0,
        "floor_tolerance": 1e-4,
        "beta_per_s": 4.0,
        "delta": 5e-5,
    }

    def may_hold_back(self, cycle: Cycle) -> bool:
        """Only of what is fed forward: the solver ignores rounding."""
        return cycle.moving and self.settings["damping"] == 0.0

    def optimality(self, answer: Answer) -> Optimality:
        """The program's optimum, to the stated residual; other gains keep the limits at least."""
        stated, program = float(answer.setpoint["kkt_residual"]), self._program(answer)
        claims = [claim("residual, at least", stated, 0.0, 0.0, "at_least")]
        if answer.setpoint["fallback"] == 0:
            claims.append(claim("optimal: residual", stated, OPTIMAL, 0.0, "at_most"))
            return claims, (partial(replace, program, gap=stated + OPTIMAL),), ()
        if answer.setpoint["fallback"] == STATIONARY:
            claims.append(claim("no certificate: gains", np.abs(answer.gains).max(), 0.0, 0.0))
        gap = min(gap_of(program, max(stated, 0.0) + 0.5 * OPTIMAL), 1.0)
        if gap <= stated + OPTIMAL:
            claims.append(claim("residual", stated, gap, OPTIMAL, "at_least"))
            return claims, (partial(replace, program),), ()
        # it is a bound of the gap: that this is larger than stated is not proved either
        return claims, (partial(replace, program),), (("residual", UNPROVED),)

    def _program(self, answer: Answer) -> GainProgram:
        """(27) in units of β̃, whose gap may be anything."""
        motion, law = answer.motion, answer.law
        fast = min(self.settings["beta_per_s"], FASTEST / self.T)
        least = np.minimum(motion.least - motion.fed, 0.0) / fast
        most = np.maximum(motion.most - motion.fed, 0.0) / fast
        error = OVER * (1.0 + np.maximum(most, -least)) + answer.near / fast
        S, gains = law.B * -answer.cycle.e, answer.gains / fast
        dt, delta = fast * self.T, float(self.settings["delta"])
        return GainProgram(law.L, S, least, most, error, dt, delta, gains, np.inf)


class ClikProblems(_ClikProblems):
    """`clik`: the gains are those of the config, shortened alike until dq keeps its limits."""

    controller = "clik"
    defaults: ClassVar[Mapping[str, Any]] = {"damping": 0.0, "floor_tolerance": 1e-4}

    def adopt(self, parameters: Mapping[str, Any]) -> None:
        """Take gains as well."""
        super().adopt(parameters)
        self.wanted = of_rows(self.entries, self.sizes, "gain_per_s", GAIN_PER_S)

    def used_gains(self, stated: Array | None, parts: tuple[Cycle, Law, Motion]) -> Array | None:
        """Recomputed, whatever is logged."""
        del stated
        cycle, law, motion = parts
        limits = motion.fed, motion.least, motion.most
        return constant_gains(law.B, self.wanted, -cycle.e, *limits)[1]

    def optimality(self, answer: Answer) -> Optimality:
        """Nothing is optimised."""
        residual = claim("residual", answer.setpoint["kkt_residual"], 0.0)
        return [residual, claim("slack", answer.figures["slack"], 0.0)], (), ()
