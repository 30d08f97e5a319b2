"""Recorders: what loops write to."""

from __future__ import annotations

import os
from collections.abc import Iterator

import pytest

from hoap3.protocol.errors import Hoap3Error
from hoap3.protocol.runtime.recorder import (
    BlockingRecorder,
    RingRecorder,
)
from hoap3.protocol.runtime.shm_ring import Kind, Record, Ring


@pytest.fixture
def ring() -> Iterator[Ring]:
    made = Ring(slots=4, slot_bytes=5000)
    yield made
    os.close(made.fd)


class Reader:
    """An observer that reads when it is asked whether it lives, and dies when it is told to."""

    def __init__(self, ring: Ring, *, dies_after: int | None = None) -> None:
        self.ring, self.records = Ring(ring.fd), list[Record]()
        self.asked, self.dies_after = 0, dies_after

    def alive(self) -> bool:
        self.asked += 1
        if self.dies_after is not None and self.asked > self.dies_after:
            return False
        if self.dies_after is None:
            self.records += self.ring.read()
        return True


def test_a_ring_recorder_writes_and_never_waits(ring):
    recorder = RingRecorder(ring)
    recorder.record(Kind.DESCRIPTION, 0, bytes(10_000))
    for stamp in range(1, 6):
        recorder.record(Kind.STATE, stamp, b"x")
    assert [record.stamp for record in Ring(ring.fd).read()] == [0, 1]
    assert ring.dropped == 4


def test_a_patient_recorder_waits_for_a_slow_reader_and_drops_nothing(ring):
    reader = Reader(ring)
    recorder = BlockingRecorder(ring, reader.alive)
    for stamp in range(100):
        recorder.record(Kind.STATE, stamp, b"x")
    reader.records += reader.ring.read()
    assert [record.stamp for record in reader.records] == list(range(100))
    assert ring.dropped == 0
    assert reader.asked == 24  # each time after four slots were full


def test_a_patient_recorder_waits_for_the_reserve_of_a_ring_too():
    ring = Ring(slots=32, slot_bytes=5000)
    reader = Reader(ring)
    recorder = BlockingRecorder(ring, reader.alive)
    for stamp in range(100):
        recorder.record(Kind.STATE if stamp % 3 else Kind.EVENT, stamp, b"x")
    reader.records += reader.ring.read()
    assert [record.stamp for record in reader.records] == list(range(100))
    assert ring.dropped == 0
    os.close(ring.fd)


def test_a_patient_recorder_waits_for_room_for_the_whole_of_a_large_record(ring):
    reader = Reader(ring)
    recorder = BlockingRecorder(ring, reader.alive)
    recorder.record(Kind.STATE, 0, b"x")
    recorder.record(Kind.STATE, 1, b"x")
    recorder.record(Kind.DESCRIPTION, 2, bytes(12_000))
    reader.records += reader.ring.read()
    assert [len(record.payload) for record in reader.records] == [1, 1, 12_000]
    assert ring.dropped == 0


@pytest.mark.parametrize("dies_after", [0, 3])
@pytest.mark.parametrize("payload", [b"x", bytes(5000)])
def test_a_patient_recorder_says_so_when_its_reader_has_died(ring, dies_after, payload):
    reader = Reader(ring, dies_after=dies_after)
    recorder = BlockingRecorder(ring, reader.alive)
    for stamp in range(4):
        recorder.record(Kind.STATE, stamp, b"x")
    with pytest.raises(Hoap3Error):
        recorder.record(Kind.STATE, 5, payload)
    assert reader.asked == dies_after + 1
