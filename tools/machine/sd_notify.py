"""What a service tells systemd: datagrams to the socket that `NOTIFY_SOCKET` names.

`READY=1`, `WATCHDOG=1`, `STATUS=…`, `STOPPING=1`: see sd_notify(3).
"""

from __future__ import annotations

import os
import socket
from collections.abc import Mapping
from dataclasses import dataclass

from hoap3.protocol.errors import UsageError


@dataclass(frozen=True)
class NotifySettings:
    """Where systemd listens, and how often it wants to hear that a service is alive.

    Attributes:
        address: of its socket; `@` begins one without a file.
        watchdog_s: time without a sign of life after which it ends the service [s], or None.
    """

    address: str
    watchdog_s: float | None = None

    @classmethod
    def of(cls, environment: Mapping[str, str]) -> NotifySettings | None:
        """What `NOTIFY_SOCKET` and `WATCHDOG_USEC` say; None where nobody listens.

        Raises:
            UsageError: neither a path nor a name, or no number of microseconds above 0.
        """
        address = environment.get("NOTIFY_SOCKET", "")
        if not address:
            return None
        if address[0] not in "/@":
            raise UsageError(
                f"NOTIFY_SOCKET={address}: is no path of a Unix socket. Unset it, or start the "
                "service by systemd"
            )
        told = environment.get("WATCHDOG_USEC")
        if told is None:
            return cls(address)
        if not (told.isdecimal() and int(told)):
            raise UsageError(
                f"WATCHDOG_USEC={told}: is no number of microseconds. Set WatchdogSec= in the unit"
            )
        return cls(address, int(told) / 1e6)


class Notifier:
    """Sends what systemd shall know, from any thread; never waits, and never fails who tells.

    Args:
        address: as in `NotifySettings`.

    Attributes:
        refused: why the last datagram did not arrive; "" if it did.
    """

    def __init__(self, address: str) -> None:
        self._to = "\0" + address[1:] if address[0] == "@" else address
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC)
        self._socket.setblocking(False)
        self.refused = ""

    def send(self, **facts: str) -> bool:
        """Tell facts such as `READY="1"`; False where they do not arrive."""
        lines = (f"{name}={' '.join(text.split())}" for name, text in facts.items())
        try:
            self._socket.sendto("\n".join(lines).encode(), self._to)
        except OSError as error:
            self.refused = os.strerror(error.errno) if error.errno else str(error)
            return False
        self.refused = ""
        return True

    def close(self) -> None:
        """Nothing is told any more."""
        self._socket.close()
