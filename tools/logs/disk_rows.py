"""Tables of a log that are longer than memory: rows on disk, and some rows of a table."""

from __future__ import annotations

import mmap
import tempfile
from array import array
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import Any

import numpy as np
import numpy.typing as npt

from hoap3.protocol.errors import LogError

Table = npt.NDArray[Any]
Places = npt.NDArray[np.int64]
LogMessage = tuple[int, int, int, int, bytes]
"""Channel, sequence, log time [ns], publish time [ns], data."""

PART = 20_000
"""Rows that are looked at together, where what is computed of each takes much memory."""


def parts(count: int) -> Iterator[slice]:
    """Of so many rows, `PART` at a time."""
    return (slice(begin, begin + PART) for begin in range(0, count, PART))


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
        self._sizes = array("q")

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

    @property
    def sizes(self) -> Places:
        """Bytes of each, (N,)."""
        return np.array(self._sizes, np.int64)

    @property
    def raw(self) -> Table:
        """All of them, (bytes,) of uint8; it cannot be written to."""
        if not self.sizes.any():
            return np.frombuffer(b"", np.uint8)
        try:
            self._file.flush()
            mapped = mmap.mmap(self._file.fileno(), 0, access=mmap.ACCESS_READ)
        except OSError as error:
            raise _no_room(error) from error
        return np.frombuffer(mapped, np.uint8)

    def only(self, which: npt.NDArray[np.bool_]) -> DiskRows:
        """Some of them, by a mask (N,)."""
        ends = np.cumsum(self.sizes)
        begins, data, found = ends - self.sizes, self.raw, DiskRows()
        for place in np.flatnonzero(which).tolist():
            found.add(data[begins[place] : ends[place]].tobytes())
        return found

    def padded(
        self, which: Places, dtypes: dict[int, np.dtype[Any]], dtype: np.dtype[Any]
    ) -> DiskRows:
        """The same in one layout; numbers that a row does not have are NaN.

        Args:
            which: the layout of each, (N,).
            dtypes: of the layouts; `dtype` has their fields, with arrays at least as long.
        """
        begins, raw, found = np.cumsum(self.sizes) - self.sizes, self.raw, DiskRows()
        for part in parts(len(self)):
            block = np.zeros(len(begins[part]), dtype)
            for number in np.unique(which[part]).tolist():
                alike, given = which[part] == number, dtypes[number]
                places = begins[part][alike, None] + np.arange(given.itemsize)
                rows = raw[places].view(given)[:, 0]
                for name in given.names or ():
                    if given[name].shape:
                        values = np.full((len(rows), *dtype[name].shape), np.nan)
                        values[:, : given[name].shape[0]] = rows[name]
                        block[name][alike] = values
                    else:
                        block[name][alike] = rows[name]
            for row in block:
                found.add(row.tobytes())
        return found

    def table(self, dtype: np.dtype[Any]) -> Table:
        """All of them as a structured array, (N,); it cannot be written to.

        Raises:
            ValueError: one is longer or shorter than that.
        """
        if (self.sizes != dtype.itemsize).any():
            raise ValueError(f"a message is not of the {dtype.itemsize} bytes of those before it")
        return self.raw.view(dtype)


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
