"""A client's connection for frames of HOAP-3's protocol, as the robot has it.

The robot's loop sends, and a thread receives; neither waits for the client.
"""

from __future__ import annotations

import contextlib
import socket
import time
from collections import deque

DOUBT_S = 1.0
SAME = "do both ends have the same link.hoap3_tcp"


class ClientConnection:
    """What the robot knows of the one client that it follows.

    Args:
        who: its name as holder of authority.
        connection: closed by whoever made it.
        wanted: how many frames each end sends.
        size: of a frame [bytes].
        legacy: whether the client speaks first.

    Attributes:
        flying: of each State that waits for an answer what the answer has to echo.
        newest_tick: of the States that were sent or left out, -1 before the first.
        received: frames from it.
        left: whether the robot has ended it, which follows it no more.
    """

    def __init__(
        self, who: str, connection: socket.socket, wanted: int, size: int, *, legacy: bool
    ) -> None:
        self.who, self.connection, self._wanted = who, connection, wanted
        self._size, self._legacy = size, legacy
        connection.setblocking(False)
        self.flying: deque[tuple[int, int, int, int]] = deque()
        self.newest_tick, self.received, self._sent = -1, 0, 0
        self.left = self._stuck = self._doubted = False
        self._part = b""
        self._heard = time.monotonic()

    @property
    def complete(self) -> bool:
        """Whether each end has sent all its frames."""
        return self.served and self._sent >= self._wanted

    @property
    def served(self) -> bool:
        """Whether the client has sent all its frames: then it may go."""
        return self.received >= self._wanted

    @property
    def wants_state(self) -> bool:
        """Whether it is the robot's turn: where the client speaks first, for each of its frames."""
        return self._sent < (min(self.received, self._wanted) if self._legacy else self._wanted)

    def send(self, frame: bytes, asked: tuple[int, int, int, int]) -> None:
        """Send a frame; a client that takes none is left, and one that has all its frames."""
        self.flying.append(asked)
        self.newest_tick = asked[1]
        try:
            whole = self.connection.send(frame) == self._size
        except BlockingIOError:
            whole = False
        except OSError:  # it has gone, as the thread will see
            whole = True
        self._stuck = not whole
        self._sent += 1  # after it is sent: the thread closes what is complete
        if self._stuck or self.complete:
            self.leave()

    def receive(self) -> bytes | None:
        """What has arrived, once it is a whole frame.

        Raises:
            ConnectionError: it has gone, or spoke out of turn, a part of a frame; says which.
        """
        try:
            data = self.connection.recv(self._size - len(self._part))
        except BlockingIOError:
            return None
        except OSError:  # such as a reset
            data = b""
        if not data:
            why = "takes no frames, and was left" if self._stuck else f"has gone {self._where()}"
            raise ConnectionError(why)
        self._heard = time.monotonic()
        self._part += data
        if len(self._part) < self._size:
            if not self.flying and self.received:
                raise ConnectionError(f"spoke out of turn {self._where()}")
            return None
        frame, self._part = self._part, b""
        return frame

    def doubt(self) -> str:
        """Once where it has been silent for long though it should speak: that, in words."""
        silent = time.monotonic() - self._heard
        its_turn = self._part or (self._legacy and not self.received)
        if self._doubted or silent < DOUBT_S or not its_turn:
            return ""
        self._doubted = True
        return f"has been silent for {silent:.0f} s {self._where()}"

    @property
    def within_frame(self) -> bool:
        """Whether a part of a frame has arrived."""
        return bool(self._part)

    def leave(self) -> None:
        """End the connection; from any thread."""
        with contextlib.suppress(OSError):
            self.connection.shutdown(socket.SHUT_RDWR)

    def _where(self) -> str:
        if self._part:
            return f"within a frame, {len(self._part)} of {self._size} bytes: {SAME}.slots?"
        if self._legacy and not self.received:
            return f"before its first frame: {SAME}.order?"
        return f"after {self.received} of {self._wanted} exchanges"
