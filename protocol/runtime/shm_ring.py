"""A ring of fixed slots in shared memory: one loop writes, its observer process reads.

Writing is a copy and a few stores: no lock, no system call, no allocation that grows. Where the
observer falls behind or has died, records are dropped and counted, and the loop does not notice.
A sixteenth of the slots is reserved for all records but States, setpoints and targets: an observer
that lags loses some of these, of which there are thousands, before it loses an event.
The memory has no name in the file system, so nothing is left behind by a process that is killed.
"""

from __future__ import annotations

import mmap
import os
import struct
from collections.abc import Iterator
from enum import IntEnum
from typing import NamedTuple

from hoap3.protocol.errors import Hoap3Error

SLOTS = 4096
SLOT_BYTES = 6144  # holds what most robots send; what is larger takes several slots
_MAGIC = 0x484F41503352494E
_HEADER_BYTES = 4096
_WORDS = {  # eight to a cache line
    "magic": 0,
    "slots": 1,
    "slot_bytes": 2,
    "head": 8,  # the writer's
    "beats": 9,  # the writer's: how often its loop has said that it is alive
    "tail": 16,  # the reader's
    "noticed": 17,  # the reader's: drops that it has told of
    "dropped": 24,  # the writer's
    "end": 32,
    "counts": 40,  # the writer's: `COUNTS` of them
}
COUNTS = 64  # of what has no records
_SLOT = struct.Struct("=qqqIHH")  # sequence, stamp, dropped before, length, kind, more


class Kind(IntEnum):
    """What a record holds."""

    STATE = 1
    SETPOINT = 2
    EVENT = 3
    DESCRIPTION = 4  # RobotDescription as JSON
    SESSION = 5  # JSON: what the following records belong to
    AUTHORITY = 6  # JSON: epoch under which the controller answers from now on
    SUMMARY = 7  # JSON: what the robot counted, or the controller, at its end
    GAP = 8  # JSON: how many records were dropped here, since the observer fell behind
    CHANGE = 9  # JSON: what somebody changed in the controller while it ran
    RESET = 10  # JSON: what the controller remembers where it begins anew
    REQUEST = 11  # JSON: what somebody asked, and the answer
    TOKEN = 12  # JSON: a liveliness token came or went
    CONFIG = 13  # JSON: the other side's configuration
    TARGET = 14


_KINDS = {int(kind): kind for kind in Kind}
_FREQUENT = frozenset({Kind.STATE, Kind.SETPOINT, Kind.TARGET})  # as often as every tick


class Record(NamedTuple):
    """One record: what, when (monotonic ns of the writer), and its bytes."""

    kind: Kind
    stamp: int
    payload: bytes


