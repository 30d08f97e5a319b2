"""`ghc_velocity`: that u answers the stated hierarchy, and what is claimed of the top tasks' V.

Liu, Tan and Padois (2015), (13) with the velocities of section 8.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog

from hoap3.protocol.messages import schema
from hoap3.remote_controller.problems.oracles.parameters import NOT_READ, reason_of
from hoap3.remote_controller.problems.schedule import Priorities, top_tasks
from hoap3.remote_controller.problems.velocity import of_rows, settings_of
from hoap3.tools.verify.claims import RELATIVE, Claims
from hoap3.tools.verify.controller_log import ControllerRun
from hoap3.tools.verify.controllers.velocity.answers import Answers, answers_of
from hoap3.tools.verify.controllers.velocity.hierarchy import Condensed, condensed, multipliers
from hoap3.tools.verify.controllers.velocity.task_stack import Tasks
from hoap3.tools.verify.sent_velocity import DELAYED, check_values

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

DEFAULTS: dict[str, Any] = {"priorities": {}, "regularisation": 1e-6, "smoothing": 0.0}
GAIN_PER_S = 5.0  # of a task
MOST_LOGGED = 6  # tasks whose priorities are columns
STATUS = schema("Setpoint").constants
EPS = float(np.finfo(float).eps)
OPTIMAL = 1e-9  # greatest residual of an answer that counts as the optimum
SMALLEST = 1e-6  # rad/s: velocities below it count as that much in the residual
AT_TARGET = 1e-5  # of |e| of the top tasks [m or rad]
FIRST_ORDER = 0.01  # of V̇: by how much the fall of V in a period may differ
AT_BOUND = 1e-12  # rad/s: as near as that a joint is at its bound
SPANNED = 1e-10  # of the largest eigenvalue of S: less is rounding


@dataclass(frozen=True)
class _Ranks:
    """Priorities of each answer.

    Attributes:
        alpha: (N, k, k).
        settled: whether they rest, (N,).
        top: which tasks V is about, (N, k).
    """

    alpha: Array
    settled: Flags
    top: Flags


def check(run: ControllerRun, parameters: Mapping[str, Any], claims: Claims) -> None:
    """Everything that it claims."""
    try:
        settings = settings_of(parameters, DEFAULTS)
        tasks = Tasks.of(run, settings["tasks"])
        gains = of_rows(tasks.entries, tasks.sizes, "gain_per_s", GAIN_PER_S)
        Priorities(tasks.labels, settings["priorities"])  # which must be readable
    except NOT_READ as error:
        claims.unverified("certificate", len(run.answers), reason_of(error))
        return
    answers = answers_of(run, settings, tasks, _columns(tasks), claims)
    if answers is None:
        return
    try:
        ranks = _ranks(answers.run, lambda: Priorities(tasks.labels, settings["priorities"]))
    except NOT_READ as error:
        claims.unverified("certificate", len(answers.tick), reason_of(error))
        return
    k = len(tasks.labels)
    if k <= MOST_LOGGED:
        stated = answers.run.answers["extra"][:, k:]
        claims.equal("alpha", answers.tick, stated, ranks.alpha.reshape(stated.shape))
    if answers.delayed:
        claims.unverified("u", len(answers.tick), DELAYED)
        return
    told = answers.run.answers["gains"]
    if told.shape[1]:
        claims.equal("gain", answers.tick, told, np.tile(gains, (len(told), 1)), 0.0)
    answers.check_margin(claims)
    check_values(answers.run, settings, claims)
    wanted = -gains * answers.cycles.e - answers.cycles.rate
    weight, width = settings["regularisation"], settings["smoothing"]
    problem = condensed(answers.cycles.J, wanted, tasks.rows, ranks.alpha, weight, width)
    places = [np.linalg.norm((gains * tasks.places)[mine]) for mine in tasks.rows]
    _check_answer(answers, problem, problem.reach @ places, claims)
    _check_certificate(answers, tasks, ranks, claims)


def _columns(tasks: Tasks) -> list[str]:
    names = tasks.labels if len(tasks.labels) <= MOST_LOGGED else []
    errors = [f"error_{label}" for label in tasks.labels]
    return errors + [f"alpha_{a}_{b}" for a in names for b in names]


def _ranks(run: ControllerRun, begin: Callable[[], Priorities]) -> _Ranks:
    """Follow timeline and live changes through the answers of a run.

    Args:
        run: of the controller.
        begin: gives the priorities as they are at each start of the controller.
    """
    ticks, T = run.states["tick"].astype(np.int64), run.description.period_s
    resets, changes = [*run.resets], [*run.changes]
    priorities = begin()
    alpha = priorities.goal
    N, k = len(run.answers), len(alpha)
    found = _Ranks(np.zeros((N, k, k)), np.zeros(N, bool), np.zeros((N, k), bool))
    first, now, top, stale = 0, 0.0, np.zeros(k, bool), True
    for row, place in enumerate(run.answered.tolist()):
        while resets and resets[0] <= place:
            begun = resets.pop(0)
            priorities = begin()
            alpha = priorities.goal
            first, now, top, stale = int(ticks[begun]), 0.0, np.zeros(k, bool), True
            changes = [change for change in changes if change[0] > begun]
        while changes and changes[0][0] <= place:
            priorities.change(changes.pop(0)[1], now)
        now = (int(ticks[place]) - first) * T
        before, alpha = alpha, priorities.at(now)
        settled = bool((alpha == before).all()) and not priorities.under_way
        stale = stale or not settled
        if (settled and stale) or not top.any():
            top, stale = top_tasks(alpha), False
        found.alpha[row], found.settled[row], found.top[row] = alpha, settled, top
    return found


def _check_answer(given: Answers, problem: Condensed, moved_by: Array, claims: Claims) -> None:
    """That u is the optimum within its bounds; where there is none, that joints brake.

    `moved_by`, (N,), is how far u moves with e, of which each component is known to `PLACE`.
    """
    answers, tick, u = given.run.answers, given.tick, given.u
    doubt = given.doubt + moved_by[:, None]
    solved = answers["fallback"] == 0
    near = doubt + AT_BOUND
    lower, upper = u - given.lower <= near, given.upper - u <= near
    mu = multipliers(problem, u, lower, upper)
    moved = (problem.S @ mu[:, :, None])[:, :, 0]
    size = np.linalg.norm(problem.S, axis=(1, 2)) * np.linalg.norm(mu, axis=1)
    span = np.maximum(np.abs(u), np.abs(problem.q0)).max(1).clip(SMALLEST)
    near = doubt + (RELATIVE * span + 8.0 * EPS * size)[:, None]
    held = np.clip(0.0, given.lower, given.upper)
    found = np.where(solved[:, None], problem.q0 + moved, held)
    claims.equal("u", tick, u, found, near)
    residual = np.where(solved, np.abs(u - found).max(1) / span, 0.0)
    exact = np.where(solved, (doubt.max(1) + 8.0 * EPS * size) / span + RELATIVE, 0.0)
    claims.equal("residual", tick, answers["kkt_residual"], residual, exact)
    claims.equal("rho", tick, answers["rho"], solved)
    infeasible = answers["solver_status"] == STATUS["STATUS_INFEASIBLE"]
    claims.equal("infeasible", tick, infeasible, ~solved)
    for k in np.flatnonzero(answers["fallback"] == 1):
        possible = _reaches(problem.S[k], problem.q0[k], given.lower[k], given.upper[k])
        claims.equal("no velocity within the bounds", tick[k], float(possible), 0.0)


def _reaches(S: Array, q0: Array, lower: Array, upper: Array) -> bool:
    """Whether q₀ + Sy is within the bounds for any y, by more than rounding."""
    values, vectors = np.linalg.eigh(S)
    spanned = vectors[:, values > SPANNED * max(values[-1], 0.0)]
    if not spanned.shape[1]:
        return bool(((q0 >= lower) & (q0 <= upper)).all())
    room = np.hstack([np.vstack([spanned, -spanned]), np.ones((2 * len(q0), 1))])
    ends = np.concatenate([upper - q0, q0 - lower])
    aim = np.append(np.zeros(spanned.shape[1]), -1.0)
    limits = [*[(None, None)] * spanned.shape[1], (None, 1.0)]
    found = linprog(aim, A_ub=room, b_ub=ends, bounds=limits)
    return bool(found.success and found.x[-1] > OPTIMAL * (1.0 + np.abs(ends).max()))


def _check_certificate(given: Answers, tasks: Tasks, ranks: _Ranks, claims: Claims) -> None:
    """V of the top tasks, its rate, and what makes an answer certified."""
    answers, tick, cycles = given.run.answers, given.tick, given.cycles
    T, u, doubt = given.run.description.period_s, given.u, given.doubt
    on = np.repeat(ranks.top, tasks.sizes, axis=1).astype(float)  # rows of the top tasks
    place = tasks.places
    V, end = 0.5 * (on * cycles.e**2).sum(1), 0.5 * (on * cycles.ahead**2).sum(1)
    near = RELATIVE * V + (on * (np.abs(cycles.e) * place + place**2)).sum(1)
    claims.equal("V", tick, answers["v"], V, near)
    claims.equal("required V rate", tick, answers["v_rate_required"], np.zeros(len(tick)))
    slope = np.einsum("nm,nmj->nj", on * cycles.e, cycles.J)
    parts = cycles.e * (cycles.rate + (cycles.J @ u[:, :, None])[:, :, 0]) * on
    size = np.abs(cycles.rate) + (np.abs(cycles.J) @ np.abs(u)[:, :, None])[:, :, 0]
    rate, led = parts.sum(1), (np.abs(slope) * doubt).sum(1)
    exact = led + (on * (RELATIVE * np.abs(cycles.e) + place) * size).sum(1)
    claims.equal("predicted V rate", tick, answers["v_rate_predicted"], rate, exact)
    status, residual = answers["solver_status"], answers["kkt_residual"]
    solved = (answers["fallback"] == 0) & ranks.settled & ranks.top.any(1) & (residual <= OPTIMAL)
    stated = status == STATUS["STATUS_AT_TARGET"]
    sure = np.abs(2.0 * answers["v"] - AT_TARGET**2) > RELATIVE * AT_TARGET**2
    arrived = solved & (2.0 * answers["v"] <= AT_TARGET**2)
    sure &= stated  # else an error may be above its tolerance
    claims.equal("at_target", tick[sure], stated[sure], arrived[sure])
    proven = status == STATUS["STATUS_CERTIFIED"]
    ticks = tick[proven]
    claims.equal("certified: solved, at rest", ticks, solved[proven], np.ones(proven.sum()))
    rises = (end - V)[proven]
    steps = ((np.abs(cycles.e) + np.abs(cycles.ahead)) * place + 2.0 * place**2) * on
    rounded = steps.sum(1) + 8.0 * EPS * (V + end)
    claims.at_most("certified: V falls", ticks, rises, 0.0, (rounded + led * T)[proven])
    fall, near = (end - V) / T, rounded / T + led + exact
    apart = (np.abs(fall - rate) - FIRST_ORDER * np.abs(rate))[proven]
    claims.at_most("certified: as V rate says", ticks, apart, 0.0, near[proven])
    claims.at_most("certified: V rate", ticks, rate[proven], 0.0, exact[proven])
