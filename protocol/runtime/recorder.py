"""Where a loop puts what it did: a ring to the observer process, a list, or nowhere."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, Protocol

from hoap3.protocol.errors import Hoap3Error
from hoap3.protocol.runtime.shm_ring import Kind, Record, Ring


class Recorder(Protocol):
    """What loops call. It may not block a loop in real time."""

    @property
    def lost(self) -> int | None:
        """None while everything is kept; then errno of what ended that, 0 where none is known."""
        return None

    def record(self, kind: Kind, stamp: int, payload: bytes) -> None:
        """Keep a message with the monotonic stamp [ns] that belongs to it."""

    def reject(self, kind: int) -> None:
        """Count a setpoint that was refused; for which reason, by its place in their list."""
        del kind  # nobody asks


class NoRecorder(Recorder):
    """Keeps nothing."""

    def record(self, kind: Kind, stamp: int, payload: bytes) -> None:
        """Forget it."""


class MemoryRecorder(Recorder):
    """Keeps everything in a list: for simulations in process, and tests."""

    def __init__(self) -> None:
        # flat, since the garbage collector would visit each of many tuples, again and again
        self._kept: list[Any] = []  # kind, stamp, payload, kind, …

    @property
    def records(self) -> list[Record]:
        """All of it, oldest first."""
        return list(map(Record, self._kept[::3], self._kept[1::3], self._kept[2::3]))

    def payloads(self, kind: Kind) -> list[bytes]:
        """Those of one kind, oldest first."""
        return [self._kept[at + 2] for at in range(0, len(self._kept), 3) if self._kept[at] == kind]

    def record(self, kind: Kind, stamp: int, payload: bytes) -> None:
        """Append it."""
        self._kept += (kind, stamp, payload)


class RingRecorder(Recorder):
    """Hands everything to the observer process and never waits for it."""

    def __init__(self, ring: Ring) -> None:
        self._ring = ring

    @property
    def lost(self) -> int | None:
        """Set by whoever hears of it from the observer; from any thread."""
        return self._ring.lost

    def record(self, kind: Kind, stamp: int, payload: bytes) -> None:
        """Write slots; a full ring counts a drop."""
        self._ring.write(kind, stamp, payload)

    def reject(self, kind: int) -> None:
        """Count it in shared memory."""
        self._ring.count(kind)


class BlockingRecorder(Recorder):
    """Hands everything to the observer and waits while the ring is full: for lockstep.

    Args:
        ring: shared with the observer.
        reader_alive: asked now and then while waiting.

    Raises:
        Hoap3Error: the observer has died, so nothing would ever be read.
    """

    # `lost` stays None: in virtual time an event would come at another tick each time

    def __init__(self, ring: Ring, reader_alive: Callable[[], bool]) -> None:
        self._ring, self._reader_alive = ring, reader_alive

    def record(self, kind: Kind, stamp: int, payload: bytes) -> None:
        """Write slots, when there are enough."""
        slots = min(self._ring.slots_for(len(payload)), self._ring.usable(kind))
        if self._ring.room(kind) < slots:
            self._wait(kind, slots)
        self._ring.write(kind, stamp, payload)

    def reject(self, kind: int) -> None:
        """Count it in shared memory."""
        self._ring.count(kind)

    def _wait(self, kind: Kind, slots: int) -> None:
        while self._ring.room(kind) < slots:
            if not self._reader_alive():
                raise Hoap3Error("the recorder has died: the log of this run is not whole")
            time.sleep(0.001)
