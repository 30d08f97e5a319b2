"""`clik` and `clik_sdp`: that dq follows from the gains, what these certify, and their optimum.

Marti-Saumell et al., (7), (12), (20), (27), with what the controllers add for moving targets.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hoap3.remote_controller.problems.oracles.parameters import UnverifiableError
from hoap3.remote_controller.solvers.clik.constant_gains_reference import constant_gains
from hoap3.tools.verify.claims import RELATIVE, Claims
from hoap3.tools.verify.controller_log import ControllerRun
from hoap3.tools.verify.controllers.velocity.answers import Answers, answers_of
from hoap3.tools.verify.controllers.velocity.clik_certificate import Certificate, Claimed
from hoap3.tools.verify.controllers.velocity.clik_law import Law, certified_rates, fed, law_of
from hoap3.tools.verify.controllers.velocity.gain_optimum import Gains
from hoap3.tools.verify.controllers.velocity.settings import of_rows, settings_of
from hoap3.tools.verify.controllers.velocity.task_stack import (
    PLACE,
    Tasks,
)
from hoap3.tools.verify.sent_velocity import DELAYED, check_values

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

STEADY: dict[str, Any] = {"damping": 0.0, "floor_tolerance": 1e-4}
SDP: dict[str, Any] = {**STEADY, "beta_per_s": 4.0, "delta": 5e-5}
WEIGHT, GAIN_PER_S = 1.0, 1.0  # of a task
FASTEST = 100.0  # of 1/T: a larger β̃ counts as this
FIGURES = ("beta", "beta_actual", "rank", "task_rank", "slack", "remainder", "floor")
MOST_LOGGED = 36  # rows whose gains are columns
OPTIMAL = 1e-9  # greatest gap of optimal gains, of β̃²
ROUNDING = 1e-12  # of a column of B, and rad/s: what is less is none
UNCLEAR = "a joint that only rounding moves is at its bound, and may hold all others back"
OVER = 1e-9  # of β̃ + |limit|: what is cut off as rounding


def check(run: ControllerRun, parameters: Mapping[str, Any], claims: Claims) -> None:
    """Everything that `clik` claims; its gains are those of the config, shortened alike."""
    _check(run, parameters, claims, sdp=False)


def check_sdp(run: ControllerRun, parameters: Mapping[str, Any], claims: Claims) -> None:
    """Everything that `clik_sdp` claims, also that its gains are the best ones."""
    _check(run, parameters, claims, sdp=True)


@dataclass(frozen=True)
class _Motion:
    """What is fed forward of dq = B(Λ e + x), B x, in each cycle.

    Attributes:
        fed: B x, (N, n).
        least, most: limits of dq that allow to stand still, (N, n).
        near: how exactly B x is known, (N, n).
        within: whether the limits allow it, (N,), and
        sure: where that is beyond doubt, (N,).
    """

    fed: Array
    least: Array
    most: Array
    near: Array
    within: Flags
    sure: Flags


@dataclass(frozen=True)
class _Problem:
    """All that the law is made of.

    Attributes:
        answers, law, motion: of each cycle.
        place: how exactly each error is known, (m,).
        gains: λ [1/s], (N, m).
        columns: of `extra`, by name, (N,).
    """

    answers: Answers
    law: Law
    place: Array
    gains: Array
    columns: Mapping[str, Array]
    motion: _Motion

    def way(self) -> tuple[Array, Array]:
        """B Λ e, e = σ* − σ, and how exactly dq is known, both (N, n)."""
        asked, B = self.gains * -self.answers.cycles.e, self.law.B
        size = (np.abs(B) @ np.abs(asked)[:, :, None])[:, :, 0]
        near = self.motion.near + RELATIVE * size + self.law.unsure_of(asked) + self.answers.doubt
        near += (np.abs(B) @ (np.abs(self.gains) * self.place)[:, :, None])[:, :, 0]
        return (B @ asked[:, :, None])[:, :, 0], near


def _check(run: ControllerRun, parameters: Mapping[str, Any], claims: Claims, *, sdp: bool) -> None:
    try:
        settings = settings_of(parameters, SDP if sdp else STEADY)
        tasks = Tasks.of(run, settings["tasks"])
        weights = of_rows(tasks.entries, tasks.sizes, "weight", WEIGHT)
        wanted = of_rows(tasks.entries, tasks.sizes, "gain_per_s", GAIN_PER_S)
    except UnverifiableError as error:
        claims.unverified("certificate", len(run.answers), str(error))
        return
    named = _columns(tasks)
    answers = answers_of(run, settings, tasks, named, claims)
    if answers is None:
        return
    if answers.delayed:
        claims.unverified("u", len(answers.tick), DELAYED)
        return
    law = law_of(answers.cycles.J, tasks.sizes, weights, settings["damping"])
    unclear = _unclear(tasks, law, answers)
    if sdp:  # its solver lets rounding pass, but what is fed forward may be held back
        unclear &= answers.cycles.rate.any(1) & (settings["damping"] == 0.0)
    if unclear.any():
        claims.unverified("u", int(unclear.sum()), UNCLEAR)
        answers, law = answers.only(~unclear), law.only(~unclear)
    gains = _gains(answers.run, named, claims)
    if sdp and gains is None:
        claims.unverified("certificate", len(answers.tick), "the log has no gains")
        return
    if sdp and gains is not None:
        finite: Flags = np.asarray(np.isfinite(gains).all(1))
        claims.equal("gains are numbers", answers.tick, finite, np.ones(len(finite)), 0.0)
        answers, law, gains = answers.only(finite), law.only(finite), gains[finite]
    place = tasks.places
    motion = _motion(answers, law, settings["damping"], place)
    if not sdp:
        gains = _check_steady(answers, law, motion, wanted, gains, claims)
    if not len(answers.tick):
        return
    columns = dict(zip(named, answers.run.answers["extra"].T, strict=True))
    problem = _Problem(answers, law, place, np.asarray(gains), columns, motion)
    _check_answers(problem, tasks, weights, settings, claims, sdp=sdp)


def _check_answers(
    problem: _Problem,
    tasks: Tasks,
    weights: Array,
    settings: Mapping[str, Any],
    claims: Claims,
    *,
    sdp: bool,
) -> None:
    answers, motion = problem.answers, problem.motion
    check_values(answers.run, settings, claims)
    answers.check_margin(claims)
    way, near = problem.way()
    dq = np.clip(motion.fed + way, motion.least, motion.most)
    claims.equal("u", answers.tick, answers.u, np.clip(dq, answers.lower, answers.upper), near)
    _check_rates(problem, claims)
    if sdp:
        _check_optimum(problem, way, near, settings, claims)
    else:
        none = np.zeros(len(answers.tick))
        claims.equal("residual", answers.tick, answers.run.answers["kkt_residual"], none)
        claims.equal("slack", answers.tick, problem.columns["slack"], none)
    exact, sure = _exact(problem, dq, near)
    fed_back = answers.u - motion.fed
    claimed = Claimed(problem.columns, fed_back, problem.law.unsure, exact, sure)
    certificate = Certificate(answers, tasks, weights, claimed)
    certificate.check(settings["floor_tolerance"], claims)


def _unclear(tasks: Tasks, law: Law, answers: Answers) -> Flags:
    """Where a joint that only rounding moves may not move one way: it may hold all back, (N,)."""
    idle = np.abs(law.B) <= ROUNDING * np.linalg.norm(law.B, axis=1)[:, None, :]
    room = np.minimum(np.maximum(answers.upper, 0.0), np.maximum(-answers.lower, 0.0))
    return np.asarray((idle.all(2) & (room <= ROUNDING) & tasks.moved()).any(1))


def _columns(tasks: Tasks) -> list[str]:
    """Names of the columns, as the tasks have them."""
    names = [f"error_{label}" for label in tasks.labels] + list(FIGURES)
    if sum(tasks.sizes) > MOST_LOGGED:
        return names
    for label, size in zip(tasks.labels, tasks.sizes, strict=True):
        ends = [f"_{row + 1}" for row in range(size)] if size > 1 else [""]
        names += [f"gain_{label}{end}" for end in ends]
    return names


def _gains(run: ControllerRun, named: list[str], claims: Claims) -> Array | None:
    """All gains λ [1/s] of each answer, (N, m); None where the log has not all of them.

    Where it has them twice, as an array and as columns, they must agree.
    """
    array: Array = run.answers["gains"].astype(float)
    shown = sum(name.startswith("gain_") for name in named)
    columns: Array = run.answers["extra"][:, len(named) - shown :].astype(float)
    if not array.shape[1]:  # of version 1 of the wire
        return columns if shown else None
    if shown:
        claims.equal("gain in a column", run.answers["tick"], columns, array, 0.0)
    return array


def _motion(answers: Answers, law: Law, damping: float, place: Array) -> _Motion:
    """What is fed forward within the limits; `place` is how exactly each error is known, (m,)."""
    cycles, T = answers.cycles, answers.run.description.period_s
    least, most = np.minimum(answers.lower, 0.0), np.maximum(answers.upper, 0.0)
    moving: Flags = np.asarray(cycles.rate.any(1))
    rates = np.where(moving[:, None], (cycles.e - cycles.along) / T, 0.0)
    given, share = fed(law, cycles.J, rates, least, most, damping)
    near = RELATIVE * np.abs(given) + law.unsure_of(rates)
    near += moving[:, None] * (np.abs(law.B) @ (2.0 * place / T))
    room = np.minimum(given - least, most - given)
    within = (room >= 0.0).all(1) & (share == 1.0)
    sure = (np.abs(room) > near).all(1) & ((share == 1.0) | (share < 1.0 - RELATIVE)) | ~moving
    return _Motion(given, least, most, near, within | ~moving, sure)


def _check_steady(
    answers: Answers, law: Law, motion: _Motion, wanted: Array, stated: Array | None, claims: Claims
) -> Array:
    """The gains of the config, shortened alike until dq keeps its limits, (N, m)."""
    errors = -answers.cycles.e
    found, near = np.zeros(errors.shape), np.zeros(len(errors))
    for k in range(len(found)):
        given = law.B[k], wanted, errors[k], motion.fed[k], motion.least[k], motion.most[k]
        dq, found[k] = constant_gains(*given)
        way = law.B[k] @ (wanted * errors[k])
        held = ((dq == motion.least[k]) | (dq == motion.most[k])) & (way != 0.0)
        size = np.abs(motion.fed[k]) + np.abs(dq)
        rounded = (PLACE * size[held] / np.abs(way[held])).max(initial=0.0)
        near[k] = RELATIVE + law.unsure[k] + rounded
    if stated is not None:
        claims.equal("gain", answers.tick, stated, found, near[:, None] * wanted)
    return found


def _check_rates(problem: _Problem, claims: Claims) -> None:
    """What β the gains certify, and the rank of the Jacobian."""
    answers, law = problem.answers, problem.law
    beta, unsure = certified_rates(law, problem.gains, answers.run.description.period_s)
    near = RELATIVE * np.abs(beta) + unsure
    claims.equal("beta", answers.tick, problem.columns["beta"], beta, near)
    stated, found = problem.columns["task_rank"][law.sure], law.rank[law.sure].astype(float)
    claims.equal("task_rank", answers.tick[law.sure], stated, found, 0.0)


def _check_optimum(
    problem: _Problem, way: Array, near: Array, settings: Mapping[str, Any], claims: Claims
) -> None:
    """That the gains keep the limits, and the objective is as near to its optimum as is claimed."""
    answers, motion, law, tick = problem.answers, problem.motion, problem.law, problem.answers.tick
    T, S = answers.run.description.period_s, law.B * -answers.cycles.e[:, None, :]
    fast = min(settings["beta_per_s"], FASTEST / T)
    least = np.minimum(motion.least - motion.fed, 0.0) / fast
    most = np.maximum(motion.most - motion.fed, 0.0) / fast
    beyond = OVER * (1.0 + np.maximum(most, -least)) + near / fast
    claims.at_most("limits of dq", tick, way / fast, most, beyond)
    claims.at_most("limits of dq", tick, -way / fast, -least, beyond)
    stated = answers.run.answers["kkt_residual"]
    optimal = answers.run.answers["fallback"] == 0
    programs = Gains(law.L, S, least, most, fast * T, settings["delta"], problem.gains / fast)
    gaps = np.minimum(programs.gaps(np.maximum(stated, 0.0) + 0.5 * OPTIMAL), 1.0)
    unproved = ~optimal & (gaps > stated + OPTIMAL)  # that it is false is not proved either
    claims.unverified("residual", int(unproved.sum()), "no multipliers are found that prove it")
    claims.at_most("residual", tick[~unproved], gaps[~unproved], stated[~unproved], OPTIMAL)
    claims.at_most("optimal: residual", tick[optimal], stated[optimal], OPTIMAL, 0.0)
    claims.at_most("residual, at least", tick, -stated, 0.0, 0.0)


def _exact(problem: _Problem, dq: Array, near: Array) -> tuple[Flags, Flags]:
    """Whether u is exactly what the best gains ask for, and where that is beyond doubt, (N,)."""
    answers, motion = problem.answers, problem.motion
    lower, upper = answers.lower, answers.upper
    forced = (lower > 0.0) | (upper < 0.0)  # where 0 stands for the bound
    off = np.maximum(np.maximum(lower - dq, dq - upper), 0.0) * forced
    doubtful = forced & (np.minimum(np.abs(dq - lower), np.abs(upper - dq)) <= near)
    best = answers.run.answers["fallback"] == 0
    cut = (off > near).any(1)
    sure = ~best | (motion.sure & (cut | ~doubtful.any(1)))
    return best & motion.within & ~cut, sure
