"""Tables of a log that are longer than memory: rows on disk, and some rows of a table."""

from __future__ import annotations

import ctypes
import errno
import math
import mmap
import os
import tempfile
from array import array
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import suppress
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from hoap3.protocol.errors import LogError, WireError
from hoap3.protocol.messages import Schema
from hoap3.protocol.runtime.shm_ring import Kind, Record
from hoap3.tools.logs.log_format import Layout

Table = npt.NDArray[Any]
Places = npt.NDArray[np.int64]
LogMessage = tuple[int, int, int, int, bytes]
"""Channel, sequence, log time [ns], publish time [ns], data."""

_KINDS = {int(kind): kind for kind in Kind}

PART = 20_000
"""Rows that are processed together, where what is computed of each takes much memory."""
MAX_PADDED = 8  # times the bytes of all messages, for a table with those of several layouts
SLACK_BYTES = 1 << 26  # beyond that
_M_MMAP_THRESHOLD = -3  # of <malloc.h>


def parts(count: int) -> Iterator[slice]:
    """Of so many rows, `PART` at a time."""
    return (slice(begin, begin + PART) for begin in range(0, count, PART))


def return_large_arrays() -> None:
    """Have the C library return memory of 1 MB or more to the system as soon as it is freed.

    By default glibc keeps arrays of up to 32 MB for later ones, which for columns of a long log
    adds up to more than those in use.
    """
    with suppress(AttributeError):  # another C library
        ctypes.CDLL(None).mallopt(_M_MMAP_THRESHOLD, 1 << 20)


def disk_array(shape: tuple[int, ...]) -> npt.NDArray[np.float64]:
    """Zeros in a temporary file, whose pages the kernel writes out where memory is short.

    Raises:
        LogError: there is no room for it.
    """
    if not math.prod(shape):
        return np.zeros(shape)
    try:
        with tempfile.TemporaryFile(prefix="hoap3-") as file:
            _reserve(file.fileno(), 8 * math.prod(shape))
            return np.asarray(np.memmap(file, np.float64, "r+", shape=shape))
    except OSError as error:
        raise _no_room(error) from error


def _reserve(file: int, size: int) -> None:
    """Give a file its size, and its room where the file system can."""
    try:
        os.posix_fallocate(file, 0, size)
    except OSError as error:
        if error.errno not in {errno.EOPNOTSUPP, errno.EINVAL}:
            raise
        os.truncate(file, size)


class DiskRows:
    """Messages, one behind the other, in a temporary file that nobody else sees.

    A table of them is mapped, not read: the kernel takes its pages back where memory is short. The
    file is gone with the last of its tables.

    Raises:
        LogError: there is no room for a temporary file.
    """

    def __init__(self) -> None:
        try:
            self._file = tempfile.TemporaryFile(prefix="hoap3-")  # noqa: SIM115 (see __del__)
        except OSError as error:
            raise _no_room(error) from error
        self._sizes = array("I")

    def __del__(self) -> None:
        file = getattr(self, "_file", None)  # not where there was no room
        if file is not None:
            with suppress(OSError):  # that there was no room, `add` has told
                file.close()

    def __len__(self) -> int:
        return len(self._sizes)

    def add(self, message: bytes) -> None:
        """Put one behind the others.

        Raises:
            LogError: there is no room for it.
        """
        try:
            self._file.write(message)
        except OSError as error:
            raise _no_room(error) from error
        self._sizes.append(len(message))
        for derived in ("raw", "_ends"):  # of the rows so far
            self.__dict__.pop(derived, None)

    def flush(self) -> None:
        """Write what is buffered, so that a process that is forked cannot write it again.

        Raises:
            LogError: there is no room for it.
        """
        try:
            self._file.flush()
        except OSError as error:
            raise _no_room(error) from error

    @property
    def sizes(self) -> Places:
        """Bytes of each, (N,)."""
        return np.array(self._sizes, np.int64)

    @cached_property
    def raw(self) -> Table:
        """All of them, (bytes,) of uint8; it cannot be written to."""
        if not self.sizes.any():
            return np.frombuffer(b"", np.uint8)
        try:
            self.flush()
            length = int(self.sizes.sum())
            mapped = mmap.mmap(self._file.fileno(), length, access=mmap.ACCESS_READ)
        except OSError as error:
            raise _no_room(error) from error
        return np.frombuffer(mapped, np.uint8)

    @cached_property
    def _ends(self) -> Places:
        return np.cumsum(self.sizes)

    def some(self, places: Places) -> Iterator[bytes]:
        """Messages by their places."""
        every_end, sizes, raw = self._ends, self.sizes, self.raw.data
        for part in parts(len(places)):
            ends = every_end[places[part]]
            begins = ends - sizes[places[part]]
            for begin, end in zip(begins.tolist(), ends.tolist(), strict=True):
                yield bytes(raw[begin:end])

    def table(self, dtype: np.dtype[Any]) -> Table:
        """All of them as a structured array, (N,); it cannot be written to.

        Raises:
            ValueError: one is longer or shorter than that.
        """
        if (self.sizes != dtype.itemsize).any():
            raise ValueError(f"a message is not of the {dtype.itemsize} bytes of those before it")
        return self.raw.view(dtype)


