"""Whether a robot with a limit of jerk will take over what a controller answers."""

from __future__ import annotations

import numpy as np

from hoap3.protocol.limits.jerk_limits import limits_with_jerk
from hoap3.protocol.messages import FloatArray
from hoap3.protocol.robot.description import RobotDescription

MEMORY = 3
"""Periods in a row after which the setpoint's own motion and the reference's are known."""


class JerkJudge:
    """Judges answers as the robot will.

    Args:
        description: of the robot.
    """

    def __init__(self, description: RobotDescription) -> None:
        from hoap3.remote_controller.model.jerk_judge_kernels import held_by_jerk

        n = description.n
        self._held, self._dt = held_by_jerk, description.period_s
        self._limits = limits_with_jerk(description)
        self._answers, self._references = np.zeros((3, n)), np.zeros((2, n))
        self._known = 0

    def holds_back(
        self, answer: FloatArray, reference: FloatArray, *, at_rest: bool, followed: bool
    ) -> bool:
        """Whether the robot may hold a joint back.

        Args:
            answer, reference: setpoint that is answered, and reference that is applied, (n,).
            at_rest: whether the robot begins to follow.
            followed: or is one period further than at the last call.
        """
        if at_rest:
            self._answers[:] = self._references[:] = reference
            self._known = MEMORY
        else:
            self._known = self._known + 1 if followed else 0
        held = self._held(
            answer, self._answers, reference, self._references, self._limits, self._dt
        )
        return bool(held) or self._known < MEMORY


def judge_of(description: RobotDescription) -> JerkJudge | None:
    """A judge, or None where no limit of jerk counts."""
    some = np.isfinite(limits_with_jerk(description)[4]).any()
    return JerkJudge(description) if some else None
