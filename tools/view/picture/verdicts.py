"""The three verdicts while a robot runs, of what has been seen of it so far."""

from __future__ import annotations

from typing import Any

import numpy as np

from hoap3.protocol.description import RobotDescription
from hoap3.protocol.messages import Event, Setpoint, State
from hoap3.protocol.runtime.deadlines import verdict

ENOUGH = 100  # ticks before deadlines are judged
ROUNDING = 1e-9  # of a position beyond a stop, or a margin without a tolerance of its own
_NONE = Setpoint.schema.constants["STATUS_NONE"]
_FORCED = {Event.schema.constants["REASON_MISSES"], Event.schema.constants["REASON_HOLDER_LOST"]}


class LiveVerdicts:
    """Deadlines since the first look, tasks as they stand, limits in the States that were seen.

    A log judges the whole run; this judges what a page has seen.

    Args:
        description: of the robot.
        margin_tolerance: how far a margin may be below 0 by rounding; None where nobody tells.
    """

    def __init__(self, description: RobotDescription, margin_tolerance: object = None) -> None:
        self._stops = description.lower_hard - ROUNDING, description.upper_hard + ROUNDING
        self._tolerance = margin_tolerance if isinstance(margin_tolerance, float) else ROUNDING
        self._first: tuple[int, int, int] | None = None
        self._session = -1
        self._deadlines: str | None = None
        self._safe_stop = self._violated = False
        self._seen = False

    def look(self, state: State, setpoint: Setpoint | None) -> None:
        """Take one State, and its answer."""
        if state.session_id != self._session:
            self._session, self._first = state.session_id, None
            self._safe_stop = self._violated = self._seen = False
            self._deadlines = None
        self._seen = True
        lower, upper = self._stops
        self._violated |= bool((state.q < lower).any() or (state.q > upper).any())
        if setpoint is not None and setpoint.solver_status != _NONE:
            self._violated |= not setpoint.margin >= -self._tolerance
        self._count(state)

    def note_stop(self, reason: int) -> None:
        """Take the reason of a stop, as its event has it."""
        self._safe_stop |= reason in _FORCED

    def as_json(self, tasks: object) -> dict[str, str | None]:
        """By name; None for what is not known.

        Args:
            tasks: as `control/tasks` has them, or None.
        """
        limits = ("bad" if self._violated else "good") if self._seen else None
        deadlines = "unfit" if self._safe_stop else self._deadlines
        return {
            "deadlines": deadlines,
            "task": _of_tasks(tasks),
            "limits_and_balance": limits,
        }

    def _count(self, state: State) -> None:
        """Of the ticks since the first active one that was seen, which share was in time."""
        if state.mode != State.ACTIVE:
            self._first = None
            return
        missed = int(np.int64(state.late + state.lost)) + int(state.skipped)
        if self._first is None:
            self._first = (state.epoch, state.tick, missed)
        _, tick, before = self._first
        ticks = state.tick - tick
        if ticks >= ENOUGH:
            rate = 1.0 - max(missed - before, 0) / ticks
            self._deadlines = verdict(rate, safe_stop=False)


def _of_tasks(tasks: object) -> str | None:
    if not isinstance(tasks, list):
        return None
    judged: list[Any] = [each for each in tasks if isinstance(each, dict) and each.get("judged")]
    if not judged:
        return None
    return "good" if all(each.get("within") for each in judged) else "bad"
