"""Lockstep over Zenoh: the same messages on the same keys, but each State waits for its answer."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable

from protocol.clock import VirtualClock
from protocol.errors import LinkError, WireError
from protocol.link import LockstepLink, Request
from protocol.messages import Setpoint, State
from protocol.settings import LinkSettings
from protocol.zenoh_link import ZenohRobotLink

REPEAT_S = 0.05
GIVE_UP_S = 10.0


class ZenohLockstepLink(LockstepLink):
    """The robot's side.

    A State that asks for an answer is repeated every 50 ms of wall time until it is answered;
    the controller answers a repeated one with the bytes that it has sent already. Before the
    first State, virtual time stands still until a controller has asked for authority.

    Raises:
        LinkError: no answer for ten seconds; names the tick.
    """

    def __init__(
        self,
        robot: str,
        settings: LinkSettings,
        clock: VirtualClock,
        compute_time: int,
        should_stop: Callable[[], bool],
    ) -> None:
        super().__init__(self._exchange_over_zenoh, clock, compute_time)
        self._inner = ZenohRobotLink(robot, settings, blocking=True)
        self._should_stop = should_stop
        self._begun = False

    def requests(self) -> Iterable[Request]:
        """Requests that have arrived; at first, wait until there is one for authority."""
        while not (self._begun or self._should_stop()):
            for request in self._inner.requests():
                self._begun |= request.verb == "acquire"
                yield request
            if not self._begun:
                self._inner.arrival.wait(REPEAT_S)
                self._inner.arrival.clear()
        yield from self._inner.requests()

    def announce(self, event: bytes) -> None:
        """Send an Event."""
        self._inner.announce(event)

    def close(self) -> None:
        """Leave the network."""
        self._inner.close()

    def _exchange_over_zenoh(self, payload: bytes) -> bytes | None:
        mode, tick = State.scalars(payload, "mode", "tick")
        inner = self._inner
        inner.publish(payload)
        if mode != State.ACTIVE:
            return None
        began = repeated = time.monotonic()
        while not self._should_stop():
            inner.arrival.wait(REPEAT_S)
            inner.arrival.clear()
            for _, answer in inner.drain():
                if _answers(answer, tick):
                    return answer
            now = time.monotonic()
            if now - began > GIVE_UP_S:
                raise LinkError(f"lockstep: no answer to tick {tick} for {GIVE_UP_S:.0f} s")
            if now - repeated >= REPEAT_S:
                inner.publish(payload)
                repeated = now
        return None


def _answers(payload: bytes, tick: int) -> bool:
    try:
        return Setpoint.scalars(payload, "tick") == (tick,)
    except WireError:
        return False
