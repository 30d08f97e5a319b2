"""Answers of a motion that leaves a singularity: within the robot's limits, and without a claim."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.messages import schema
from hoap3.remote_controller.controllers.singularity import LEAVING
from hoap3.remote_controller.problems.velocity import limits_of, velocity_bounds
from hoap3.remote_controller.problems.velocity_answer import DELAYED
from hoap3.tools.logs.disk_rows import RowsAt
from hoap3.tools.verify.claims import RELATIVE, Claims
from hoap3.tools.verify.controller_log import ControllerRun
from hoap3.tools.verify.sent_velocity import check_values, sent_velocity

Array = NDArray[np.float64]

REACH, OF_RANGE = 0.05, 0.1  # greatest displacement of a joint [rad or m], and of its range
SETTLED = 1e-4  # what joints may still move while the direction is determined [rad or m]
EMPTY = "v_rate_required", "v_rate_predicted", "rho", "margin", "kkt_residual"
UNCERTIFIED = schema("Setpoint").constants["STATUS_UNCERTIFIED"]
WHY = "V and the direction in which a singularity is left are not recomputed"


def check_leaving(run: ControllerRun, parameters: Mapping[str, Any], claims: Claims) -> None:
    """Check these answers, of any controller of velocities."""
    leaving = run.during(LEAVING)
    if not leaving.any():
        return
    run = _checkable(run.only(leaving), claims)
    answers, tick, robot = run.answers, run.answers["tick"], run.description
    stated = np.array([answers[name] for name in EMPTY]).T
    claims.equal("leaving: no certificate", tick, stated, np.zeros(stated.shape), 0.0)
    status = answers["solver_status"]
    claims.equal("leaving: status", tick, status, np.full(len(status), UNCERTIFIED), 0.0)
    claims.unverified("leaving: direction", len(answers), WHY)
    if robot.delay_ticks:
        claims.unverified("u", len(answers), DELAYED)
        return
    check_values(run, parameters, claims)
    u, doubt = sent_velocity(run, parameters)
    limits, reference = limits_of(robot, {}), run.answered_states["reference"]
    lower, upper = velocity_bounds(reference, reference_rates(run), limits, robot.period_s)
    for side, bound in ((u, upper), (-u, -lower)):
        claims.at_most("leaving: limits", tick, side, bound, RELATIVE * np.abs(bound) + doubt)
    first = np.flatnonzero(np.diff(run.answered, prepend=-2) != 1)  # of each motion
    start = reference[first[np.searchsorted(first, np.arange(len(u)), "right") - 1]]
    reach = np.minimum(REACH, OF_RANGE * (robot.upper - robot.lower))
    moved = np.abs(reference - start)
    claims.at_most("leaving: displacement", tick, moved, reach, SETTLED)


def _checkable(run: ControllerRun, claims: Claims) -> ControllerRun:
    """Return the answers that are finite, as are their States, after a known start; count the rest.

    Their certificate is counted with that of all answers of such a motion, by `check_statements`.
    """
    states, answers = run.answered_states, run.answers
    finite = states.finite("q", "reference") & answers.finite("values")
    lost = finite & ~run.remembered
    claims.unverified("leaving: limits", int((~finite).sum()), "State or answer is not finite")
    claims.unverified("leaving: limits", int(lost.sum()), "the log lacks when the controller began")
    return run.only(finite & ~lost)


def reference_rates(run: ControllerRun) -> Array:
    """How the reference of each answer's State moved since the State before, (N, n) [rad/s].

    At the first State after a reset it is what the robot measured.
    """
    states, T = run.states, run.description.period_s
    finite = RowsAt.of(states).finite("q", "reference")
    places = np.arange(len(states))
    last = np.maximum.accumulate(np.where(finite, places, -1))
    before = np.append(-1, last[:-1])[run.answered]
    resets = np.array([-1, *run.resets])
    begun = resets[np.searchsorted(resets, run.answered, "right") - 1]
    periods = (states["tick"] - states["skipped"]).astype(np.int64)
    apart = periods[run.answered] - periods[before]
    known = (before >= np.maximum(begun, 0)) & (apart > 0)
    moved = states["reference"][run.answered] - states["reference"][before]
    rates = moved / (np.where(known, apart, 1) * T)[:, None]
    measured = np.nan_to_num(states["dq"][run.answered], posinf=0.0, neginf=0.0)
    return np.asarray(np.where(known[:, None], rates, measured))
