"""What a controller knows of a run at its end: its tasks, certificates, constraints and balance."""

from __future__ import annotations

import math
import sys
from collections import Counter
from typing import Any

from hoap3.protocol.messages import Setpoint, State
from hoap3.protocol.robot.description import RobotDescription
from hoap3.remote_controller.balance import balance_of
from hoap3.remote_controller.controllers.base import STATUS, Controller
from hoap3.remote_controller.controllers.certificate import PROVED, checked_status

EVERY = 10
"""One of so many answered States is looked at for balance."""

NONE = STATUS["none"]


class Outcome:
    """Counts over the answers of a session, and the errors of the tasks at its end.

    A session is the robot's: it may have several engagements, and all of them count.

    Args:
        controller, description: the author of the answers, and its robot.

    Attributes:
        answers: how many were noted.
    """

    def __init__(self, controller: Controller, description: RobotDescription) -> None:
        self._controller = controller
        self._certifies = controller.certifies
        self._balance = balance_of(description)
        self.answers = self._stated = self._certifiable = self._certified = 0
        self._without = Counter[int]()  # conditions, by bit, of answers that could be certified
        self._invalid = Counter[str]()  # reasons why a certificate does not count
        self._least_margin, self._least_of = math.inf, ("", "")

    def note(self, state: State, answer: Setpoint) -> None:
        """Count an answer, after it was sent."""
        controller, (status, invalid) = self._controller, checked_status(answer)
        if self._balance is not None and self.answers % EVERY == 0:
            self._balance.look(state.q)
        self.answers += 1
        if status == NONE:
            return
        self._stated += 1
        margin = answer.margin
        if not margin >= self._least_margin:
            self._least_margin = -math.inf if math.isnan(margin) else margin  # NaN is a violation
            self._least_of = controller.margin_of()
        self._certifies |= status == STATUS["certified"]  # whatever the controller declares
        if not controller.present & controller.not_certified_in:
            self._certifiable += 1
            if status in PROVED:
                self._certified += 1
            else:
                self._without[controller.present] += 1
                self._invalid.update(invalid)

    def as_json(self) -> dict[str, Any]:
        """All of it as a JSON object; docs/start/concepts.md defines the keys.

        Raises:
            Exception: whatever `task_errors` of the controller raises.
        """
        tolerance = self._controller.margin_tolerance
        judged = tolerance is not None and self._least_margin < math.inf
        least = max(self._least_margin, -sys.float_info.max)  # JSON has no infinities
        of, unit = self._least_of
        certifies = self._certifies and self._stated > 0
        certifiable = self._certifiable + self.answers - self._stated  # silence proves nothing
        margin = {"least": least, "tolerance": tolerance, "of": of, "unit": unit}
        return {
            "answers": self.answers,
            "tasks": [error.as_json() for error in self._controller.task_errors()],
            "certifies": certifies,
            "certifiable": certifiable if certifies else 0,
            "certified": self._certified if certifies else 0,
            "not_certified": self._not_certified() if certifies else {},
            "margin": margin if judged else None,
            "balance": None if self._balance is None else self._balance.as_json(),
        }

    def _not_certified(self) -> dict[str, int]:
        """Why answers have no certificate: conditions, invalid fields; in how many, most first."""
        found = self._invalid.copy()
        for present, count in self._without.items():
            for bit, name in enumerate(self._controller.conditions):
                if present >> bit & 1:
                    found[name] += count
        return dict(found.most_common())
