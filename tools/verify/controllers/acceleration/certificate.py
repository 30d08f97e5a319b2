"""What all controllers of several tasks claim of an answer, beside that it is the optimum.

V = ½ Σ |e|² of the tasks that nothing stands above; V̇ half a period on; the most that V may rise
by within the period; errors, weights or priorities; and the distance from all bounds.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.messages import COMMANDS, schema
from hoap3.remote_controller.controllers.certificate import STATIONARY
from hoap3.remote_controller.problems.oracles.tasks.acceleration_oracle import ROUNDING
from hoap3.remote_controller.problems.oracles.tasks.wrench_oracle import WrenchTask, columns_of
from hoap3.tools.verify.claims import RELATIVE, Claims
from hoap3.tools.verify.controller_log import ControllerRun
from hoap3.tools.verify.controllers.acceleration.answers import ACTIVE, INFEASIBLE
from hoap3.tools.verify.controllers.acceleration.hierarchy import (
    Cycles,
    Hierarchy,
    has_decision,
    rounding_of,
)

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

STATUS = schema("Setpoint").constants
UNSURE = 1e-2  # of an acceleration, and of 1 m/s², in what V may rise by
OPTIMAL = 1e-9  # greatest residual of a certified answer
SOLVED, STOPPED = 0, 4  # Setpoint.fallback


@dataclass(frozen=True)
class Solution:
    """Whether the answers are the optimum of the tasks' problem.

    Attributes:
        residual: how far they are from it, (N,).
        exact: how exactly that is known, (N,).
        proves: whether the controller says the residual, and certifies by it.
    """

    residual: Array
    exact: Array
    proves: bool


def check_lyapunov(
    run: ControllerRun, cycles: Cycles, hierarchy: Hierarchy, tops: Flags, claims: Claims
) -> None:
    """V and its rates, and how many joints move; tops: (N, k)."""
    answers, tick, rows = run.answers, run.answers["tick"], cycles.rows
    T = hierarchy.description.period_s
    top = np.repeat(tops, hierarchy.sizes, axis=1)
    e_exact, nu_exact, rate_exact = np.moveaxis(rows.exact, 1, 0)
    error = np.where(top, np.abs(rows.error), 0.0)
    V, off = 0.5 * (error**2).sum(1), (error * e_exact).sum(1) + (e_exact**2).sum(1)
    claims.equal("V", tick, answers["v"], V, RELATIVE * V + off)
    slope = np.where(top, rows.slope, 0.0)
    slope_exact = np.where(top, e_exact, 0.0)
    change = rows.rate + (rows.jacobian @ cycles.ddq[..., None])[..., 0]
    ddq_doubt = cycles.ddq_exact + ROUNDING * np.abs(cycles.ddq)
    change_exact = rate_exact + (np.abs(rows.jacobian) @ ddq_doubt[..., None])[..., 0]
    moving = rows.motion + 0.5 * T * change
    moving_exact = nu_exact + 0.5 * T * change_exact + RELATIVE * np.abs(moving)
    rate = (slope * moving).sum(1)
    off = (np.abs(slope) * moving_exact + slope_exact * np.abs(moving)).sum(1)
    claims.equal("predicted V rate", tick, answers["v_rate_predicted"], rate, off)
    square = np.where(top, moving**2, 0.0).sum(1)
    growth = rate + 2.0 * T * square + UNSURE * T * (np.abs(slope) * (np.abs(change) + 1.0)).sum(1)
    off += 4.0 * T * np.where(top, np.abs(moving) * moving_exact, 0.0).sum(1)
    off += UNSURE * T * (np.abs(slope) * change_exact + slope_exact * (np.abs(change) + 1.0)).sum(1)
    required = np.maximum(growth, 0.0)
    off += RELATIVE * required
    claims.equal("required V rate", tick, answers["v_rate_required"], required, off)
    speed, near = np.abs(cycles.dq + T * cycles.ddq), T * cycles.ddq_exact + RELATIVE * ACTIVE
    least, most = ((speed >= ACTIVE + sign * near).sum(1) for sign in (1.0, -1.0))
    stated = answers["active_joints"].astype(float)
    claims.equal("active joints", tick, stated, np.clip(stated, least, most), 0.0)


def check_columns(
    run: ControllerRun, cycles: Cycles, hierarchy: Hierarchy, names: Sequence[str], claims: Claims
) -> None:
    """Errors of all tasks, and their weights or priorities, in `extra`."""
    answers, tick = run.answers, run.answers["tick"]
    columns = {name: place for place, name in enumerate(run.session.get("extra") or ())}
    e_exact = cycles.rows.exact[:, 0]
    for name, span in zip(names, hierarchy.spans, strict=True):
        error = np.linalg.norm(cycles.rows.error[:, span], axis=1)
        off = RELATIVE * error + np.linalg.norm(e_exact[:, span], axis=1)
        stated = answers["extra"][:, columns[f"error_{name}"]]
        claims.equal("error", tick, stated, error, off)
    pressing = [(name, task) for name, task in zip(names, hierarchy.tasks, strict=True)]
    felt = [
        c for name, task in pressing if isinstance(task, WrenchTask) for c in columns_of(task, name)
    ]
    for label, found in zip(felt, cycles.measured.T, strict=True):
        off = RELATIVE * (1.0 + np.abs(found))
        claims.equal("wrench", tick, answers["extra"][:, columns[label]], found, off)
    square = cycles.numbers.ndim == 3
    labels = [f"alpha_{a}_{b}" for a in names for b in names] if square else []
    labels = labels if square else [f"weight_{name}" for name in names]
    numbers = cycles.numbers.reshape(len(tick), -1)
    for label, found in zip(labels, numbers.T, strict=True):
        if label in columns:
            stated, off = answers["extra"][:, columns[label]], RELATIVE * np.maximum(1.0, found)
            claims.equal(label.partition("_")[0], tick, stated, found, off)


def check_bounds(run: ControllerRun, cycles: Cycles, hierarchy: Hierarchy, claims: Claims) -> None:
    """The command itself, the greatest share of a torque, and the least distance from a bound."""
    answers, tick = run.answers, run.answers["tick"]
    kind = COMMANDS["torque" if hierarchy.torques else "acceleration"]
    claims.equal("command", tick, answers["command"], np.full(len(tick), kind))
    if has_decision(run, 2 * hierarchy.description.n):
        _check_decision(run, cycles, hierarchy, claims)
    greatest, most = hierarchy.bounds.scale, hierarchy.torque_max
    share = (np.abs(cycles.tau) / most).max(1)
    off = RELATIVE * share + (cycles.tau_exact / most).max(1)
    columns = list(run.session.get("extra") or ())
    stated = answers["extra"][:, columns.index("largest_torque_share")]
    claims.equal("largest torque share", tick, stated, share, off)
    room = np.minimum(cycles.ddq - cycles.lower, cycles.upper - cycles.ddq) / greatest
    size = np.minimum(np.abs(cycles.ddq), 10.0 * greatest) / greatest
    off += (cycles.ddq_exact / greatest).max(1) + RELATIVE * np.maximum(1.0, size.max(1))
    margin = np.minimum(np.minimum(1.0, room.min(1)), 1.0 - share)
    claims.equal("margin", tick, answers["margin"], margin, off)


def _check_decision(
    run: ControllerRun, cycles: Cycles, hierarchy: Hierarchy, claims: Claims
) -> None:
    """Of a log that has q̈ and τ themselves: τ = M·q̈ + h, and the setpoint is one of them."""
    answers, tick, ddq, h = run.answers, run.answers["tick"], cycles.ddq, cycles.bias
    tau = (cycles.mass @ ddq[..., None])[..., 0] + h
    off = np.broadcast_to(rounding_of(cycles.mass, h, cycles.dq, ddq), tau.shape)
    claims.equal("torques", tick, cycles.tau, tau, off)
    sent = cycles.tau - cycles.weight if hierarchy.torques else ddq
    size = np.abs(cycles.tau) + np.abs(cycles.weight) if hierarchy.torques else np.abs(ddq)
    claims.equal("setpoint", tick, answers["values"], sent, ROUNDING * size)


def check_proof(
    run: ControllerRun,
    cycles: Cycles,
    hierarchy: Hierarchy,
    solution: Solution,
    tops: Flags,
    claims: Claims,
) -> None:
    """The residual, which answers count as certified, and what else follows from `fallback`."""
    answers, tick = run.answers, run.answers["tick"]
    claims.equal("rho", tick, answers["rho"], np.ones(len(tick)))
    fallback, path = answers["fallback"], answers["solver_path"]
    stops = fallback == STOPPED
    claims.equal("solver path", tick[~stops], path[~stops], fallback[~stops], 0.0)
    solved = fallback == SOLVED
    stated, residual = answers["kkt_residual"], solution.residual
    off = np.maximum(solution.exact, OPTIMAL) if solution.proves else np.zeros_like(residual)
    found = residual if solution.proves else np.zeros_like(residual)
    claims.equal("residual", tick[solved], stated[solved], found[solved], off[solved])
    claims.equal("residual", tick[~solved], stated[~solved], np.zeros((~solved).sum()), 0.0)
    if not solution.proves:
        bound = OPTIMAL + solution.exact[solved]
        claims.at_most("optimum", tick[solved], residual[solved], bound, 0.0)
    proven = answers["solver_status"] == STATUS["STATUS_CERTIFIED"]
    bound = OPTIMAL + solution.exact[proven]
    claims.at_most("certified: residual", tick[proven], residual[proven], bound, 0.0)
    load = (np.abs(cycles.bias) / hierarchy.torque_max).max(1)
    may = solved & ~cycles.moved & ~cycles.touches & tops.any(1) & (stated <= OPTIMAL)
    may &= solution.proves and hierarchy.bounds.kind == "viability"
    near = np.abs(load - 1.0) <= ROUNDING * np.maximum(load, 1.0)
    may &= ((load <= 1.0) | (near & proven)) & ~run.during(STATIONARY)
    status = np.where(may, STATUS["STATUS_CERTIFIED"], STATUS["STATUS_UNCERTIFIED"])
    status[~solved] = INFEASIBLE
    claims.equal("status", tick, answers["solver_status"], status, 0.0)
