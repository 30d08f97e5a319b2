"""What an answer in accelerations or torques depends on, and its claims of V and its rates."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from hoap3.protocol.messages import schema
from hoap3.remote_controller.problems.oracles.tasks.acceleration_oracle import ROUNDING, TaskRows
from hoap3.remote_controller.problems.statement import Array, Claim, Flags, Rows, Statement

RELATIVE = 1e-9  # of what is compared: rounding
ACTIVE = 1e-3  # rad/s or m/s: speed from which a joint counts as active
DOUBT = 1e-2  # of an acceleration, and of 1 m/s², in the greatest rise of V
INFEASIBLE = schema("Setpoint").constants["STATUS_INFEASIBLE"]
NOT_SENT = (
    "v", "v_rate_required", "v_rate_predicted", "rho", "margin", "kkt_residual", "active_joints",
    "solver_path", "fallback",
)  # fmt: skip
"""Fields that are 0 in an answer to a State that is not finite."""


@dataclass(frozen=True)
class Cycle:
    """What an answer depends on, and its motion.

    With a free base, dq, ddq, J, M and h have 6 numbers or columns of the base before the joints'.

    Attributes:
        dq: (n,).
        rows: of all tasks, below each other; J is (m, n).
        desired, desired_error: J·q̈ that the tasks desire, (m,), and its rounding error.
        M, h: (n, n) and (n,), with the viscous friction at the end of the period.
        added: torques that the robot adds to a command, (n,).
        lower, upper: of q̈, (n,).
        importance: weights (k,) or priorities (k, k).
        ddq, tau, ddq_error, tau_error: of the answer, (n,), and rounding errors.
        kept: rows of q̈ that constraints ask for, each of length 1.
    """

    dq: Array
    rows: TaskRows
    desired: Array
    desired_error: Array
    M: Array
    h: Array
    added: Array
    lower: Array
    upper: Array
    importance: Array
    ddq: Array
    tau: Array
    ddq_error: Array
    tau_error: Array
    kept: tuple[Rows, ...] = ()


def lyapunov_claims(setpoint: Any, cycle: Cycle, top: Flags, T: float) -> list[Claim]:
    """V = ½|e|² of the top tasks, V̇ half a period on, the greatest rise of V, and active joints.

    Args:
        setpoint: the answer.
        cycle: that it depends on.
        top: which rows are those of top tasks, (m,).
        T: the period [s].
    """
    rows, (e_exact, nu_exact, rate_exact) = cycle.rows, cycle.rows.exact
    error = np.where(top, np.abs(rows.error), 0.0)
    V = 0.5 * float(error @ error)
    claims = [
        Claim("V", float(setpoint["v"]), V, RELATIVE * V + float((error + e_exact) @ e_exact))
    ]
    slope, slope_exact = np.where(top, rows.slope, 0.0), np.where(top, e_exact, 0.0)
    change = rows.rate + rows.jacobian @ cycle.ddq
    ddq_error = cycle.ddq_error + ROUNDING * np.abs(cycle.ddq)
    change_exact = rate_exact + np.abs(rows.jacobian) @ ddq_error
    moving = rows.motion + 0.5 * T * change
    moving_exact = nu_exact + 0.5 * T * change_exact + RELATIVE * np.abs(moving)
    rate = float(slope @ moving)
    off = float(np.abs(slope) @ moving_exact + slope_exact @ np.abs(moving))
    claims.append(Claim("predicted V rate", float(setpoint["v_rate_predicted"]), rate, off))
    square = float(np.where(top, moving**2, 0.0).sum())
    rise = DOUBT * T * float(np.abs(slope) @ (np.abs(change) + 1.0))
    required = max(rate + 2.0 * T * square + rise, 0.0)
    off += 4.0 * T * float(np.where(top, np.abs(moving) * moving_exact, 0.0).sum())
    off += DOUBT * T * float(np.abs(slope) @ change_exact + slope_exact @ (np.abs(change) + 1.0))
    off += RELATIVE * required
    claims.append(Claim("required V rate", float(setpoint["v_rate_required"]), required, off))
    joints = slice(-len(cycle.tau), None)  # not the base
    speed = np.abs(cycle.dq + T * cycle.ddq)[joints]
    near = T * cycle.ddq_error[joints] + RELATIVE * ACTIVE
    return [*claims, active_joints_claim(setpoint, speed, near)]


def active_joints_claim(setpoint: Any, speed: Array, error: Array) -> Claim:
    """Return how many joints move, from speeds (n,) and their errors (n,) [rad/s or m/s]."""
    least, most = ((speed >= ACTIVE + sign * error).sum() for sign in (1.0, -1.0))
    stated = float(setpoint["active_joints"])
    return Claim("active joints", stated, float(np.clip(stated, least, most)), 0.0)


def refused(setpoint: Any) -> Statement:
    """State the answer to a State that is not finite: NaN, and a certificate of zeros."""
    values, extra = np.array(setpoint["values"]), np.array(setpoint["extra"])
    claims = [
        worst("refused: values", values, np.full(values.shape, np.nan), 0.0),
        worst("refused: claims", np.array([float(setpoint[name]) for name in NOT_SENT]), 0.0, 0.0),
        Claim("status", float(setpoint["solver_status"]), INFEASIBLE, 0.0),
    ]
    if extra.size:
        claims.append(worst("refused: extra", extra, 0.0, 0.0))
    return Statement("refused", (), values, np.zeros(values.shape), tuple(claims))


def worst(name: str, stated: Any, value: Any, error: Any) -> Claim:
    """Return the claim of the entry that is furthest off, relative to its error."""
    stated, value, error = np.broadcast_arrays(np.asarray(stated, float), value, error)
    same = (stated == value) | (np.isnan(stated) & np.isnan(value))
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(same, 0.0, np.abs(stated - value) / error)
    at = int(np.argmax(np.where(np.isnan(share), np.inf, share)))
    return Claim(name, float(stated[at]), float(value[at]), float(error[at]))


def rounding_of(M: Array, h: Array, dq: Array, ddq: Array) -> float:
    """Return the rounding error of M·q̈ + h.

    Inertias of light links are differences of larger numbers, so that each entry of M has the
    rounding error of the largest.
    """
    motion = np.abs(ddq).sum() + np.abs(dq).sum() ** 2
    return float(ROUNDING * (np.abs(M).max() * motion + np.abs(h).max()))
