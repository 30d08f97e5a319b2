"""The joint velocities of velocity controllers' answers, and what they say of themselves."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hoap3.remote_controller.problems.velocity_answer import ACTIVE, ROUNDINGS
from hoap3.tools.verify.claims import RELATIVE, Claims
from hoap3.tools.verify.controller_log import ControllerRun

Array = NDArray[np.float64]


def start_positions(run: ControllerRun, parameters: Mapping[str, Any]) -> Array:
    """Where each answer is integrated from: the applied reference, or what was measured, (N, n)."""
    measured = parameters.get("integrate_from", "reference") == "measured"
    found: Array = run.answered_states["q" if measured else "reference"]
    return found


def sent_velocity(run: ControllerRun, parameters: Mapping[str, Any]) -> tuple[Array, Array]:
    """Velocity u of each answer, and how exactly it is known, both (N, n) [rad/s].

    Where a log lacks u itself, the `decision`, u = (values − start)/T, rounded by up to `ROUNDINGS`
    ulp of the position.
    """
    answers, T = run.answers, run.description.period_s
    start = start_positions(run, parameters)
    u = (answers["values"] - start) / T
    size = np.maximum(np.abs(start), np.abs(answers["values"]))
    doubt = np.where(np.isfinite(size), ROUNDINGS * np.spacing(size) / T, 0.0)
    names = answers.dtype.names or ()
    if "decision" in names and answers["decision"].shape == u.shape:
        u, doubt = answers["decision"].astype(float), np.zeros_like(u)
    return u, doubt


def check_values(run: ControllerRun, parameters: Mapping[str, Any], claims: Claims) -> None:
    """Setpoint = start + u·T where the log has u, and the number of active joints."""
    answers, T = run.answers, run.description.period_s
    u, doubt = sent_velocity(run, parameters)
    if not doubt.any():
        start = start_positions(run, parameters)
        allowed = np.spacing(np.maximum(np.abs(start), np.abs(answers["values"])))
        claims.equal("setpoint", answers["tick"], answers["values"], start + u * T, allowed)
    speed, stated = np.abs(u), answers["active_joints"].astype(float)
    near = np.maximum(doubt, RELATIVE * ACTIVE)
    claims.at_most(
        "active joints, at most", answers["tick"], stated, (speed >= ACTIVE - near).sum(1), 0.0
    )
    claims.at_most(
        "active joints, at least", answers["tick"], -stated, -(speed >= ACTIVE + near).sum(1), 0.0
    )
