"""`clik` and `clik_sdp`: that dq follows from the gains, what these certify, and their optimum.

Marti-Saumell et al., (7), (12), (20), (27), with what the controllers add for moving targets.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hoap3.remote_controller.solvers.clik.constant_gains_reference import constant_gains
from hoap3.tools.verify.claims import RELATIVE, Claims
from hoap3.tools.verify.controller_log import ControllerRun
from hoap3.tools.verify.controllers.velocity.clik_certificate import Certificate, Claimed
from hoap3.tools.verify.controllers.velocity.clik_law import Law, certified_rates, fed, law_of
from hoap3.tools.verify.controllers.velocity.gain_optimum import Gains
from hoap3.tools.verify.controllers.velocity.joint_bounds import bounds_of
from hoap3.tools.verify.controllers.velocity.settings import of_rows, settings_of
from hoap3.tools.verify.controllers.velocity.task_stack import (
    PLACE,
    Cycles,
    Tasks,
    check_errors,
    check_margin,
)
from hoap3.tools.verify.sent_velocity import DELAYED, check_values, judged, sent_velocity
from hoap3.tools.verify.tasks.targets import UnknownTaskError

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

STEADY: dict[str, Any] = {"damping": 0.0, "floor_tolerance": 1e-4}
SDP: dict[str, Any] = {**STEADY, "beta_per_s": 4.0, "delta": 5e-5}
WEIGHT, GAIN_PER_S = 1.0, 1.0  # of a task
FASTEST = 100.0  # of 1/T: a larger β̃ counts as this
FIGURES = ("beta", "beta_actual", "rank", "task_rank", "slack", "remainder", "floor")
MOST_LOGGED = 36  # rows whose gains are columns
OPTIMAL = 1e-9  # greatest gap of optimal gains, of β̃²
OVER = 1e-9  # of β̃ + |limit|: what is cut off as rounding


def check(run: ControllerRun, parameters: Mapping[str, Any], claims: Claims) -> None:
    """Everything that `clik` claims; its gains are those of the config, shortened alike."""
    _check(run, parameters, claims, sdp=False)


def check_sdp(run: ControllerRun, parameters: Mapping[str, Any], claims: Claims) -> None:
    """Everything that `clik_sdp` claims, also that its gains are the best ones."""
    _check(run, parameters, claims, sdp=True)


@dataclass(frozen=True)
class _Motion:
    """What dq = B(Λ e + x) is made of in each cycle; all (N, n) but `within`.

    Attributes:
        fed: B x.
        way: B Λ e.
        least, most: limits of dq that allow to stand still.
        near: how exactly dq is known.
        within: whether the limits allow what is fed forward, (N,), and
        sure: where that is beyond doubt, (N,).
    """

    fed: Array
    way: Array
    least: Array
    most: Array
    near: Array
    within: Flags
    sure: Flags


def _check(run: ControllerRun, parameters: Mapping[str, Any], claims: Claims, *, sdp: bool) -> None:
    try:
        settings = settings_of(parameters, SDP if sdp else STEADY)
        tasks = Tasks.of(run.description, settings["tasks"])
        weights = of_rows(tasks.entries, tasks.sizes, "weight", WEIGHT)
        wanted = of_rows(tasks.entries, tasks.sizes, "gain_per_s", GAIN_PER_S)
    except UnknownTaskError as error:
        claims.unverified("certificate", len(run.answers), str(error))
        return
    named = _columns(tasks)
    delayed = run.description.delay_ticks > 0
    if list(run.session.get("extra", ())) != named:
        claims.unverified("certificate", len(run.answers), "the columns are not its tasks'")
        return
    if delayed and settings["kinematics_from"] == "reference":
        claims.unverified("certificate", len(run.answers), DELAYED)
        return
    run = judged(run, claims)
    if not len(run.answers):
        return
    base = run.states["q" if settings["kinematics_from"] == "measured" else "reference"]
    u, doubt = sent_velocity(run, settings)
    cycles = tasks.over(run, base, u)
    check_errors(tasks, cycles, run, claims)
    if delayed:
        claims.unverified("u", len(run.answers), DELAYED)
        return
    columns = dict(zip(named, run.answers["extra"].T, strict=True))
    law = law_of(cycles.J, tasks.sizes, weights, settings["damping"])
    lower, upper = bounds_of(run, settings["bounds"])
    motion = _motion(run, cycles, law, lower, upper, settings["damping"])
    gains = _gains(run, named, sum(tasks.sizes))
    if not sdp:
        steady, near = _steady_gains(cycles, law, motion, wanted)
        if gains is not None:
            claims.equal("gain", run.answers["tick"], gains, steady, near)
        gains = steady
    if gains is None:
        claims.unverified("certificate", len(run.answers), "the log has no gains")
        return
    motion = _with_gains(motion, law, gains, cycles, doubt)
    _check_law(run, law, motion, gains, columns, (u, doubt), (lower, upper), claims)
    if sdp:
        _check_optimum(run, cycles, law, motion, gains, settings, claims)
    else:
        claims.equal("residual", run.answers["tick"], run.answers["kkt_residual"], 0.0 * u[:, 0])
        claims.equal("slack", run.answers["tick"], columns["slack"], 0.0 * u[:, 0])
    exact, sure = _exact(run, motion, lower, upper)
    claimed = Claimed(columns, u, doubt, u - motion.fed, law.unsure, exact, sure)
    check_values(run, settings, claims)
    certificate = Certificate(run, tasks, cycles, weights, claimed)
    certificate.check(settings["floor_tolerance"], claims)


def _columns(tasks: Tasks) -> list[str]:
    """Names of the columns, as the tasks have them."""
    names = [f"error_{label}" for label in tasks.labels] + list(FIGURES)
    if sum(tasks.sizes) > MOST_LOGGED:
        return names
    for label, size in zip(tasks.labels, tasks.sizes, strict=True):
        ends = [f"_{row + 1}" for row in range(size)] if size > 1 else [""]
        names += [f"gain_{label}{end}" for end in ends]
    return names


def _gains(run: ControllerRun, named: list[str], rows: int) -> Array | None:
    """All gains λ [1/s] of each answer, (N, m); None where the log has not all of them."""
    answers = run.answers
    if "gains" in (answers.dtype.names or ()) and answers["gains"].shape[1] == rows:
        return np.asarray(answers["gains"], float)
    if sum(name.startswith("gain_") for name in named) >= rows:
        return np.asarray(answers["extra"][:, -rows:], float)
    return None


def _motion(
    run: ControllerRun, cycles: Cycles, law: Law, lower: Array, upper: Array, damping: float
) -> _Motion:
    """What is fed forward within the limits."""
    T, least, most = run.description.period_s, np.minimum(lower, 0.0), np.maximum(upper, 0.0)
    moving: Flags = np.asarray(cycles.rate.any(1))
    rates = np.where(moving[:, None], (cycles.e - cycles.along) / T, 0.0)
    given, share = fed(law, cycles.J, rates, least, most, damping)
    near = RELATIVE * np.abs(given) + law.unsure_of(rates)
    room = np.minimum(given - least, most - given)
    within = (room >= 0.0).all(1) & (share == 1.0)
    sure = (np.abs(room) > near).all(1) & ((share == 1.0) | (share < 1.0 - RELATIVE)) | ~moving
    return _Motion(given, 0.0 * given, least, most, near, within | ~moving, sure)


def _with_gains(motion: _Motion, law: Law, gains: Array, cycles: Cycles, doubt: Array) -> _Motion:
    """The same with B Λ e, e = σ* − σ."""
    asked = gains * -cycles.e
    way = (law.B @ asked[:, :, None])[:, :, 0]
    size = (np.abs(law.B) @ np.abs(asked)[:, :, None])[:, :, 0]
    near = motion.near + RELATIVE * size + law.unsure_of(asked) + doubt
    return _Motion(motion.fed, way, motion.least, motion.most, near, motion.within, motion.sure)


def _steady_gains(cycles: Cycles, law: Law, motion: _Motion, wanted: Array) -> tuple[Array, Array]:
    """Gains of the config, shortened alike until dq keeps its limits, and how exactly, (N, m)."""
    found, near = np.zeros(cycles.e.shape), np.zeros(len(cycles.e))
    for k in range(len(found)):
        given = law.B[k], wanted, -cycles.e[k], motion.fed[k], motion.least[k], motion.most[k]
        dq, found[k] = constant_gains(*given)
        way = law.B[k] @ (wanted * -cycles.e[k])
        held = ((dq == motion.least[k]) | (dq == motion.most[k])) & (way != 0.0)
        size = np.abs(motion.fed[k]) + np.abs(dq)
        rounded = (PLACE * size[held] / np.abs(way[held])).max(initial=0.0)
        near[k] = RELATIVE + law.unsure[k] + rounded
    return found, near[:, None] * wanted


def _check_law(
    run: ControllerRun,
    law: Law,
    motion: _Motion,
    gains: Array,
    columns: Mapping[str, Array],
    sent: tuple[Array, Array],
    bounds: tuple[Array, Array],
    claims: Claims,
) -> None:
    """That u is what the gains ask for, within its bounds, and what β they certify."""
    tick, T, u = run.answers["tick"], run.description.period_s, sent[0]
    dq = np.clip(motion.fed + motion.way, motion.least, motion.most)
    claims.equal("u", tick, u, np.clip(dq, *bounds), motion.near)
    check_margin(run, sent, bounds, claims)
    beta, unsure = certified_rates(law, gains, T)
    claims.equal("beta", tick, columns["beta"], beta, RELATIVE * np.abs(beta) + unsure)
    stated = columns["task_rank"][law.sure]
    claims.equal("task_rank", tick[law.sure], stated, law.rank[law.sure].astype(float), 0.0)


def _check_optimum(
    run: ControllerRun,
    cycles: Cycles,
    law: Law,
    motion: _Motion,
    gains: Array,
    settings: Mapping[str, Any],
    claims: Claims,
) -> None:
    """That the gains keep the limits, and the objective is as near to its optimum as is claimed."""
    answers, T = run.answers, run.description.period_s
    fast, S = min(settings["beta_per_s"], FASTEST / T), law.B * -cycles.e[:, None, :]
    least = np.minimum(motion.least - motion.fed, 0.0) / fast
    most = np.maximum(motion.most - motion.fed, 0.0) / fast
    limit = OVER * (1.0 + np.maximum(most, -least)) + motion.near / fast
    claims.at_most("limits of dq", answers["tick"], motion.way / fast, most, limit)
    claims.at_most("limits of dq", answers["tick"], -motion.way / fast, -least, limit)
    stated, optimal = answers["kkt_residual"], answers["fallback"] == 0
    problems = Gains(law.L, S, least, most, fast * T, settings["delta"], gains / fast)
    gaps = problems.gaps(np.maximum(stated, 0.0) + 0.5 * OPTIMAL)
    claims.at_most("residual", answers["tick"], gaps, stated, OPTIMAL)
    ticks = answers["tick"][optimal]
    claims.at_most("optimal: residual", ticks, stated[optimal], OPTIMAL, 0.0)
    claims.at_most("residual, at least", answers["tick"], -stated, 0.0, 0.0)


def _exact(run: ControllerRun, motion: _Motion, lower: Array, upper: Array) -> tuple[Flags, Flags]:
    """Whether u is exactly what the best gains ask for, and where that is beyond doubt, (N,)."""
    dq = np.clip(motion.fed + motion.way, motion.least, motion.most)
    forced = (lower > 0.0) | (upper < 0.0)  # where 0 stands for the bound
    off = np.maximum(np.maximum(lower - dq, dq - upper), 0.0) * forced
    doubtful = forced & (np.minimum(np.abs(dq - lower), np.abs(upper - dq)) <= motion.near)
    best = run.answers["fallback"] == 0
    cut = (off > motion.near).any(1)
    exact = best & motion.within & ~cut
    sure = ~best | (motion.sure & (cut | ~doubtful.any(1)))
    return exact, sure
