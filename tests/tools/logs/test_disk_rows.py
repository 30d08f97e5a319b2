"""Rows on disk read like an array, and some rows of a table like a part of it."""

from __future__ import annotations

import gc
import os
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from support.log_samples import describe, inputs, ticks, write

from hoap3.protocol.errors import LogError
from hoap3.tools.logs.disk_rows import DiskRows, RowsAt
from hoap3.tools.logs.log import Log

DTYPE = np.dtype([("tick", "<u8"), ("q", "<f8", (3,))])


def on_disk(messages: list[bytes]) -> DiskRows:
    rows = DiskRows()
    for message in messages:
        rows.add(message)
    return rows


@given(st.lists(st.binary(max_size=40), max_size=20))
def test_messages_of_any_length_are_kept_as_they_came(messages: list[bytes]) -> None:
    rows = on_disk(messages)
    assert rows.raw.tobytes() == b"".join(messages)
    assert rows.sizes.tolist() == [len(message) for message in messages]


@pytest.mark.slow
@given(hnp.arrays(DTYPE, st.integers(0, 12), elements={"allow_nan": False}))
def test_a_table_on_disk_is_the_array_that_was_put_there(array: np.ndarray[Any, Any]) -> None:
    table = on_disk([row.tobytes() for row in array]).table(DTYPE)

    np.testing.assert_array_equal(table, array)
    assert not table.flags.writeable


def test_a_table_outlives_its_rows_and_its_file_goes_with_it() -> None:
    rows = on_disk([b"12345678"] * 1000)
    descriptors = len(os.listdir("/proc/self/fd"))
    table = rows.table(np.dtype("<u8"))
    del rows
    gc.collect()

    assert len(set(table.tolist())) == 1
    assert len(os.listdir("/proc/self/fd")) <= descriptors
    del table
    gc.collect()
    assert len(os.listdir("/proc/self/fd")) < descriptors


def test_a_message_of_another_length_is_no_row() -> None:
    with pytest.raises(ValueError, match="8"):
        on_disk([b"12345678", b"1234", b"1234"]).table(np.dtype("<u8"))


@pytest.mark.slow
@given(hnp.arrays(DTYPE, st.integers(1, 12)), st.data())
def test_some_rows_are_those_that_numpy_would_copy(array: np.ndarray[Any, Any], data: Any) -> None:
    some_place = st.integers(0, len(array) - 1)
    places = data.draw(hnp.arrays(np.int64, st.integers(1, 9), elements=some_place))
    rows, copied = RowsAt(array, places), array[places]
    mask = data.draw(hnp.arrays(bool, len(copied)))
    cut = data.draw(st.slices(len(copied)))

    assert rows.dtype == copied.dtype
    for some, expected in (
        (rows, copied),
        (rows[mask], copied[mask]),
        (rows[cut], copied[cut]),
        (RowsAt.of(copied), copied),
        (RowsAt.of(rows), copied),
    ):
        assert len(some) == len(expected)
        for name in ("tick", "q"):
            np.testing.assert_array_equal(some[name], expected[name])
        assert [row.tobytes() for row in some] == [row.tobytes() for row in expected]
    assert rows[-1].tobytes() == copied[-1].tobytes()
    with pytest.raises(IndexError):
        rows[len(copied)]


def full(**_: object) -> Any:
    return Path("/dev/full").open("r+b")


def refuse(**_: object) -> None:
    raise OSError(2, "No such file or directory")


@pytest.mark.parametrize("given", [full, refuse])
def test_a_temporary_folder_that_takes_nothing_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, given: Any
) -> None:
    write(tmp_path / "robot.mcap", [*inputs(describe(3)), *ticks(3, 50)])
    monkeypatch.setattr(tempfile, "TemporaryFile", given)
    with pytest.raises(LogError, match="TMPDIR"):
        Log.open(tmp_path).states()