class Ring:
    """Single producer, single consumer.

    Args:
        fd: shared memory to attach to, or None to create it.
        slots, slot_bytes: size where it is created.

    Attributes:
        slots: how many it has.
        lost: in the writer's process, errno for which nobody keeps what is written any more, 0
            where none is known; None while somebody does.
    """

    lost: int | None = None

    def __init__(self, fd: int | None = None, slots: int = SLOTS, slot_bytes: int = SLOT_BYTES):
        created = fd is None
        if fd is None:
            fd = os.memfd_create("hoap3-ring", os.MFD_CLOEXEC)
            os.ftruncate(fd, _HEADER_BYTES + slots * slot_bytes)
        self.fd = fd
        self._memory = mmap.mmap(fd, os.fstat(fd).st_size)
        self._words = memoryview(self._memory)[:_HEADER_BYTES].cast("q")
        if created:
            self._memory[:] = bytes(len(self._memory))  # every page is there before the loop
            self._set("slots", slots)
            self._set("slot_bytes", slot_bytes)
            self._set("magic", _MAGIC)
        elif self._get("magic") != _MAGIC:
            raise Hoap3Error(f"file descriptor {fd} is not a ring of ours")
        self.slots, self._slot_bytes = self._get("slots"), self._get("slot_bytes")
        self._capacity = self._slot_bytes - _SLOT.size
        self._reserved = self.slots // 16
        self._head, self._tail = self._get("head"), self._get("tail")
        self._dropped, self._gaps = self._get("dropped"), self._get("noticed")
        self._beats = self._get("beats")

    def write(self, kind: Kind, stamp: int, payload: bytes) -> bool:
        """Append a record, in as many slots as it needs: all of it, or False and nothing."""
        if self.slots_for(len(payload)) > self.room(kind):
            self._dropped += 1
            self._set("dropped", self._dropped)
            return False
        if len(payload) <= self._capacity:
            self._put(kind, stamp, payload, more=0)
            return True
        for at in range(0, len(payload), self._capacity):
            piece = payload[at : at + self._capacity]
            self._put(kind, stamp, piece, more=int(at + self._capacity < len(payload)))
        return True

    def slots_for(self, size: int) -> int:
        """How many slots a record of so many bytes takes."""
        return max(1, -(-size // self._capacity))

    def read(self) -> Iterator[Record]:
        """Every record written since the last call, oldest first; a GAP where some were lost."""
        parts: list[bytes] = []
        tail = self._tail
        while tail < self._get("head"):
            at = _HEADER_BYTES + tail % self.slots * self._slot_bytes
            sequence, stamp, dropped, length, kind, more = _SLOT.unpack_from(self._memory, at)
            if sequence != tail + 1:  # not visible to this CPU yet
                return
            if dropped != self._gaps:
                lost, self._gaps = dropped - self._gaps, dropped
                self._set("noticed", dropped)
                yield Record(Kind.GAP, stamp, b'{"dropped": %d}' % lost)
            at += _SLOT.size
            parts.append(self._memory[at : at + length])
            tail += 1
            if not more:
                record = Record(_KINDS[kind], stamp, b"".join(parts))
                parts.clear()
                self._tail = tail
                self._set("tail", tail)
                yield record

    def beat(self) -> None:
        """A sign of life of the writer's loop."""
        self._beats += 1
        self._set("beats", self._beats)

    @property
    def beats(self) -> int:
        """How many signs of life the writer's loop has given; either side may ask."""
        return self._get("beats")

    def count(self, place: int) -> None:
        """One more of what stands at a place below `COUNTS`."""
        self._words[_WORDS["counts"] + place] += 1

    def counts(self, n: int) -> list[int]:
        """What was counted at the first n places."""
        first = _WORDS["counts"]
        return self._words[first : first + n].tolist()

    def close(self) -> None:
        """Say that nothing more will be written."""
        self._set("end", 1)

    @property
    def closed(self) -> bool:
        """True once the producer has closed the ring; what is in it can still be read."""
        return self._get("end") == 1

    @property
    def dropped(self) -> int:
        """Records dropped since the start."""
        return self._get("dropped")

    def room(self, kind: Kind) -> int:
        """Slots that records of a kind can take before they are dropped; 0 or less: none."""
        return self.usable(kind) - self.slots + self.free

    def usable(self, kind: Kind) -> int:
        """How many of the slots records of a kind may take."""
        return self.slots - self._reserved if kind in _FREQUENT else self.slots

    @property
    def free(self) -> int:
        """Slots that hold nothing."""
        return self.slots - (self._head - self._get("tail"))

    def _put(self, kind: Kind, stamp: int, payload: bytes, more: int) -> None:
        head, length = self._head, len(payload)
        at = _HEADER_BYTES + head % self.slots * self._slot_bytes
        _SLOT.pack_into(self._memory, at, head + 1, stamp, self._dropped, length, kind, more)
        at += _SLOT.size
        self._memory[at : at + length] = payload
        self._head = head + 1
        self._set("head", head + 1)

    def _get(self, word: str) -> int:
        return self._words[_WORDS[word]]

    def _set(self, word: str, value: int) -> None:
        self._words[_WORDS[word]] = value  # one aligned 64-bit store
