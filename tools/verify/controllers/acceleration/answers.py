"""What the checkers of accelerations and torques ask of every answer."""

from __future__ import annotations

import numpy as np

from hoap3.protocol.messages import schema
from hoap3.tools.verify.claims import Claims
from hoap3.tools.verify.controller_log import ControllerRun

ACTIVE = 1e-3  # rad/s or m/s: from which on a joint counts as active
INFEASIBLE = schema("Setpoint").constants["STATUS_INFEASIBLE"]
NOT_REMEMBERED = "the log lacks what the controller remembers"
ZERO = (
    "v", "v_rate_required", "v_rate_predicted", "rho", "margin", "kkt_residual", "active_joints",
    "solver_path", "fallback",
)  # fmt: skip


def check_refused(run: ControllerRun, claims: Claims) -> None:
    """Answers to States that are not finite: nothing to follow, and nothing claimed."""
    if not len(run.answers):
        return
    answers, tick = run.answers, run.answers["tick"]
    nothing = np.full(answers["values"].shape, np.nan)
    claims.equal("refused: values", tick, answers["values"], nothing)
    for name in ZERO:
        claims.equal("refused: claims", tick, answers[name], np.zeros(len(tick)), 0.0)
    claims.equal("refused: extra", tick, answers["extra"], np.zeros(answers["extra"].shape), 0.0)
    status = np.full(len(tick), INFEASIBLE)
    claims.equal("status", tick, answers["solver_status"], status, 0.0)
