"""Tells systemd that a service is ready, and that its loop is alive: the loop itself does not.

The loop counts in shared memory (`Ring.beat`). As long as that count grows, whoever holds the other
end pings the watchdog: the observer, or the service's own process once the observer has died.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from hoap3.protocol.messages import State
from hoap3.tools.machine.sd_notify import Notifier, NotifySettings

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

    @property
    def refused(self) -> str:
        """Why systemd could not be told the last time; "" if it could."""
        return self._notifier.refused

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
