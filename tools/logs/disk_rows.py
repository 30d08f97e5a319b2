"""Tables of a log that are longer than memory: rows on disk, and some rows of a table."""

from __future__ import annotations

import mmap
import tempfile
from array import array
from collections.abc import Iterator
from contextlib import suppress
from typing import Any

import numpy as np
import numpy.typing as npt

from hoap3.protocol.errors import LogError

Table = npt.NDArray[Any]
Places = npt.NDArray[np.int64]

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

    def table(self, dtype: np.dtype[Any]) -> Table:
        """All of them as a structured array, (N,); it cannot be written to.

        Raises:
            ValueError: one is longer or shorter than that.
        """
        if (self.sizes != dtype.itemsize).any():
            raise ValueError(f"a message is not of the {dtype.itemsize} bytes of those before it")
        return self.raw.view(dtype)


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
