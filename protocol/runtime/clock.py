"""Time as the loops see it: injected, so that tests and lockstep need neither sleeps nor a wall.

Both clocks count nanoseconds from an arbitrary start, never jump back and know no calendar.
"""

from __future__ import annotations

import time
from typing import Protocol


class Clock(Protocol):
    """Source of time of a loop, in nanoseconds."""

    def now(self) -> int:
        """Current time [ns]."""

    def sleep_until(self, deadline: int) -> None:
        """Return at `deadline` [ns] or, where that has passed, at once."""


class MonotonicClock:
    """CLOCK_MONOTONIC of this machine."""

    now = staticmethod(time.monotonic_ns)

    def sleep_until(self, deadline: int) -> None:
        """Sleep until an absolute time [ns]."""
        remaining = deadline - time.monotonic_ns()
        if remaining > 0:
            time.sleep(remaining * 1e-9)  # absolute inside: clock_nanosleep(TIMER_ABSTIME)


class VirtualClock:
    """Time that passes only when somebody sleeps: exact, repeatable, as fast as the machine."""

    def __init__(self, start: int = 0) -> None:
        self._now = start

    def now(self) -> int:
        """Current virtual time [ns]."""
        return self._now

    def sleep_until(self, deadline: int) -> None:
        """Jump to `deadline` [ns]; time never goes back."""
        self._now = max(self._now, deadline)

    def advance(self, duration: int) -> None:
        """Let `duration` [ns] pass, as if something had taken that long."""
        self._now += duration
