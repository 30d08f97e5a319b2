"""The ring against a plain list, inside one process."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hoap3.protocol.errors import Hoap3Error
from hoap3.protocol.messages import Event, Setpoint, State, Target
from hoap3.protocol.runtime.shm_ring import Kind, Record, Ring
from hoap3.robot_emulator.setpoint_validator import MAX_LENGTHS

SLOTS, SLOT_BYTES = 5, 64
CAPACITY = SLOT_BYTES - 32  # bytes of payload that a slot holds


@pytest.fixture
def pair() -> Iterator[tuple[Ring, Ring]]:
    """A writer and a reader of the same small ring."""
    writer = Ring(slots=SLOTS, slot_bytes=SLOT_BYTES)
    yield writer, Ring(writer.fd)
    os.close(writer.fd)


class Model:
    """What a ring should do, with a list and no memory to share."""

    def __init__(self, slots: int) -> None:
        self.slots = slots
        self.waiting: list[tuple[Record, int]] = []  # with the slots that each takes
        self.dropped = self.noticed = 0

    @property
    def free(self) -> int:
        return self.slots - sum(slots for _, slots in self.waiting)

    def write(self, kind: Kind, stamp: int, payload: bytes, slots: int) -> bool:
        reserved = self.slots // 16 if kind in {Kind.STATE, Kind.SETPOINT, Kind.TARGET} else 0
        if slots > self.free - reserved:
            self.dropped += 1
            return False
        if self.dropped != self.noticed:
            gap = json.dumps({"dropped": self.dropped - self.noticed}).encode()
            self.waiting.append((Record(Kind.GAP, stamp, gap), 0))
            self.noticed = self.dropped
        self.waiting.append((Record(kind, stamp, payload), slots))
        return True

    def read(self, records: int | None) -> list[Record]:
        taken, self.waiting = self.waiting[:records], self.waiting[len(self.waiting[:records]) :]
        return [record for record, _ in taken]


KINDS = st.sampled_from([Kind.STATE, Kind.TARGET, Kind.EVENT])
WRITES = st.tuples(KINDS, st.binary(max_size=CAPACITY + 2))
LARGE_WRITES = st.tuples(KINDS, st.binary(max_size=CAPACITY * (SLOTS + 1)))
READS = st.tuples(st.none(), st.sampled_from([None, None, 1, 2]))


@given(
    actions=st.lists(st.one_of(WRITES, LARGE_WRITES, READS), max_size=60),
    slots=st.sampled_from([SLOTS, 33]),  # without and with a reserve
)
def test_any_interleaving_of_writes_and_reads_does_what_a_list_does(actions, slots):
    writer = Ring(slots=slots, slot_bytes=SLOT_BYTES)
    reader, model = Ring(writer.fd), Model(slots)
    try:
        for stamp, (kind, argument) in enumerate(actions):
            if kind is None:
                source = reader.read()
                found = list(source) if argument is None else [*_first(source, argument)]
                assert found == model.read(argument)
            else:
                needed = -(-max(len(argument), 1) // CAPACITY)
                done = writer.write(kind, stamp, argument)
                assert done == model.write(kind, stamp, argument, needed)
            assert writer.free == model.free
            assert writer.dropped == reader.dropped == model.dropped
        assert list(reader.read()) == model.read(None)
    finally:
        os.close(writer.fd)


def _first(source: Iterator[Record], count: int) -> Iterator[Record]:
    for _, record in zip(range(count), source, strict=False):
        yield record


def test_a_record_comes_out_as_it_went_in(pair):
    writer, reader = pair
    for kind in Kind:
        assert writer.write(kind, -(2**63), b"payload of " + kind.name.encode())
        assert list(reader.read()) == [Record(kind, -(2**63), b"payload of " + kind.name.encode())]


def test_it_works_the_same_after_many_rounds(pair):
    writer, reader = pair
    for number in range(10 * SLOTS + 3):
        assert writer.write(Kind.STATE, number, bytes([number]))
        assert [record.payload for record in reader.read()] == [bytes([number])]
    assert writer.dropped == 0


def test_a_full_ring_drops_and_the_gap_stands_where_records_are_missing(pair):
    writer, reader = pair
    written = [writer.write(Kind.STATE, number, b"%d" % number) for number in range(SLOTS + 3)]
    assert written == [True] * SLOTS + [False] * 3
    assert writer.free == 0
    assert [record.payload for record in reader.read()] == [b"%d" % n for n in range(SLOTS)]
    writer.write(Kind.STATE, 100, b"after")
    gap, after = reader.read()
    assert (gap.kind, gap.stamp, json.loads(gap.payload)) == (Kind.GAP, 100, {"dropped": 3})
    assert after.payload == b"after"
    assert writer.dropped == 3


def test_a_full_ring_has_room_for_events_that_no_state_takes():
    ring = Ring(slots=32, slot_bytes=SLOT_BYTES)
    assert [ring.write(Kind.STATE, n, b"") for n in range(31)] == [True] * 30 + [False]
    assert [ring.write(Kind.EVENT, n, b"") for n in range(3)] == [True, True, False]
    os.close(ring.fd)


def test_a_large_record_wraps_around_the_end_and_is_all_or_nothing(pair):
    writer, reader = pair
    large = bytes(range(3 * CAPACITY - 5))
    for _ in range(SLOTS - 1):
        writer.write(Kind.EVENT, 0, b"")
    list(reader.read())
    assert writer.write(Kind.DESCRIPTION, 7, large)  # slots 4, 0 and 1
    assert not writer.write(Kind.DESCRIPTION, 8, large)
    assert list(reader.read()) == [Record(Kind.DESCRIPTION, 7, large)]
    assert not writer.write(Kind.DESCRIPTION, 9, bytes(SLOTS * CAPACITY + 1))
    assert writer.write(Kind.DESCRIPTION, 10, bytes(SLOTS * CAPACITY))
    assert [record.kind for record in reader.read()] == [Kind.GAP, Kind.DESCRIPTION]


def test_half_a_large_record_is_not_read(pair, monkeypatch):
    writer, reader = pair
    seen: list[list[Record]] = []
    put = Ring._put

    def reading_in_between(ring, *args, **kwargs):
        seen.append(list(reader.read()))
        return put(ring, *args, **kwargs)

    writer.write(Kind.EVENT, 1, b"before")
    monkeypatch.setattr(Ring, "_put", reading_in_between)
    writer.write(Kind.SESSION, 2, bytes(3 * CAPACITY))
    assert [[record.payload for record in step] for step in seen] == [[b"before"], [], []]
    assert list(reader.read()) == [Record(Kind.SESSION, 2, bytes(3 * CAPACITY))]


def test_a_slot_that_is_not_visible_yet_is_left_for_the_next_time(pair):
    writer, reader = pair
    writer.write(Kind.EVENT, 1, b"first")
    writer._set("head", 2)  # as seen by a CPU that gets the stores in another order
    assert [record.payload for record in reader.read()] == [b"first"]
    writer.write(Kind.EVENT, 2, b"second")
    assert [record.payload for record in reader.read()] == [b"second"]


def test_who_attaches_later_goes_on_where_the_last_reader_stopped(pair):
    writer, reader = pair
    for number in range(4):
        writer.write(Kind.EVENT, number, b"")
    next(reader.read())
    assert [record.stamp for record in Ring(writer.fd).read()] == [1, 2, 3]


def test_who_attaches_after_drops_is_told_of_them_once_and_in_their_place(pair):
    writer, _ = pair
    for number in range(SLOTS + 2):
        writer.write(Kind.EVENT, number, b"")
    late = Ring(writer.fd)
    assert [record.kind for record in late.read()] == [Kind.EVENT] * SLOTS
    writer.write(Kind.EVENT, 10, b"")
    gap = next(late.read())
    assert (gap.kind, json.loads(gap.payload)) == (Kind.GAP, {"dropped": 2})
    assert [record.kind for record in Ring(writer.fd).read()] == [Kind.EVENT]


def test_drops_beyond_32_bits_are_counted(pair):
    writer, reader = pair
    writer._dropped = 2**32 - 1
    for number in range(SLOTS + 2):
        writer.write(Kind.EVENT, number, b"")
    list(reader.read())
    assert writer.write(Kind.EVENT, 99, b"")
    assert writer.dropped == 2**32 + 1
    gap, _ = reader.read()
    assert json.loads(gap.payload) == {"dropped": 2}


def test_closing_is_seen_and_what_was_written_can_still_be_read(pair):
    writer, reader = pair
    writer.write(Kind.SUMMARY, 1, b"{}")
    assert not reader.closed
    writer.close()
    assert reader.closed
    assert [record.kind for record in reader.read()] == [Kind.SUMMARY]


def test_memory_that_is_not_a_ring_is_refused():
    fd = os.memfd_create("something else")
    try:
        os.ftruncate(fd, 8192)
        with pytest.raises(Hoap3Error):
            Ring(fd)
    finally:
        os.close(fd)


def test_the_largest_messages_pass_through_a_ring_of_the_usual_slots():
    state = State(128, 192, reference_rate=128, reference_acceleration=128, contact=384, imu=160)
    setpoint = Setpoint(128, **MAX_LENGTHS)
    ring = Ring(slots=8)
    try:
        for message in (state, setpoint, Event(), Target(1, 1024, rates=1024)):
            assert ring.write(Kind.STATE, 0, message.dump())
            assert [record.payload for record in ring.read()] == [message.dump()]
    finally:
        os.close(ring.fd)