class MessageTable:
    """Messages of one kind, whose arrays may differ in length, as one structured array on disk.

    Args:
        schema: of the messages.

    Attributes:
        unreadable: messages that do not have this schema; they are left out.
    """

    def __init__(self, schema: Schema) -> None:
        self._schema, self._rows = schema, DiskRows()
        self._stamps, self._layout_of = array("q"), array("I")
        self._layouts: dict[tuple[int, ...], int] = {}
        self._last = Layout(schema)
        self.unreadable = 0

    def __len__(self) -> int:
        return len(self._stamps)

    def flush(self) -> None:
        """As `DiskRows.flush`."""
        self._rows.flush()

    def add(self, stamp: int, payload: bytes) -> bool:
        """Append a message with its log time [ns]; False for one without the schema.

        Raises:
            LogError: there is no room for it.
        """
        if self._last.fits(payload):
            layout = self._layout_of[-1]
        else:
            try:
                lengths = self._last.learn(payload)
            except WireError:
                self.unreadable += 1
                return False
            layout = self._layouts.setdefault(tuple(lengths.values()), len(self._layouts))
        self._layout_of.append(layout)
        self._stamps.append(stamp)
        self._rows.add(payload)
        return True

    def some(self, places: Places) -> Iterator[tuple[int, bytes]]:
        """Log times [ns] and bytes of messages by their places."""
        stamps = np.array(self._stamps, np.int64)[places].tolist()
        return zip(stamps, self._rows.some(places), strict=True)

    @cached_property
    def rows(self) -> tuple[Places, Table]:
        """Log times [ns] and messages; NaN fills arrays that are shorter than the longest.

        Raises:
            LogError: there is no room for them.
        """
        layouts, kept = self._used
        dtype, which = self._union(layouts), np.array(self._layout_of, np.int64)
        self.unreadable += len(which) - len(kept)
        rows = self._padded(which, layouts, dtype) if len(self._layouts) > 1 else self._rows
        return np.array(self._stamps, np.int64)[kept], rows.table(dtype)

    @cached_property
    def _used(self) -> tuple[dict[int, np.dtype[Any]], Places]:
        """Layouts that `rows` has, by number, and the places of messages with one of these."""
        layouts = {number: self._dtype(lengths) for lengths, number in self._layouts.items()}
        limit = MAX_PADDED * len(self._rows.raw) + SLACK_BYTES
        while len(self._rows) * self._union(layouts).itemsize > limit and len(layouts) > 1:
            del layouts[max(layouts, key=lambda number: layouts[number].itemsize)]
        return layouts, np.flatnonzero(np.isin(np.array(self._layout_of), list(layouts)))

    def messages(self, rows: Places) -> Iterator[bytes]:
        """Messages as they were added, by their numbers in `rows`."""
        return self._rows.some(self._used[1][rows])

    def _dtype(self, lengths: Iterable[int]) -> np.dtype[Any]:
        return self._schema.dtype(dict(zip(self._schema.arrays, lengths, strict=True)))

    def _union(self, layouts: dict[int, np.dtype[Any]]) -> np.dtype[Any]:
        """The layout with the longest of each array."""
        used = [lengths for lengths, number in self._layouts.items() if number in layouts]
        none = (0,) * len(self._schema.arrays)
        return self._dtype(map(max, zip(none, *used, strict=True)))

    def _padded(
        self, which: Places, layouts: dict[int, np.dtype[Any]], dtype: np.dtype[Any]
    ) -> DiskRows:
        """The messages that have one of these layouts, each as long as `dtype`."""
        sizes, raw, found = self._rows.sizes, self._rows.raw, DiskRows()
        begins = np.cumsum(sizes) - sizes
        for part in parts(len(begins)):
            block = np.zeros(len(begins[part]), dtype)
            for number, given in layouts.items():
                alike = which[part] == number
                windows = np.lib.stride_tricks.sliding_window_view(raw, given.itemsize)
                rows = windows[begins[part][alike]].view(given)[:, 0]
                for name in given.names or ():
                    if given[name].shape:
                        values = np.full((len(rows), *dtype[name].shape), np.nan)
                        values[:, : given[name].shape[0]] = rows[name]
                        block[name][alike] = values
                    else:
                        block[name][alike] = rows[name]
            for row in block[np.isin(which[part], list(layouts))]:
                found.add(row.tobytes())
        return found


