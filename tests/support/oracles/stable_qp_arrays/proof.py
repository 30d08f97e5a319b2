"""Whether answers of `stable_qp` keep the constraints and are optimal, and ρ is the largest."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.robot.description import RobotDescription
from hoap3.remote_controller.problems.stable_qp_settings import Settings
from hoap3.tools.verify.claims import RELATIVE, Claims
from support.oracles.stable_qp_arrays import farkas
from support.oracles.stable_qp_arrays.answers import (
    ANSWERED,
    FOLLOWED,
    INFEASIBLE,
    STATIONARY,
    Answers,
)
from support.oracles.stable_qp_arrays.certificate import CERTIFIED
from support.oracles.stable_qp_arrays.judge import Judge
from support.oracles.stable_qp_arrays.largest import KEPT, SOLVED, Missing
from support.oracles.stable_qp_arrays.problem import Cycle
from support.oracles.stable_qp_arrays.scaled import Objective, Stacked
from support.oracles.stable_qp_arrays.slower import with_speeds

Array = NDArray[np.float64]

OPTIMAL = 1e-9  # greatest residual of a certified answer
CURVATURE = 1e-6  # of a margin: what a certified answer may find it below 0


def check_proof(
    chunk: Sequence[Cycle],
    sent: Answers,
    margins: tuple[Array, Array],
    settings: Settings,
    objective: Objective,
    robot: RobotDescription,
    claims: Claims,
    *,
    on_curve: bool,
) -> None:
    """Compare margins and residuals with what was recomputed, and prove what is claimed of ρ.

    Args:
        chunk: cycles in a row.
        sent: all answers.
        margins: of the constraints in all cycles so far, and how exactly they are known.
        settings, objective: of the controller.
        robot: description of it.
        claims: takes what was compared.
        on_curve: whether the last equation is the motion along a curve.
    """
    chunk = [cycle for cycle in chunk if sent.there[cycle.number]]
    if not chunk:
        return
    at = np.array([cycle.number for cycle in chunk])
    nearest = margins[0][at], margins[1][at]
    _check_margins(chunk, sent, at, nearest, robot.velocity, claims)
    kept = np.where(sent.stated["solver_status"][at] == CERTIFIED, KEPT, SOLVED)
    if on_curve:
        chunk = with_speeds(chunk, sent.u[at], sent.doubt[at], kept, sent.tick[at], claims)
    asked = np.array([cycle.drift for cycle in chunk])
    if settings.rest["lyapunov"] == "equality":
        asked += np.array([cycle.psi for cycle in chunk])
    stack = Stacked(chunk, objective, sent.u[at], sent.doubt[at], asked)
    _check_optimum(chunk, stack, at, sent, Judge(settings, objective), claims)
    for i in np.flatnonzero(sent.status[at] == STATIONARY).tolist():
        p, tick = stack[i], sent.tick[at[i]]
        most = farkas.most_fall(p)
        claims.equal("stationary: u", tick, np.abs(p.y).max(), 0.0, p.doubt.max())
        claims.at_most("stationary: fall of V", tick, most.bound, 0.0, kept[i] * (1.0 + most.pull))
    brake = robot.brake_acceleration * robot.period_s
    _check_brakes(chunk, stack, at, sent, brake, claims)


def _check_margins(
    chunk: Sequence[Cycle],
    sent: Answers,
    at: NDArray[np.int64],
    constraints: tuple[Array, Array],
    fastest: Array,
    claims: Claims,
) -> None:
    """Smallest margin: of the constraints, else of rows and bounds, else of the robot's speeds."""
    tick, u, doubt = sent.tick[at], sent.u[at], sent.doubt[at]
    nearest, exact = constraints
    lower, upper = (
        np.array([getattr(cycle, end) for cycle in chunk]) for end in ("lower", "upper")
    )
    sides, sides_off = np.minimum(upper - u, u - lower).min(1), doubt.max(1)
    for i, cycle in enumerate(chunk):
        if len(cycle.b):
            A, b = cycle.A[cycle.asked], cycle.b[cycle.asked]
            room = np.append(b - A @ u[i], sides[i])
            size = np.abs(A) @ (doubt[i] + RELATIVE * np.abs(u[i]))
            sides[i] = room.min()
            sides_off[i] = max(size.max(initial=0.0), sides_off[i])
    free = fastest - np.abs(u)
    known = np.isfinite(nearest)
    found = np.where(known, nearest, np.where(np.isfinite(sides), sides, free.min(1)))
    off = np.where(known, exact, sides_off + doubt.max(1)) + RELATIVE * np.abs(found)
    answered = np.isin(sent.status[at], ANSWERED) | known
    claims.equal(
        "margin",
        tick[answered],
        sent.stated["margin"][at][answered],
        found[answered],
        off[answered],
    )
    proven = sent.stated["solver_status"][at] == CERTIFIED
    claims.at_most(
        "certified: rows and bounds", tick[proven], -sides[proven], KEPT, sides_off[proven]
    )
    claims.at_most("certified: margin", tick[proven], -found[proven], CURVATURE, off[proven])


