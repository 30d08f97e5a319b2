"""Overruns of HOAP-3's FIFO on virtual time: each one that is made is counted, and no other."""

from __future__ import annotations

import random
import socket
import struct
import threading
from collections.abc import Iterable, Sequence
from contextlib import closing

import pytest

from hoap3.protocol.config.settings import Hoap3TcpSettings
from hoap3.protocol.link.base import Arrival, Request
from hoap3.protocol.link.hoap3_tcp.robot_link import FIFO, Hoap3RobotLink
from hoap3.protocol.messages import State
from hoap3.protocol.runtime.clock import VirtualClock
from hoap3.protocol.runtime.recorder import NoRecorder
from hoap3.robot_emulator.config import EmulatorConfig
from hoap3.robot_emulator.robots import load
from hoap3.robot_emulator.service import build_loop

PATIENCE_S = 30.0
TICKS = 500
ANSWER_NS = 200_000
FRAME = struct.Struct("<21d")


class PausingClient:
    """A robot's link whose client pauses at given ticks, and answers all that waits at others.

    Args:
        inner: a robot's link.
        clock: of the robot.
        pauses: ticks, counted from the first one that asks.
    """

    name_conflicts = 0

    def __init__(self, inner: Hoap3RobotLink, clock: VirtualClock, pauses: set[int]) -> None:
        self._inner, self._clock, self._pauses = inner, clock, pauses
        self._landed: list[Arrival] = []
        self._asked = self.sent = 0
        with socket.create_connection(("127.0.0.1", inner.ports[0])) as first:
            first.sendall(struct.pack("<2d", 1, 1000))
            self._client = socket.create_connection(("127.0.0.1", inner.ports[1]))
        self._client.settimeout(PATIENCE_S)
        self._came = threading.Event()

    def publish(self, state: bytes) -> None:
        (mode,) = State.scalars(state, "mode")
        self._inner.publish(state)
        if mode != State.ACTIVE:
            return
        self._asked += 1
        if self._asked in self._pauses:
            return
        waiting = len(self._inner._client.flying)
        for _ in range(waiting):
            self._client.sendall(self._client.recv(FRAME.size, socket.MSG_WAITALL))
        arrived: list[Arrival] = []
        while len(arrived) < waiting:
            assert self._inner.arrival.wait(PATIENCE_S)
            self._inner.arrival.clear()
            arrived += self._inner.drain()
        self.sent += waiting
        self._landed += [(self._clock.now() + ANSWER_NS, answer) for _, answer in arrived]

    def drain(self) -> Sequence[Arrival]:
        landed, self._landed = self._landed, []
        return landed

    def requests(self) -> Iterable[Request]:
        if not self._asked:  # virtual time waits for the client
            assert self._inner.arrival.wait(PATIENCE_S)
            self._inner.arrival.clear()
        return self._inner.requests()

    def announce(self, event: bytes) -> None:
        self._inner.announce(event)

    def tokens(self) -> Sequence[tuple[str, bool]]:
        return self._inner.tokens()

    def look_again(self, who: str) -> None:
        self._inner.look_again(who)

    def counts(self) -> dict[str, int]:
        return self._inner.counts()

    def close(self) -> None:
        self._client.close()
        self._inner.close()


def some_pauses(seed: int) -> set[int]:
    """Ticks of pauses of 1 to 30, with at least one answered tick in between."""
    choose, tick, found = random.Random(seed), 1, set()
    while tick < TICKS - 40:
        tick += choose.randint(1, 40)
        length = choose.randint(1, 30)
        found |= set(range(tick, tick + length))
        tick += length
    return found


def expected(pauses: set[int], room: int) -> int:
    """How many States find no room, where the client answers all that waits after each pause."""
    waiting = overruns = 0
    for tick in range(1, TICKS + 1):
        overruns += waiting == room
        waiting = min(waiting + 1, room) if tick in pauses else 0
    return overruns


@pytest.mark.parametrize("delay", [0, 3])
@pytest.mark.parametrize("seed", [1, 2])
def test_each_overrun_is_counted_and_no_other(seed: int, delay: int) -> None:
    description = load("hoap3").model_copy(update={"delay_ticks": delay})
    settings, clock = Hoap3TcpSettings(init_port=0, control_port=0), VirtualClock()
    inner = Hoap3RobotLink(description, settings, lambda _: None, blocking=True)
    pauses = some_pauses(seed)
    with closing(PausingClient(inner, clock, pauses)) as link:
        config = EmulatorConfig(misses_to_stop=TICKS, delay_ticks=delay)
        robot = build_loop(config, description, clock, link, NoRecorder(), lockstep=True)
        robot.run(0, lambda: False, TICKS)
        overruns, deadlines = expected(pauses, FIFO + delay), robot.validator.deadlines
        assert overruns > 20
        assert link.counts()["overruns"] == overruns
        assert deadlines.lost == overruns  # and every State that was sent got its answer
        assert deadlines.asked == TICKS == link.sent + overruns
        assert robot.safe_stops == 0
