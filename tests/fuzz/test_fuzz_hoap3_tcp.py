"""HOAP-3's TCP port: frames and beginnings of all kinds, and clients that send whatever."""

from __future__ import annotations

import math
import random
import socket
import struct
import threading
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import suppress

import numpy as np
import pytest
from fuzzing import (
    Findings,
    amount,
    bounded,
    corpus,
    mutate_bytes,
)
from wire_mutations import REALS

from hoap3.protocol.config.settings import Hoap3TcpSettings
from hoap3.protocol.link.hoap3_tcp.frames import Frames, exchanges
from hoap3.protocol.link.hoap3_tcp.robot_link import Hoap3RobotLink
from hoap3.protocol.messages import Setpoint, State
from hoap3.robot_emulator.robots import load

HOAP3 = load("hoap3")
BEGINNINGS = [bytes.fromhex(line) for line in corpus("hoap3_tcp")[0].decode().split()]
PATIENCE_S = 60.0
WAITS_S = 0.02  # of a client that may have said nothing to which there is an answer


@pytest.mark.parametrize("slots", [21, 22])
@amount(300)
def test_a_frame_says_what_its_doubles_say_or_nothing(slots: int, count: int) -> None:
    draw, frames, outcomes = (
        random.Random(f"{slots} {count}"),
        Frames(HOAP3, slots),
        Counter[bool](),
    )
    scales = np.array([joint.encoder_counts_per_rad for joint in HOAP3.joints], float)
    for _ in range(count):
        doubles = [draw.uniform(-40_000, 40_000) for _ in range(slots)]
        for _ in range(draw.choice((0, 0, 1, 3))):
            doubles[draw.randrange(slots)] = draw.choice(REALS)
        found = frames.unpack(struct.pack(f"<{slots}d", *doubles))
        finite = all(map(math.isfinite, doubles[: HOAP3.n]))
        outcomes[finite] += 1
        assert (found is not None) == finite
        if found is not None:
            counts = [min(max(math.trunc(x), -32768), 32767) for x in doubles[: HOAP3.n]]
            assert np.array_equal(found, np.array(counts) / scales)
    assert min(outcomes.values()) > 0


@amount(300)
def test_a_beginning_is_a_number_of_exchanges_or_refused(
    count: int,
    findings: Findings,
) -> None:
    draw = random.Random(count)

    def decode(data: bytes) -> None:
        cycle_ms, check_s = struct.unpack("<2d", data)
        number = exchanges(data)  # else it is refused
        assert 1 <= number <= check_s * 1000
        assert number == int(check_s * 1000.0 / cycle_ms)

    for _ in range(count):
        if draw.random() < 0.5:
            data = bytearray(draw.choice(BEGINNINGS))
            data[draw.randrange(16)] ^= 1 << draw.randrange(8)
        else:
            values = (*REALS, 1.0, 2.0, 10.0, 0.999, 2.0**31, 86_400.0)
            data = bytearray(struct.pack("<2d", draw.choice(values), draw.choice(values)))
        findings.judge(decode, bytes(data))
    findings.check(count)


class Robot:
    """A robot's link whose requests are granted and whose States are sent by a thread."""

    def __init__(self, order: str) -> None:
        self.said: list[str] = []
        settings = Hoap3TcpSettings(init_port=0, control_port=0, order=order)
        self.link = Hoap3RobotLink(HOAP3, settings, self.said.append)
        self.arrived = 0
        self.heard = Counter[str]()
        self._state = State.allocate(**HOAP3.state_lengths)
        self._state.session_id, self._state.epoch, self._state.mode = 7, 3, State.ACTIVE
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        answer = Setpoint(HOAP3.n)
        while not self._ending.wait(0.001):
            for request in self.link.requests():
                self.heard[request.verb] += 1
                request.answer({"granted": True})
            for _, payload in self.link.drain():
                answer.load(payload)
                assert np.isfinite(answer.values).all()
                self.arrived += 1
            self._state.tick += 1
            self.link.publish(self._state.dump())

    def close(self) -> None:
        self._ending.set()
        self._thread.join()
        self.link.close()


@pytest.fixture(params=["paper", "legacy"])
def robot(request: pytest.FixtureRequest) -> Iterator[Robot]:
    made = Robot(request.param)
    yield made
    made.close()


def talk(draw: random.Random, robot: Robot) -> None:
    """One client: a beginning, and frames, any of which may be wrong."""
    beginning = draw.choice(BEGINNINGS)
    if draw.random() < 0.5:
        beginning = mutate_bytes(draw, beginning)
    frame = struct.pack("<21d", *(draw.uniform(-3e4, 3e4) for _ in range(21)))
    data = b"".join(
        mutate_bytes(draw, frame) if draw.random() < 0.5 else frame
        for _ in range(draw.choice((0, 1, 3, 10)))
    )
    with suppress(OSError), socket.create_connection(("127.0.0.1", robot.link.ports[0])) as first:
        first.sendall(beginning)
        if draw.random() < 0.1:
            return
        with socket.create_connection(("127.0.0.1", robot.link.ports[1])) as second:
            second.settimeout(WAITS_S)
            if draw.random() < 0.5:
                first.close()
            second.sendall(data)
            if draw.random() < 0.5:
                second.recv(1000)


def served(robot: Robot) -> bool:
    """Whether a client that keeps to the protocol is followed."""
    before, until = robot.arrived, time.monotonic() + PATIENCE_S
    while robot.arrived == before:
        assert time.monotonic() < until
        with (
            suppress(OSError),
            socket.create_connection(("127.0.0.1", robot.link.ports[0])) as first,
        ):
            first.sendall(struct.pack("<2d", 1.0, 10.0))
            with socket.create_connection(("127.0.0.1", robot.link.ports[1])) as second:
                second.settimeout(1.0)
                for _ in range(5):
                    second.sendall(bytes(21 * 8))
                    second.recv(21 * 8)
    return True


@pytest.mark.parametrize(
    "count", [pytest.param(30, marks=pytest.mark.slow), pytest.param(5000, marks=pytest.mark.long)]
)
def test_a_robot_outlives_all_clients(robot: Robot, count: int, monkeypatch) -> None:
    draw, failed = random.Random(count), list[object]()
    monkeypatch.setattr(threading, "excepthook", failed.append)
    with bounded():
        for _ in range(count):
            talk(draw, robot)
        assert served(robot)
    assert not failed
    assert robot.heard["acquire"] > 0
