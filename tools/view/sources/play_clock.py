"""Where a page is in a log, and how fast it moves on."""

from __future__ import annotations

import math
from collections.abc import Callable


class PlayClock:
    """A place in time that moves on at some speed, between two ends.

    Args:
        now: the clock that it goes by [s].
    """

    def __init__(self, now: Callable[[], float]) -> None:
        self._now, self._set_s, self._at_s, self.speed = now, now(), 0.0, 0.0
        self.ends = (-math.inf, math.inf)

    @property
    def at_s(self) -> float:
        """Where it is."""
        gone = (self._now() - self._set_s) * self.speed
        return min(max(self._at_s + gone, self.ends[0]), self.ends[1])

    def go(self, at_s: float) -> None:
        """Go somewhere."""
        self._set_s, self._at_s = self._now(), at_s

    def run(self, speed: float) -> None:
        """Move on so many times as fast as time."""
        self.go(self.at_s)
        self.speed = speed
