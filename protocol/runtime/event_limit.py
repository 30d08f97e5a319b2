"""Limits how many events, or requests, of one kind are announced and logged.

Anybody on the network can ask for authority thousands of times a second, and a controller that
chatters at a limit begins to be held back hundreds of times a second. Without a limit each of that
would be an event on the network, a record in the log and a line on the terminal.
"""

from __future__ import annotations

from collections.abc import Iterable

LIMITED = (
    *("REFUSED", "GRANTED", "RELEASED", "HOLDER_LOST", "RECOVERED"),
    *("CLIPPED", "TORQUE_LIMITED", "NAME_CONFLICT"),
)
"""Kinds that requests and setpoints cause. Safe stops are not: each takes at least 20 ticks."""

BURST = 10  # of one kind that may come at once
PERIOD_NS = 1_000_000_000  # after which one more may come


class EventLimit:
    """Says which events pass, and how many of each kind were left out.

    Args:
        kinds: that are limited; all others pass.

    Attributes:
        any_left_out: whether some were that nobody has been told of.
    """

    def __init__(self, kinds: Iterable[str] = LIMITED) -> None:
        self._room = dict.fromkeys(kinds, BURST)
        self._since = dict.fromkeys(kinds, 0)  # when the room last grew, or was full [ns]
        self._left_out: dict[str, int] = {}
        self._told: dict[str, int] = {}  # when left_out began [ns]
        self.any_left_out = False

    def passes(self, kind: str, now: int) -> bool:
        """Whether an event of this kind may be announced now [ns]; if not, it is counted."""
        if kind not in self._room:
            return True
        if self._room[kind] == BURST:
            self._since[kind] = now
        grown = (now - self._since[kind]) // PERIOD_NS
        self._since[kind] += grown * PERIOD_NS
        self._room[kind] = min(BURST, self._room[kind] + grown)
        if self._room[kind]:
            self._room[kind] -= 1
            return True
        self._told.setdefault(kind, now)
        self._left_out[kind] = self._left_out.get(kind, 0) + 1
        self.any_left_out = True
        return False

    def left_out(self, now: int, *, at_end: bool = False) -> list[tuple[str, int]]:
        """Kinds, and how many of each were left out in the last second; each is told once.

        At the end nothing waits for its second to be over.
        """
        due = [kind for kind, at in self._told.items() if at_end or now - at >= PERIOD_NS]
        self.any_left_out = len(due) < len(self._told)
        for kind in due:
            del self._told[kind]
        return [(kind, self._left_out.pop(kind)) for kind in due]
