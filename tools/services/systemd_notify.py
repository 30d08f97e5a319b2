"""Reports to systemd that a service is ready, and that its loop is alive: see sd_notify(3).

The loop itself does not: it counts in shared memory (`Ring.beat`). As long as that count grows, the
process at the other end pings the watchdog: the observer, or the service's own process once the
observer has died.
"""

from __future__ import annotations

import socket
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from hoap3.protocol.errors import UsageError
from hoap3.protocol.messages import State


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
    """

    def __init__(self, address: str) -> None:
        self._to = "\0" + address[1:] if address[0] == "@" else address
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC)
        self._socket.setblocking(False)

    def send(self, **facts: str) -> bool:
        """Tell facts such as `READY="1"`; False where they do not arrive."""
        lines = (f"{name}={' '.join(text.split())}" for name, text in facts.items())
        try:
            self._socket.sendto("\n".join(lines).encode(), self._to)
        except OSError:
            return False
        return True

    def close(self) -> None:
        """Nothing is told any more."""
        self._socket.close()


PINGS = 4  # in the time after which systemd ends a service
STATUS_S = 5.0
MODES = {State.IDLE: "idle", State.ACTIVE: "active", State.STOPPING: "stopping"}
MODES |= {State.STOPPED: "stopped"}


class Watchdog:
    """What systemd hears of one service.

    Args:
        settings: where it listens.
        beats: how far the loop has come; read only.
        now: monotonic time [s].
    """

    def __init__(
        self, settings: NotifySettings, beats: Callable[[], int], now: Callable[[], float]
    ) -> None:
        self._notifier = Notifier(settings.address)
        self._beats, self._now, self._ready = beats, now, False
        watchdog_s = settings.watchdog_s
        self.pause_s = None if watchdog_s is None else watchdog_s / PINGS
        self._seen = beats()
        self._ping_due = now()
        self._status_due, self._status = now(), ""

    def look(self) -> None:
        """Tell that the service is ready, and ping, where its loop has gone on; call it often."""
        beats = self._beats()
        if not self._ready:
            if not beats:
                return
            self._ready = self._notifier.send(READY="1")
        now = self._now()
        if self.pause_s is None or now < self._ping_due or beats == self._seen:
            return
        if self._notifier.send(WATCHDOG="1"):
            self._seen, self._ping_due = beats, now + self.pause_s

    def tell(self, status: str) -> None:
        """Show this line in `systemctl status`, every few seconds where it is a new one."""
        now = self._now()
        if now >= self._status_due and status != self._status:
            self._status_due = now + STATUS_S
            self._status = status if self._notifier.send(STATUS=status) else ""

    def stopping(self) -> None:
        """The loop has ended."""
        self._notifier.send(STOPPING="1")

    def close(self) -> None:
        """Tell nothing any more."""
        self._notifier.close()


def status_words(live: dict[str, Any] | None, states: int) -> str:
    """The line that people see: of a robot by its figures, of a controller by what it answered."""
    if live is None:
        return f"{states} States answered"
    if "tick" not in live:
        return "no tick yet"
    mode = MODES.get(live["mode"], "unknown")
    misses = live["late"] + live["lost"]
    return f"{mode}, tick {live['tick']}, misses {misses}, success rate {live['success_rate']:.3f}"
