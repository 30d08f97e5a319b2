"""A client's connection for frames of HOAP-3's protocol, as the robot has it.

The robot's loop sends, and a thread receives; neither waits for the client.
"""

from __future__ import annotations

import contextlib
import socket
from collections import deque


class ClientConnection:
    """What the robot knows of the one client that it follows.

    Attributes:
        who: its name as holder of authority.
        flying: of each State that waits for an answer what the answer has to echo.
        newest_tick: of the States that were sent or left out, -1 before the first.
        received: frames from it.
        left: whether the robot has ended it, which follows it no more.
    """

    def __init__(self, who: str, connection: socket.socket, wanted: int) -> None:
        self.who, self.connection, self._wanted = who, connection, wanted
        connection.setblocking(False)
        self.flying: deque[tuple[int, int, int, int]] = deque()
        self.newest_tick, self.received, self._sent = -1, 0, 0
        self.left = False
        self._part = b""

    @property
    def complete(self) -> bool:
        """Whether each end has sent all its frames."""
        return min(self.received, self._sent) >= self._wanted

    def wants_state(self, order: str) -> bool:
        """Whether it is the robot's turn: where the client speaks first, for each of its frames."""
        turn = self._sent < self.received if order == "legacy" else True
        return turn and self._sent < self._wanted

    def send(self, frame: bytes, asked: tuple[int, int, int, int]) -> None:
        """Send a frame; a client that takes none is left."""
        self.flying.append(asked)
        self.newest_tick = asked[1]
        self._sent += 1
        try:
            whole = self.connection.send(frame) == len(frame)
        except OSError:
            whole = False
        if not whole:
            self.leave()

    def receive(self, size: int) -> bytes | None:
        """What has arrived, once it is a whole frame.

        Raises:
            OSError: it has gone; says whether within a frame.
        """
        try:
            data = self.connection.recv(size - len(self._part))
        except BlockingIOError:
            return None
        except ConnectionError:
            data = b""
        if not data:
            raise ConnectionError(self._ended(size))
        self._part += data
        if len(self._part) < size:
            return None
        frame, self._part = self._part, b""
        return frame

    def leave(self) -> None:
        """End the connection; from any thread."""
        with contextlib.suppress(OSError):
            self.connection.shutdown(socket.SHUT_RDWR)

    def _ended(self, size: int) -> str:
        if not self._part:
            return f"has gone after {self.received} of {self._wanted} exchanges"
        return (
            f"has gone within a frame, {len(self._part)} of {size} bytes: do both ends have the "
            "same link.hoap3_tcp.slots?"
        )
