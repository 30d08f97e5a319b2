"""A start without a jump: the rate of decrease rises from nothing to what it is."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from hoap3.protocol.messages import State

RampTime = Annotated[
    float,
    Field(
        ge=0,
        description="time in which Ψ rises to its size, so that no joint jumps [s]; 0: at once",
    ),
]


class Ramp:
    """Share of Ψ, growing linearly with the robot's time since the first State after a restart.

    Args:
        ramp_s: time until the share is 1 [s]; 0: at once.
        period_s: of the robot [s].

    Attributes:
        share: greater than 0, at most 1.
    """

    def __init__(self, ramp_s: float, period_s: float) -> None:
        self._ticks = ramp_s / period_s
        self._first = -1
        self.share = 1.0

    def restart(self) -> None:
        """Begin again at the next State."""
        self._first = -1

    def advance(self, state: State) -> None:
        """Take a State; periods that the robot skipped do not count, whatever it says of them."""
        tick = state.tick - state.skipped
        if self._first < 0:
            self._first = tick
        done = max(tick - self._first + 1, 1)
        self.share = 1.0 if done >= self._ticks else done / self._ticks
