"""A further file of a log that has no place: what there is stays whole, nothing closes twice."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest
from mcap.reader import make_reader
from support.log_samples import describe, inputs, ticks

from hoap3.protocol.errors import UsageError
from hoap3.protocol.runtime.shm_ring import Record
from hoap3.tools.logs.log import Log
from hoap3.tools.logs.log_writer import LogWriter

JOINTS, FILE = 4, 200_000
RECORDS = inputs(describe(JOINTS)) + ticks(JOINTS, 1500)


def small_files(folder: Path, files: int) -> LogWriter:
    """A writer of files that are soon full."""
    return LogWriter(
        folder,
        robot="sample",
        side="robot",
        attachments={},
        metadata={},
        file_bytes=FILE,
        cap_bytes=files * FILE,
        compress=False,
    )


def add_until_refused(writer: LogWriter, error: type[Exception]) -> list[Record]:
    """Records that were taken before one was not."""
    for taken, record in enumerate(RECORDS):
        try:
            writer.add(record)
        except error:
            return RECORDS[:taken]
    raise AssertionError("all were taken")


def assert_nothing_else_was_closed(writer: LogWriter, folder: Path) -> None:
    """Both ways to end it leave a file alone that has got its descriptor meanwhile."""
    bystanders = [os.open(folder, os.O_RDONLY) for _ in range(8)]
    writer.abandon()
    writer.close()
    for bystander in bystanders:
        os.close(bystander)  # would be refused


@pytest.mark.parametrize("code", [errno.EROFS, errno.EMFILE, errno.ENOENT])
def test_a_file_that_cannot_be_made_leaves_the_one_before_it_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, code: int
) -> None:
    writer = small_files(tmp_path, 100)
    really = os.open

    def refuse(path: object, flags: int, *rest: int) -> int:
        if flags & os.O_CREAT:
            raise OSError(code, os.strerror(code))
        return really(path, flags, *rest)  # type: ignore[call-overload, no-any-return]

    with monkeypatch.context() as patch:
        patch.setattr(os, "open", refuse)
        taken = add_until_refused(writer, UsageError)
    assert_nothing_else_was_closed(writer, tmp_path)
    assert [path.name for path in writer.paths] == ["robot.mcap"]
    log = Log.open(tmp_path)
    kept = list(log.records())
    assert kept == taken[: len(kept)]
    assert len(taken) - len(kept) < 100  # of what came since the last chunk
    assert log.missing  # what should follow
    with (tmp_path / "robot.mcap").open("rb") as stream:
        assert make_reader(stream, validate_crcs=True).get_summary() is not None


def test_an_old_file_that_cannot_be_deleted_ends_the_log(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    writer = small_files(tmp_path, 2)

    def refuse(path: Path, missing_ok: bool = False) -> None:
        raise OSError(errno.EROFS, os.strerror(errno.EROFS), str(path))

    with monkeypatch.context() as patch:
        patch.setattr(Path, "unlink", refuse)
        add_until_refused(writer, OSError)
    assert_nothing_else_was_closed(writer, tmp_path)
    assert all(path.exists() for path in writer.paths)
    assert len(Log.open(tmp_path).states()) > 100
