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
        """Move on so many times as fast as time; from the end that it would move to, once more."""
        self.go(self.at_s)
        self.speed = speed
        if self._is_over():
            self.go(self.ends[0 if speed > 0.0 else 1])

    def runs(self) -> bool:
        """Whether it moves on; at the end that it moved to it stays from now on."""
        if self._is_over():
            self.run(0.0)
        return self.speed != 0.0

    def _is_over(self) -> bool:
        return self.speed != 0.0 and self.at_s == self.ends[1 if self.speed > 0.0 else 0]
