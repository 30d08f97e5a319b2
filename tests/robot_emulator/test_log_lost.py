"""A robot whose log is not written any more says so, once, and goes on."""

from __future__ import annotations

import errno
import os

import pytest
from support.robot_bench import EVENT_NAMES, Bench

from hoap3.protocol.messages import Event, State
from hoap3.protocol.runtime.recorder import BlockingRecorder, MemoryRecorder, RingRecorder
from hoap3.protocol.runtime.shm_ring import Ring

LOG_LOST = Event.schema.constants["LOG_LOST"]


class LosingRecorder(MemoryRecorder):
    """One that keeps all that it is given, and says what it is told to say of it."""

    lost: int | None = None


@pytest.mark.parametrize("code", [errno.ENOSPC, 0])
def test_the_network_is_told_once_and_the_robot_goes_on(code: int) -> None:
    bench = Bench()
    recorder = LosingRecorder()
    bench.recorder = bench.robot._recorder = recorder
    announced: list[bytes] = []
    bench.link.announce = announced.append
    bench.link.ask("acquire", "alice")
    bench.run(5)
    assert "LOG_LOST" not in [name for name, *_ in bench.events()]
    recorder.lost = code
    state = bench.run(20)
    told = [event for event in bench.events() if event[0] == "LOG_LOST"]
    assert told == [("LOG_LOST", 5, code)]
    kinds = []
    for payload in announced:
        event = Event()
        event.load(payload)
        kinds.append(EVENT_NAMES[event.kind])
    assert kinds.count("LOG_LOST") == 1
    assert (state.mode, state.tick) == (State.ACTIVE, 24)
    assert state.late + state.lost == 0


def test_a_recorder_says_what_became_of_its_ring() -> None:
    ring = Ring(slots=4)
    try:
        recorder = RingRecorder(ring)
        assert recorder.lost is None
        ring.lost = errno.EROFS
        assert recorder.lost == errno.EROFS
        assert BlockingRecorder(ring, lambda: True).lost is None  # virtual time stays as it is
    finally:
        os.close(ring.fd)
