"""Events of constraints as conditions of a controller."""

from __future__ import annotations

from hoap3.remote_controller.constraints.stack import Stack


class EventConditions:
    """Which events of a stack happened since the last look, as `LABEL: EVENT`.

    Args:
        stack: the constraints.

    Attributes:
        names: of all events that can happen.
    """

    def __init__(self, stack: Stack) -> None:
        self._events = [
            (label, constraint.events, event)
            for label, constraint in zip(stack.labels, stack.constraints, strict=True)
            for event in constraint.events
        ]
        self.names = tuple(f"{label}: {event}" for label, _, event in self._events)
        self._counted = [0] * len(self._events)

    def look(self) -> int:
        """Bit i: event `names[i]` was counted since the last look."""
        present = 0
        for place, (_, counts, event) in enumerate(self._events):
            if counts[event] != self._counted[place]:
                self._counted[place] = counts[event]
                present |= 1 << place
        return present
