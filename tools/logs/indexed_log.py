"""A log by time: any moment of it within milliseconds, in memory that does not grow with it.

Where the chunks of a file begin and end is read, and nothing more, until one is asked for. So a
damaged chunk is found when it is; `Log` finds all at once.
"""

from __future__ import annotations

from bisect import bisect_right
from collections import OrderedDict
from pathlib import Path
from typing import NamedTuple, TypeVar

from hoap3.protocol.errors import LogError, WireError
from hoap3.protocol.messages import Setpoint, State
from hoap3.protocol.runtime.shm_ring import Kind, Record
from hoap3.tools.logs.log import Enclosed, check_ours, files_of, merge_attachments
from hoap3.tools.logs.log_format import unpack_message
from hoap3.tools.logs.mcap_scan import McapScan

KEPT = 4  # unpacked chunks, of some 1 MiB each
Loaded = TypeVar("Loaded", State, Setpoint)


class Moment(NamedTuple):
    """A State of a log, its answer, and the log times of both [ns]; None where there is none."""

    state: State
    stamp: int
    setpoint: Setpoint | None
    answered: int | None


class IndexedLog(Enclosed):
    """One side of a run.

    Args:
        path: a file, or the folder of a run.
        side: "robot" or "controller"; None for whatever there is, if it is one only.

    Attributes:
        side: whose log it is.
        begin, end: log times of the oldest and of the newest message [ns].
        chunks: how many there are.
        unread: what could not be read so far: (chunk, place in it), None for all of a chunk.

    Raises:
        LogError: nothing there, not ours, or without any message.
    """

    def __init__(self, path: Path, side: str | None = None) -> None:
        self._scans = [McapScan.indexed(file) for file in files_of(path, side)]
        for scan in self._scans:
            check_ours(scan)
        first = self._scans[0].metadata["log"]
        self.side, self.paths = first["side"], [scan.path for scan in self._scans]
        self.attachments = merge_attachments(self._scans)
        self._places = [
            (scan, place, span) for scan in self._scans for place, span in enumerate(scan.spans)
        ]
        if not self._places:
            raise LogError(f"{path}: holds no message. Name a log of `hoap3`")
        self.begin = min(span[0] for _, _, span in self._places)
        self.end = max(span[1] for _, _, span in self._places)
        newest, self._firsts = 0, list[int]()
        for _, _, (start, _) in self._places:  # rising, whatever a file claims
            newest = max(newest, start)
            self._firsts.append(newest)
        self.chunks, self.unread = len(self._places), set[tuple[int, int | None]]()
        self._kept: OrderedDict[int, list[Record]] = OrderedDict()

    def records(self, chunk: int, *, keep: bool = True) -> list[Record]:
        """The records of one chunk in their order; those of a damaged one are lost.

        Args:
            chunk: its place, from 0.
            keep: whether it may be asked for again soon.
        """
        found = self._kept.get(chunk)
        if found is None:
            found = self._read(chunk)
            if keep:
                self._kept[chunk] = found
                if len(self._kept) > KEPT:
                    self._kept.popitem(last=False)
        elif keep:
            self._kept.move_to_end(chunk)
        return found

    def chunk_at(self, stamp: int) -> int:
        """Place of the last chunk that begins at a log time [ns], or before it."""
        return max(bisect_right(self._firsts, stamp) - 1, 0)

    def state_at(self, stamp: int) -> Moment | None:
        """The last State up to a log time [ns], and the Setpoint that answers it.

        Returns:
            None where there is no State up to then.
        """
        for chunk in range(self.chunk_at(stamp), -1, -1):
            for record in reversed(self.records(chunk)):
                if record.kind == Kind.STATE and record.stamp <= stamp:
                    state = _loaded(State, record.payload)
                    if state is not None:
                        return Moment(state, record.stamp, *self._answer(state, chunk))
        return None

    def _answer(self, state: State, chunk: int) -> tuple[Setpoint | None, int | None]:
        for place in (chunk, chunk + 1):
            if place >= self.chunks:
                break
            for record in self.records(place):
                if record.kind != Kind.SETPOINT:
                    continue
                try:
                    tick, session = Setpoint.scalars(record.payload, "tick", "session_id")
                except WireError:
                    continue
                if (tick, session) == (state.tick, state.session_id):
                    return _loaded(Setpoint, record.payload), record.stamp
        return None, None

    def _read(self, chunk: int) -> list[Record]:
        scan, place, _ = self._places[chunk]
        try:
            messages = scan.chunk(place)
        except (LogError, OSError):  # also a file that went, as of a log that rotates
            self.unread.add((chunk, None))
            return []
        found = []
        for number, (channel, _, stamp, _, payload) in enumerate(messages):
            try:
                record, _ = unpack_message(channel, stamp, payload)
            except ValueError:
                self.unread.add((chunk, number))  # of a version that is not known
                continue
            if record is not None:
                found.append(record)
        return found


def _loaded(kind: type[Loaded], payload: bytes) -> Loaded | None:
    try:
        message = kind.like(payload)
        message.load(payload)
    except WireError:
        return None
    return message
