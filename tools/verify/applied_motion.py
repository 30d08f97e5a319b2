"""Whether the reference that a robot applied kept the robot's limits between ticks."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.messages import State
from hoap3.protocol.robot.description import RobotDescription
from hoap3.tools.logs.disk_rows import parts
from hoap3.tools.verify.claims import RELATIVE, Claims

Rows = NDArray[np.void]

STARTUP_TICKS = 200  # from the first active one, as docs/start/concepts.md defines a start-up step
SAME = 1e-12  # rad or m: a setpoint that is missed by no more was followed, but for rounding
BEFORE = 3  # States that the differences of the first one need
ROUNDINGS = 8  # ulp of a position, per difference
OF_JERK = 12
"""The same of third differences, near zero of the way in three periods: 8 that a setpoint may be
beyond the limit when it is taken over, and 4 of the roundings of four positions."""


def check_motion(states: Rows, robot: RobotDescription, claims: Claims) -> None:
    """Position, speed, acceleration and jerk of the applied reference, by its differences.

    Each State is one period of the body after the last: it does not move in skipped periods. Of a
    robot that takes accelerations or torques the reference is where its body is.

    Args:
        states: of one session, in the order of their ticks, without a gap.
        robot: whose limits count.
        claims: takes what was compared.
    """
    for part in parts(len(states)):
        some = states[max(part.start - BEFORE, 0) : part.stop]
        with claims.from_tick(int(states["tick"][part.start])):
            _check_part(some, states["reference"][0], robot, claims)


def _check_part(
    states: Rows, start: NDArray[np.float64], robot: RobotDescription, claims: Claims
) -> None:
    """The same of some States; a joint that starts beyond its range may come back from there."""
    kind, tick = robot.command_kinds[0], states["tick"]
    _check_rest(states, claims)
    if states["reference_rate"].shape[1] == robot.n:
        _check_told(states, robot, claims)
    if kind == "torque":
        _check_torques(states, start, robot, claims)
        return
    if kind == "acceleration":
        claims.equal("reference is the body", tick, states["reference"], states["q"], 0.0)
    s, T = states["reference"], robot.period_s
    ulp = np.spacing(np.abs(s).max(0))
    most, least = np.maximum(robot.upper, start), np.minimum(robot.lower, start)
    claims.at_most("applied position, upper", tick, s, most, ulp)
    claims.at_most("applied position, lower", tick, -s, -least, ulp)
    v = np.diff(s, axis=0) / T
    fastest = np.broadcast_to(robot.velocity, v.shape)
    claims.at_most(
        "applied speed", tick[1:], np.abs(v), fastest, RELATIVE * fastest + ROUNDINGS * ulp / T
    )
    change = np.abs(np.diff(v, axis=0, prepend=np.zeros((1, robot.n)))) / T
    greatest = np.broadcast_to(robot.setpoint_acceleration_max, change.shape)
    off = RELATIVE * greatest + ROUNDINGS * ulp / T**2
    claims.at_most("applied acceleration", tick[1:], change, greatest, off)
    if kind == "position" and np.isfinite(robot.setpoint_jerk_max).any():
        _check_jerk(tick, s, robot, claims)


def _check_jerk(
    tick: NDArray[np.int64], s: NDArray[np.float64], robot: RobotDescription, claims: Claims
) -> None:
    """Third differences over T³, of joints with a limit, from rest on."""
    T, some = robot.period_s, np.isfinite(robot.setpoint_jerk_max)
    s, most = s[:, some], robot.setpoint_jerk_max[some]
    jerk = np.abs(np.diff(np.vstack([s[:1], s[:1], s]), 3, axis=0)) / T**3
    ulp = np.spacing(np.abs(s).max(0) + 3.0 * robot.velocity[some] * T)
    greatest = np.broadcast_to(most, jerk.shape)
    off = RELATIVE * greatest + OF_JERK * ulp / T**3
    claims.at_most("applied jerk", tick[1:], jerk, greatest, off)


def check_held_back(
    summary: dict[str, Any], states: Rows, answers: Rows, robot: RobotDescription, claims: Claims
) -> None:
    """Count the periods in which a robot that takes positions did not go to its setpoint.

    While it stops, or where two messages answer one tick, it is not known: these may count or not.
    """
    told = states["followed"].size and len(answers)
    if robot.command_kinds[0] != "position" or not told:
        return
    moves = np.isin(states["mode"], (State.ACTIVE, State.STOPPING))
    ticks, first, counts = np.unique(answers["tick"], return_index=True, return_counts=True)
    followed = np.where(moves, states["followed"][:, 0], -1.0)
    known = np.isin(followed, ticks[counts == 1])
    of_answers = first[np.searchsorted(ticks, followed[known])]
    of_states, last = np.flatnonzero(known), int(states["tick"][-1])
    held = np.zeros(len(states), bool)
    for part in parts(len(of_states)):
        at = of_states[part]
        off = answers["values"][of_answers[part]] - states["reference"][at]
        held[at] = ~(np.abs(off) <= SAME).all(1)
    active, tick = states["mode"] == State.ACTIVE, states["tick"].astype(np.int64)
    begins = active & ~np.concatenate([[False], active[:-1]])
    since = np.maximum.accumulate(np.where(begins, tick, -STARTUP_TICKS))
    starting = tick < since + STARTUP_TICKS
    for name, some in (("interventions", moves), ("startup_interventions", moves & starting)):
        if (stated := summary.get(name)) is None:
            continue
        found, unknown = int((held & some).sum()), int((some & ~known).sum())
        claims.at_most(f"summary: {name}", last, found - stated, 0.0, 0.0)
        claims.at_most(f"summary: {name}", last, stated - found - unknown, 0.0, 0.0)


def _check_rest(states: Rows, claims: Claims) -> None:
    """Nothing moves while the robot is at rest."""
    resting = np.isin(states["mode"], (State.IDLE, State.STOPPED))
    at_rest = resting[1:] & resting[:-1]
    moved = np.diff(states["reference"], axis=0)[at_rest]
    claims.equal("reference at rest", states["tick"][1:][at_rest], moved, 0.0 * moved, 0.0)


def _check_told(states: Rows, robot: RobotDescription, claims: Claims) -> None:
    """The velocity and acceleration of the reference that the robot tells, of wire version 2.

    Of a robot that takes positions they are differences of its reference, of others those of its
    body.
    """
    tick, T, told = states["tick"], robot.period_s, states["reference_rate"]
    if robot.command_kinds[0] == "position":
        moved = np.diff(states["reference"], axis=0) / T
        ulp = np.spacing(np.abs(states["reference"]).max(0))
        claims.equal("told rate", tick[1:], told[1:], moved, 0.0 * moved + ROUNDINGS * ulp / T)
    else:
        claims.equal("told rate", tick, told, states["dq"], 0.0)
    change = np.diff(told, axis=0) / T
    off = RELATIVE * np.maximum(np.abs(told[1:]), np.abs(told[:-1])) / T
    stated = states["reference_acceleration"][1:]
    claims.equal("told acceleration", tick[1:], stated, change, off)


def _check_torques(
    states: Rows, start: NDArray[np.float64], robot: RobotDescription, claims: Claims
) -> None:
    """Torques within the efforts, and positions within the mechanical stops.

    Where efforts are too small for what moves, no robot keeps more than these. Brakes, that hold
    it at rest, carry what there is.
    """
    tick, q = states["tick"], states["reference"]
    moves = np.isin(states["mode"], (State.ACTIVE, State.STOPPING))
    moves[1:] &= moves[:-1]  # the torques are those of the period before
    tau = np.abs(states["tau"][moves])
    effort = np.broadcast_to(robot.effort, tau.shape)
    claims.at_most("applied torque", tick[moves], tau, effort, RELATIVE * effort)
    claims.at_most("applied position, upper", tick, q, np.maximum(robot.upper_hard, start), 0.0)
    claims.at_most("applied position, lower", tick, -q, -np.minimum(robot.lower_hard, start), 0.0)
