"""Lockstep over a network: the same messages, but each State waits for its answer."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from itertools import islice
from typing import Any

from hoap3.protocol.errors import LinkError, WireError
from hoap3.protocol.link.base import Arrival, LockstepLink, RemoteRobotLink, Request
from hoap3.protocol.link.local_control import LocalControl
from hoap3.protocol.messages import Setpoint, State
from hoap3.protocol.runtime.clock import VirtualClock

REPEAT_S = 0.05
LAST_S = 0.2  # how long to wait for an answer in transit after a stop request
GIVE_UP_S = 10.0
WAITING = 64  # requests; of more only what ends the waiting is taken
Address = tuple[int, int, int]  # session, tick, epoch
KEPT_ANSWERS = 8  # that may come again
MAX_IN_FLIGHT = 1024  # setpoints that wait to be validated; further ones are counted and dropped


class RemoteLockstepLink(LockstepLink):
    """The robot's side.

    A State that asks for an answer is repeated every 50 ms of wall time until it is answered, or
    until the holder of authority leaves; a controller over Zenoh answers a repeated one with the
    bytes that it has sent already, and over HOAP-3's protocol none is sent twice. Before the first
    State, virtual time stands still until a controller has authority; with an `endless` robot it
    does so again whenever that is at rest, until it is told to follow or to recover.

    Args:
        inner: what reaches the controller; it is closed with this one.
        clock, compute_time: as for `LockstepLink`.
        should_stop: asked while waiting.
        endless: no end is set to the robot's time.

    Raises:
        LinkError: no answer for ten seconds; names the tick.
    """

    def __init__(
        self,
        inner: RemoteRobotLink,
        clock: VirtualClock,
        compute_time: int,
        should_stop: Callable[[], bool],
        *,
        endless: bool = False,
    ) -> None:
        super().__init__(self._exchange_over_network, clock, compute_time)
        self._inner = inner
        self._should_stop, self._endless = should_stop, endless
        self._waiting: list[Request] = []
        self._holder: str | None = None
        self._awake = False
        self._answers = deque[bytes](maxlen=KEPT_ANSWERS)
        self._overflowed = 0

    @property
    def name_conflicts(self) -> int:  # type: ignore[override]
        """How many other robots on the network use the robot's name."""
        return self._inner.name_conflicts

    def drain(self) -> Sequence[Arrival]:
        """Setpoints whose virtual arrival time has come; what has arrived since is sent after."""
        self._receive()
        return super().drain()

    def requests(self) -> Iterable[Request]:
        """Requests that have arrived; while time stands still, wait for one that moves it."""
        while True:
            self._gather()
            for request in self._waiting:
                yield self._watched(request)
            self._waiting.clear()
            if self._awake or self._should_stop():
                return
            self._inner.arrival.wait(REPEAT_S)
            self._inner.arrival.clear()

    def announce(self, event: bytes) -> None:
        """Send an Event."""
        self._inner.announce(event)

    def serve_also(self, local: LocalControl) -> None:
        """Take requests of the robot's own machine, too; they come first."""
        self._inner.serve_also(local)

    def tokens(self) -> Sequence[tuple[str, bool]]:
        """Clients whose tokens have come or gone."""
        return self._inner.tokens()

    def look_again(self, who: str) -> None:
        """Check whether a client is alive."""
        self._inner.look_again(who)

    def counts(self) -> dict[str, int]:
        """What the link itself counts."""
        counts = self._inner.counts()
        overflowed = counts.get("overflowed", 0) + self._overflowed
        return {**counts, "overflowed": overflowed} if overflowed else counts

    def close(self) -> None:
        """Leave the network."""
        self._inner.close()

    def _exchange_over_network(self, payload: bytes) -> bytes | None:
        mode, session_id, tick, epoch = State.scalars(
            payload, "mode", "session_id", "tick", "epoch"
        )
        inner = self._inner
        inner.publish(payload)
        if self._endless and mode in {State.IDLE, State.STOPPED}:
            self._awake = False
        if mode != State.ACTIVE:
            return None
        asked = session_id, tick, epoch
        began = repeated = time.monotonic()
        while not self._should_stop():
            inner.arrival.wait(REPEAT_S)
            inner.arrival.clear()
            if self._receive(asked):
                return None  # it is in flight
            self._gather()
            if any(self._leaves(request) for request in self._waiting):
                break
            now = time.monotonic()
            if now - began > GIVE_UP_S:
                raise LinkError(f"lockstep: no answer to tick {tick} for {GIVE_UP_S:.0f} s")
            if now - repeated >= REPEAT_S:
                inner.publish(payload)
                repeated = now
        else:
            inner.arrival.wait(LAST_S)
        self._receive(asked)  # sent just before the controller left or a stop was requested
        return None

    def _receive(self, asked: Address | None = None) -> bool:
        """Send all that has arrived to the robot, which validates it; whether `asked` is answered.

        The bytes of an answer are not sent twice: a State that was repeated is answered again.
        """
        answered = False
        for _, payload in self._inner.drain():
            if payload in self._answers:
                continue
            address = _address(payload)
            ends = asked is not None and address is not None and address[1] == asked[1]
            if not ends and len(self._flying) >= MAX_IN_FLIGHT:
                self._overflowed += 1
                continue
            if ends and address == asked:
                self._answers.append(payload)
            answered |= ends
            self.send(payload)
        return answered

    def _gather(self) -> None:
        """Take requests until the robot serves them, the first ones where there are too many.

        What ends the waiting is always taken: news of clients, local requests, and a `stop`.
        """
        for request in islice(self._inner.requests(), WAITING):
            urgent = request.local or request.verb == "gone"
            stops = request.verb == "stop" and all(one.verb != "stop" for one in self._waiting)
            if urgent or stops or len(self._waiting) < WAITING:
                self._waiting.append(request)

    def _leaves(self, request: Request) -> bool:
        """Whether it ends the waiting for an answer: the holder leaves, or the user says so."""
        if request.local:
            return request.verb in {"release", "stop"}
        return request.verb in {"release", "gone"} and request.who == self._holder

    def _watched(self, request: Request) -> Request:
        """The same, but we learn from its answer who holds authority, and whether time goes on."""

        def answer(content: dict[str, Any] | bytes) -> None:
            if isinstance(content, dict):
                if content.get("granted"):
                    self._holder = request.who
                self._awake |= bool(content.get("granted") or content.get("recovered"))
            request.answer(content)

        return replace(request, answer=answer)


def _address(payload: bytes) -> Address | None:
    """What a setpoint answers; None where it is no setpoint."""
    try:
        session_id, tick, epoch = Setpoint.scalars(payload, "session_id", "tick", "epoch")
    except WireError:
        return None
    return session_id, tick, epoch
