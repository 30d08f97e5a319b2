"""Plays systemd's part for one service: hears what it tells, and restarts it where it is silent."""

from __future__ import annotations

import socket
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Self

PATIENCE_S = 120.0


class SystemdStandIn:
    """A datagram socket as `NOTIFY_SOCKET` names one, and all that came to it.

    Args:
        path: of the socket; a leading `@` makes one without a file.
    """

    def __init__(self, path: Path | str) -> None:
        self.address = str(path)
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        name = self.address
        self._socket.bind("\0" + name[1:] if name.startswith("@") else name)
        self._news = threading.Condition()
        self.heard: list[str] = []
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()

    def environment(self, watchdog_s: float | None = None) -> dict[str, str]:
        """What systemd would set for the service."""
        found = {"NOTIFY_SOCKET": self.address}
        if watchdog_s is not None:
            found["WATCHDOG_USEC"] = str(round(watchdog_s * 1e6))
        return found

    def count(self, line: str) -> int:
        """How often a line came."""
        return self.heard.count(line)

    def wait_for(self, found: Callable[[], bool], timeout_s: float = PATIENCE_S) -> bool:
        """Wait until something is so; False where it is not so in time."""
        with self._news:
            return self._news.wait_for(found, timeout_s)

    def wait_for_more(self, line: str, more: int = 1) -> None:
        """Wait until a line has come that many times more."""
        before = self.count(line)
        assert self.wait_for(lambda: self.count(line) >= before + more), (line, self.heard)

    def wait_for_silence(self, line: str, watchdog_s: float) -> None:
        """Return once a line did not come for so long, as systemd's watchdog does."""
        before = -1
        while before != self.count(line):
            before = self.count(line)
            self.wait_for(lambda at=before: self.count(line) > at, watchdog_s)  # type: ignore[misc]

    def close(self) -> None:
        """Listen no more."""
        self._socket.sendto(b"", self._socket.getsockname())
        self._thread.join(PATIENCE_S)
        self._socket.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _listen(self) -> None:
        while data := self._socket.recv(4096):
            with self._news:
                self.heard += data.decode().split("\n")
                self._news.notify_all()