class DiskRecords:
    """Records of a log, unpacked once, in temporary files.

    Args:
        records: in the order in which they were processed.
        schemas: of the kinds that are gathered in tables.

    Attributes:
        tables: of the messages of these kinds.
    """

    def __init__(self, records: Iterable[Record], schemas: Mapping[Kind, Schema]) -> None:
        return_large_arrays()
        self.tables = {kind: MessageTable(schema) for kind, schema in schemas.items()}
        self._others, stamps = DiskRows(), array("q")
        kinds, places = array("B"), array("q")  # a place below 0 is ~place in the others
        for record in records:
            kind, stamp, payload = record
            table = self.tables.get(kind)
            if table is not None and table.add(stamp, payload):
                places.append(len(table) - 1)
            else:
                self._others.add(payload)
                stamps.append(stamp)
                places.append(-len(stamps))
            kinds.append(kind)
        self._kinds, self._places = np.frombuffer(kinds, np.uint8), np.frombuffer(places, np.int64)
        self._stamps = np.frombuffer(stamps, np.int64)
        self._others.flush()
        for table in self.tables.values():
            table.flush()

    def read(self, kinds: Collection[Kind] = ()) -> Iterator[Record]:
        """The records, or those of some kinds, in their order."""
        wanted = np.isin(self._kinds, list(kinds)) if kinds else np.ones(len(self._kinds), bool)
        of_kind, places = self._kinds[wanted], self._places[wanted]
        for part in parts(len(places)):
            here, which = places[part], of_kind[part]
            sources = {
                kind: table.some(here[(which == kind) & (here >= 0)])
                for kind, table in self.tables.items()
            }
            others = ~here[here < 0]
            rest = zip(self._stamps[others].tolist(), self._others.some(others), strict=True)
            for number, place in zip(which.tolist(), here.tolist(), strict=True):
                kind = _KINDS[number]
                yield Record(kind, *next(rest if place < 0 else sources[kind]))


class SortedRows:
    """Messages of a file in the order of their log times, in a temporary file.

    Args:
        messages: in the order of the file.
        rank: of a message among those with its log time.
    """

    def __init__(self, messages: Iterator[LogMessage], rank: Callable[[int, bytes], int]) -> None:
        rows, heads, ranks = DiskRows(), array("q"), array("q")
        for *head, data in messages:
            heads.extend(head)
            ranks.append(rank(head[0], data))
            rows.add(data)
        self._heads = np.array(heads, np.int64).reshape(-1, 4)
        self._ends, self._sizes, self._raw = np.cumsum(rows.sizes), rows.sizes, rows.raw
        self._order = np.lexsort((np.array(ranks), self._heads[:, 2]))
        self._rows = rows

    @property
    def spans(self) -> list[tuple[int, int]]:
        """First and last log time of each part [ns]."""
        stamps = self._heads[self._order, 2]
        return [(int(stamps[p][0]), int(stamps[p][-1])) for p in parts(len(stamps))]

    def parts(self) -> list[Iterator[LogMessage]]:
        """The messages, some of them at a time."""
        return [self._part(part) for part in parts(len(self._order))]

    def _part(self, part: slice) -> Iterator[LogMessage]:
        for place in self._order[part].tolist():
            channel, sequence, log, publish = self._heads[place].tolist()
            end = self._ends[place]
            data = self._raw[end - self._sizes[place] : end].tobytes()
            yield channel, sequence, log, publish, data


class RowsAt:
    """Some rows of a table. A field is copied when it is asked for, a whole row never.

    Args:
        table: a structured array.
        places: of the rows in it, (N,).
    """

    def __init__(self, table: Table, places: Places) -> None:
        self._table, self._places = table, places

    @classmethod
    def of(cls, table: Table | RowsAt) -> RowsAt:
        """All rows of a table."""
        return table if isinstance(table, RowsAt) else cls(table, np.arange(len(table)))

    @property
    def dtype(self) -> np.dtype[Any]:
        """Of a row."""
        return self._table.dtype

    def finite(self, *names: str) -> npt.NDArray[np.bool_]:
        """Which rows have only finite numbers in these fields, (N,)."""
        found = np.ones(len(self), bool)
        for name in names:
            found &= np.isfinite(self[name]).all(1)
        return found

    def __len__(self) -> int:
        return len(self._places)

    def __getitem__(self, key: Any) -> Any:
        """A field by its name, a row by its number, other rows by a slice, places or a mask."""
        if isinstance(key, str):
            return self._table[key][self._places]
        places = self._places[key]
        return RowsAt(self._table, places) if places.ndim else self._table[places]

    def __iter__(self) -> Iterator[Any]:
        return (self._table[place] for place in self._places)


def _no_room(error: OSError) -> LogError:
    return LogError(
        f"{tempfile.gettempdir()}: {error.strerror}; the rows of a log are kept there while it is "
        "read. Set TMPDIR to a folder with more room"
    )
