"""A log that was cut off anywhere opens, and a repair makes it whole."""

from __future__ import annotations

import errno
import fcntl
import os
import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.stream_reader import StreamReader
from support.log_samples import MS, START, Sample, chunks_of, describe, inputs, ticks, write

from hoap3.protocol.errors import LogError, UsageError
from hoap3.tools.logs.files import is_locked, lock_shared
from hoap3.tools.logs.log import Log
from hoap3.tools.logs.mcap_write import McapFile
from hoap3.tools.logs.repair import repair, repair_all


@pytest.fixture(scope="module")
def sample(tmp_path_factory: pytest.TempPathFactory) -> Sample:
    return Sample.of(tmp_path_factory.mktemp("log"), 1500)


def stock_messages(path: Path) -> list[tuple[str, int, int, int, bytes]]:
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        return [
            (channel.topic, m.sequence, m.log_time, m.publish_time, m.data)
            for _, channel, m in reader.iter_messages(log_time_order=False)
        ]


@pytest.mark.slow
@given(share=st.floats(0, 1))
def test_cut_anywhere_it_opens_and_can_be_repaired(
    tmp_path_factory: pytest.TempPathFactory, sample: Sample, share: float
) -> None:
    size = round(share * (len(sample.content) - 1))
    path = tmp_path_factory.mktemp("cut") / "robot.mcap"
    path.write_bytes(sample.content[:size])
    expected = sample.readable(size)
    try:
        log = Log.open(path)
    except LogError:  # nothing was recorded yet
        assert size < sample.chunks[0].chunk_start_offset
        with pytest.raises(LogError, match=re.escape(str(path))):
            repair(path)
        return
    assert log.truncated
    assert "robot.mcap" in log.missing
    assert list(log.records()) == expected
    report = repair(path)
    assert path.read_bytes() == sample.content[:size]
    assert report.out == path.with_name("robot.repaired.mcap")
    found = stock_messages(report.out)
    assert (report.whole, report.messages) == (False, len(found))
    assert report.last_stamp == (expected[-1].stamp if expected else None)
    assert 0 <= report.dropped_bytes <= size
    assert list(Log.open(report.out).records()) == expected
    assert Log.open(report.out).attachments == log.attachments


@pytest.mark.parametrize("cut", [1, 8, 9, 40])
def test_a_cut_in_the_summary_costs_no_record(tmp_path: Path, sample: Sample, cut: int) -> None:
    path = tmp_path / "robot.mcap"
    path.write_bytes(sample.content[:-cut])
    log = Log.open(path)
    assert log.truncated
    assert list(log.records()) == sample.records


def test_a_repaired_file_has_all_that_a_whole_one_has(tmp_path: Path, sample: Sample) -> None:
    path, whole = tmp_path / "robot.mcap", tmp_path / "whole.mcap"
    whole.write_bytes(sample.content)
    last = sample.chunks[-1].chunk_start_offset
    path.write_bytes(sample.content[: last + 100])
    report = repair(path)
    assert report.out == tmp_path / "robot.repaired.mcap"
    assert report.dropped_bytes == 100
    end = sample.chunks[-2].message_end_time
    expected = [m for m in stock_messages(whole) if m[2] <= end]
    assert stock_messages(report.out) == expected
    assert len(chunks_of(report.out)) == len(sample.chunks) - 1
    with report.out.open("rb") as stream:
        assert sum(1 for _ in StreamReader(stream, validate_crcs=True).records) > len(expected)
    log = Log.open(report.out)
    assert log.metadata["repair"]["dropped_bytes"] == "100"
    assert "100 bytes" in log.missing
    assert log.config == "period_ms: 1\n"


def test_a_whole_log_is_left_alone(tmp_path: Path, sample: Sample) -> None:
    path = tmp_path / "robot.mcap"
    path.write_bytes(sample.content)
    report = repair(path)
    assert report.whole
    assert report.messages == len(stock_messages(path))
    assert report.as_json()["out"] == report.as_json()["path"] == str(path)
    assert list(tmp_path.iterdir()) == [path]
    assert path.read_bytes() == sample.content


