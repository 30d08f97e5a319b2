"""Which messages go to those who only look on: a page, a notebook, a bridge.

Each of them would otherwise be sent as much as a controller is.
"""

from __future__ import annotations

SAMPLED_TICKS = 16  # 62.5 Hz of a robot at 1 kHz
_KIND, _TICK = slice(8, 12), slice(20, 28)
"""Of a message: mode of a State, or command of a Setpoint; and the tick. See docs/wire.md."""


class Sampling:
    """Of each `SAMPLED_TICKS` ticks the first message, and each where the mode changed."""

    def __init__(self) -> None:
        self._last = (b"", -1)

    def takes(self, message: bytes) -> bool:
        """Whether a State or a Setpoint is one of them; each message is asked about once."""
        this = message[_KIND], int.from_bytes(message[_TICK], "little") // SAMPLED_TICKS
        if this == self._last:
            return False
        self._last = this
        return True
