"""What a controller summed up of its answers, which verdicts rest on."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from hoap3.protocol.messages import schema
from hoap3.remote_controller.controllers.certificate import PROVED, checked_statuses
from hoap3.tools.verify.claims import RELATIVE, Claims
from hoap3.tools.verify.controller_log import ControllerRun

STATUS = schema("Setpoint").constants
ONE_POINT = {"qp12", "pinv", "osqp"}
"""Controllers whose V is ½|e|² of their one task, so that V tells the error at the end."""


@dataclass
class Summed:
    """What the answers of one session of the robot came to so far, over all engagements."""

    answers: int = 0
    proved: int = 0
    least_margin: float = np.inf

    def add(self, answers: Any) -> None:
        """Count more answers, as a structured array."""
        judged = answers["solver_status"] != STATUS["STATUS_NONE"]
        margins = answers["margin"][judged]
        self.answers += len(answers)
        self.proved += int(np.isin(checked_statuses(answers), PROVED).sum())
        least = float(np.where(np.isnan(margins), -np.inf, margins).min(initial=np.inf))
        self.least_margin = min(self.least_margin, least)


class Summaries:
    """Checks each summary in a controller's log; it counts over a session's engagements.

    Args:
        controller: its registered name.
        claims: takes what was compared.
    """

    def __init__(self, controller: str, claims: Claims) -> None:
        self._controller, self._claims = controller, claims
        self._sessions: dict[int, Summed] = {}

    def check(self, run: ControllerRun, *, whole: bool) -> None:
        """Compare the summaries of one engagement; `whole`: nothing before it is missing."""
        if not whole or run.gaps or run.orphans or run.strange:
            self._claims.unverified("summary", len(run.summaries), "answers are missing before it")
            return
        summed = self._sessions.setdefault(int(run.session.get("session_id", 0)), Summed())
        begin = 0
        for end, summary in run.summaries:
            summed.add(run.answers[begin:end])
            begin = end
            if end:
                self._compare(summary, summed, run.answers[end - 1])
        summed.add(run.answers[begin:])

    def _compare(self, summary: dict[str, Any], summed: Summed, last: Any) -> None:
        claims, tick = self._claims, int(last["tick"])
        claims.equal("summary: answers", tick, summary["answers"], summed.answers, 0.0)
        certified, certifiable = summary["certified"], summary["certifiable"]
        claims.at_most("summary: certifiable", tick, certifiable, summed.answers, 0.0)
        claims.at_most("summary: certified", tick, certified, summed.proved, 0.0)
        if certifiable == summed.answers:
            claims.equal("summary: certified", tick, certified, summed.proved, 0.0)
        if summary["margin"] is not None:
            least = max(summed.least_margin, -np.finfo(float).max)
            claims.equal("summary: margin", tick, summary["margin"]["least"], least)
        for task in summary["tasks"]:
            within = task["error"] is not None and not task["error"] > task["tolerance"]
            claims.equal("summary: within tolerance", tick, bool(task["within"]), within, 0.0)
        if self._controller in ONE_POINT:
            error, stated = float(np.sqrt(2.0 * last["v"])), summary["tasks"][0]["error"]
            claims.equal("summary: error", tick, stated, error, RELATIVE * (error + 1e-3))