def test_a_repair_replaces_nothing(tmp_path: Path, sample: Sample) -> None:
    path = tmp_path / "robot.mcap"
    path.write_bytes(sample.content[:-50])
    (tmp_path / "robot.repaired.mcap").write_text("mine")
    with pytest.raises(UsageError, match=r"robot\.repaired\.mcap"):
        repair(path)
    assert (tmp_path / "robot.repaired.mcap").read_text() == "mine"


def test_holes_of_zeros_end_the_log(tmp_path: Path, sample: Sample) -> None:
    """What a power failure may leave: the size is right, the last pages are empty."""
    middle = sample.chunks[1].chunk_start_offset + 50
    path = tmp_path / "robot.mcap"
    path.write_bytes(sample.content[:middle] + bytes(len(sample.content) - middle))
    log = Log.open(path)
    assert log.truncated
    assert list(log.records()) == sample.readable(middle)


def test_an_input_in_the_middle_is_saved_in_its_place(tmp_path: Path) -> None:
    again = inputs(describe(3), START + 400 * MS)
    records = inputs(describe(2)) + ticks(2, 390) + again + ticks(3, 300, first=401)
    path = write(tmp_path, records).paths[0]
    path.write_bytes(path.read_bytes()[:-1])
    report = repair(path)
    assert list(Log.open(report.out).records()) == records
    assert Log.open(report.out).description == describe(3)


def test_a_folder_cannot_be_repaired(tmp_path: Path) -> None:
    with pytest.raises(LogError, match=str(tmp_path)):
        repair(tmp_path)


def test_a_folder_is_repaired_once(tmp_path: Path, sample: Sample) -> None:
    path = tmp_path / "robot.mcap"
    path.write_bytes(sample.content[: len(sample.content) // 2])
    (first,), wrong = repair_all(tmp_path)
    assert wrong == []
    assert f"hoap3 report {first.out}" in str(first)
    written = first.out.read_bytes()
    (again,), wrong = repair_all(tmp_path)
    assert wrong == []
    assert again.already
    assert (again.out, again.messages) == (first.out, first.messages)
    assert first.out.read_bytes() == written


@pytest.mark.parametrize("content", [b"mine", None])
def test_what_no_repair_has_finished_is_not_taken_for_its_result(
    tmp_path: Path, sample: Sample, content: bytes | None
) -> None:
    path, out = tmp_path / "robot.mcap", tmp_path / "robot.repaired.mcap"
    path.write_bytes(sample.content[:-9])
    out.write_bytes(content or sample.content[:-50])
    reports, (wrong,) = repair_all(tmp_path)
    assert reports == []
    assert "exists already" in wrong


def test_a_repair_that_is_interrupted_stands_in_nobodys_way(
    tmp_path: Path, sample: Sample, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "robot.mcap"
    path.write_bytes(sample.content[: len(sample.content) // 2])

    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(McapFile, "message", interrupt)
    with pytest.raises(KeyboardInterrupt):
        repair(path)
    assert list(tmp_path.iterdir()) == [path]
    monkeypatch.undo()
    assert repair(path).messages > 0


def test_a_log_that_is_being_written_is_repaired_later(tmp_path: Path, sample: Sample) -> None:
    path = tmp_path / "robot.mcap"
    path.write_bytes(sample.content[: len(sample.content) // 2])
    with path.open("rb") as writer:
        lock_shared(writer.fileno())
        reports, (wrong,) = repair_all(tmp_path)
        assert reports == []
        assert str(path) in wrong
    (report,), wrong = repair_all(tmp_path)
    assert not wrong
    path.write_bytes(sample.content)  # it went on, and is whole now
    (after,), _ = repair_all(tmp_path)
    assert after.whole
    assert after.messages > report.messages


def test_where_locks_are_not_known_a_log_is_repaired_all_the_same(
    tmp_path: Path, sample: Sample, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As on a network's file system, which refuses an exclusive lock of what is only read."""
    path = tmp_path / "robot.mcap"
    path.write_bytes(sample.content[: len(sample.content) // 2])

    def refuse(*_: int) -> None:
        raise OSError(errno.EBADF, os.strerror(errno.EBADF))

    monkeypatch.setattr(fcntl, "flock", refuse)
    assert is_locked(path)  # nobody deletes it
    assert repair(path).messages > 0