def _check_brakes(
    chunk: Sequence[Cycle],
    stack: Stacked,
    at: NDArray[np.int64],
    sent: Answers,
    brake: Array,
    claims: Claims,
) -> None:
    """Without an answer all joints brake in a straight line; at its begin nothing keeps all sides.

    A robot that brakes goes on until it rests, and says all the while what it began for.
    """
    for i in np.flatnonzero(~np.isin(sent.status[at], FOLLOWED)).tolist():
        number, cycle, tick = at[i], chunk[i], sent.tick[at[i]]
        last = sent.before[number]
        periods = float(np.max(np.abs(last) / brake))
        share = 1.0 - 1.0 / periods if periods > 1.0 else 0.0
        u = np.clip(share * last, cycle.lower, cycle.upper)
        off = sent.doubt[number] + sent.doubt[max(number - 1, 0)]
        claims.equal(
            "brake", tick, sent.u[number][None], u[None], (off + RELATIVE * np.abs(u))[None]
        )
        begins = number == 0 or sent.status[number - 1] in FOLLOWED or not last.any()
        if sent.status[number] == INFEASIBLE and begins:
            claims.at_most("infeasible", tick, -farkas.broken(stack[i]), 0.0, SOLVED)


def _check_optimum(
    chunk: Sequence[Cycle],
    stack: Stacked,
    at: NDArray[np.int64],
    sent: Answers,
    judge: Judge,
    claims: Claims,
) -> None:
    """Residuals, and that ρ is as large as it must be."""
    tick, stated = sent.tick[at], sent.stated["kkt_residual"][at]
    answered = np.isin(sent.status[at], ANSWERED) & (sent.status[at] != STATIONARY)
    short = judge.equality & (sent.stated["rho"][at] < 1.0 - RELATIVE) & answered
    span = stack.kappa + np.abs(stack.y).max(1)
    bent = stack.slope_doubt.max(1) * span / np.maximum(stack.scale, 1e-6 * span)
    root = np.sqrt(stack.y.shape[1])
    off = np.maximum(OPTIMAL, root * (stack.doubt.max(1) / stack.scale + bent))
    # least squares spread over n joints what the best multipliers would leave to one
    most, proven = root * stated, sent.stated["solver_status"][at] == CERTIFIED
    found = judge.alone(stack, equations=any(len(cycle.c) for cycle in chunk))
    lacks = [Missing() for _ in chunk]
    for i in np.flatnonzero(answered & (judge.always | short | (found > most + off))).tolist():
        enough = float(most[i] + off[i])
        parts = stack[i], float(found[i]), enough, KEPT if proven[i] else SOLVED
        found[i], lacks[i] = judge(*parts, short=bool(short[i]))
    claims.at_most("residual", tick[answered], found[answered], most[answered], off[answered])
    fall, near = np.array(lacks).T
    claims.at_most("largest rho", tick[short], fall[short], 0.0, near[short])
    claims.at_most("certified: residual", tick[proven], stated[proven], OPTIMAL, 0.0)
