"""No chunk spans a second, whichever clock counts: who kills the writer loses less than one."""

from __future__ import annotations

import errno
import os
import random
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.reader import make_reader
from support import HOUSE
from support.log_samples import MS, START, chunks_of, describe, inputs, ticks, write

import hoap3.tools.logs.log
from hoap3.protocol.runtime.shm_ring import Kind, Record
from hoap3.tools.logs.log import Log
from hoap3.tools.logs.log_writer import LogWriter

SECOND = 1_000_000_000


class FakeClock:
    """Wall time that passes when a test says so."""

    def __init__(self) -> None:
        self.now = 0

    def __call__(self) -> int:
        return self.now


def new_writer(folder: Path, clock: FakeClock) -> LogWriter:
    return LogWriter(folder, robot="sample", side="robot", attachments={}, metadata={}, now=clock)


def spans(path: Path) -> list[tuple[int, int]]:
    """First and last log time of each chunk of a finished file."""
    return [(index.message_start_time, index.message_end_time) for index in chunks_of(path)]


@pytest.mark.slow
@given(st.lists(st.integers(-3 * SECOND, 3 * SECOND), max_size=60))
def test_no_chunk_spans_a_second_of_log_time(
    tmp_path_factory: pytest.TempPathFactory, steps: list[int]
) -> None:
    records, stamp = [], 300 * SECOND
    for step, record in zip(steps, ticks(1, 60), strict=False):
        stamp += step
        records.append(Record(record.kind, stamp, record.payload))
    path = write(tmp_path_factory.mktemp("log"), records).paths[0]
    assert all(last - first <= SECOND for first, last in spans(path))
    assert list(Log.open(path).records()) == records


def test_a_chunk_of_a_slow_stream_is_on_disk_when_it_is_old(tmp_path: Path) -> None:
    clock = FakeClock()
    writer = new_writer(tmp_path, clock)
    (record, *others) = ticks(1, 3)
    writer.add(record)
    clock.now += SECOND // 4
    writer.flush_due(clock.now)
    assert list(Log.open(tmp_path).records()) == []
    clock.now += SECOND // 4
    writer.flush_due(clock.now)
    assert list(Log.open(tmp_path).records()) == [record]
    for other in others:
        writer.add(other)
    writer.close()
    assert list(Log.open(tmp_path).records()) == [record, *others]


def test_wall_time_cuts_a_chunk_where_log_time_stands_still(tmp_path: Path) -> None:
    clock = FakeClock()
    writer = new_writer(tmp_path, clock)
    records = [Record(Kind.STATE, START, record.payload) for record in ticks(1, 2000)[::2]]
    seen = 0
    for count, record in enumerate(records, 1):
        writer.add(record)
        clock.now += MS  # nobody calls flush_due
        seen = len(list(Log.open(tmp_path).records())) if count % 500 == 0 else seen
        assert count - seen <= 1000
    assert seen >= 400


@pytest.mark.slow
def test_a_busy_stream_is_cut_by_size(tmp_path: Path) -> None:
    records = [Record(Kind.STATE, START, record.payload) for record in ticks(21, 4000)[::2]]
    path = write(tmp_path, records).paths[0]
    chunks = chunks_of(path)
    assert len(chunks) > 2
    assert all(index.uncompressed_size < 1_100_000 for index in chunks)


CHILD = """
import sys
sys.path.insert(0, sys.argv[2])
from pathlib import Path
from support.log_samples import describe, inputs, ticks
from hoap3.protocol.runtime.shm_ring import Record
from hoap3.tools.logs.log_writer import LogWriter

now = 0
writer = LogWriter(
    Path(sys.argv[1]), robot="sample", side="robot", attachments={}, metadata={}, now=lambda: now
)
samples = inputs(describe(2)) + ticks(2, 300)
for place, line in enumerate(sys.stdin):
    now = int(line)
    sample = samples[place] if place < 3 else samples[3 + place % (len(samples) - 3)]
    writer.add(Record(sample.kind, now, sample.payload))
    writer.flush_due(now)
    print(now, flush=True)
"""


@pytest.mark.slow
@pytest.mark.parametrize("step", [MS // 2, 40 * MS, 900 * MS])
def test_a_killed_writer_loses_less_than_a_second(tmp_path: Path, step: int) -> None:
    """The test keeps the clock: a record is written, with that stamp, whenever it says so."""
    count = random.Random(step).randrange(2500, 6000) if step < MS else 100
    child = subprocess.Popen(
        [sys.executable, "-c", CHILD, str(tmp_path), str(HOUSE / "tests")],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        cwd=Path(hoap3.tools.logs.log.__file__).parents[2],
        text=True,
    )
    assert child.stdin is not None
    assert child.stdout is not None
    written = 0
    for place in range(count):
        child.stdin.write(f"{START + place * step}\n")
        child.stdin.flush()
        written = int(child.stdout.readline())
    child.kill()
    child.communicate()
    log = Log.open(tmp_path)
    records = list(log.records())
    assert log.truncated
    assert written == START + (count - 1) * step
    assert written - records[-1].stamp < SECOND
    assert [record.stamp for record in records] == [
        START + place * step for place in range(len(records))
    ]


def test_a_full_disk_costs_one_chunk_and_the_file_stays_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock, path = FakeClock(), tmp_path / "robot.mcap"
    writer = new_writer(tmp_path, clock)
    records = inputs(describe(1)) + ticks(1, 6)
    before, lost, after = records[:5], records[5:8], records[8:]
    really, halves = os.write, [True]

    def write_half_and_fail(fd: int, data: bytes) -> int:
        if halves:
            halves.pop()
            return really(fd, data[: len(data) // 2])
        raise OSError(errno.ENOSPC, "No space left on device")

    def add(part: list[Record]) -> None:
        for record in part:
            writer.add(record)
        clock.now += SECOND
        writer.flush_due(clock.now)

    add(before)
    size = path.stat().st_size
    with monkeypatch.context() as full:
        full.setattr(os, "write", write_half_and_fail)
        with pytest.raises(OSError, match="No space"):
            add(lost)
    assert path.stat().st_size == size  # no half chunk
    add(after)
    writer.close()
    log = Log.open(path)
    assert not log.truncated
    assert list(log.records()) == before + after
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        kept = [m for _, c, m in reader.iter_messages() if not c.topic.endswith("joint_states")]
    assert len(kept) == len(before + after)


def test_a_file_that_is_deleted_while_it_is_written_is_noticed(tmp_path: Path) -> None:
    clock, path = FakeClock(), tmp_path / "robot.mcap"
    writer = new_writer(tmp_path, clock)
    for record in inputs(describe(1)):
        writer.add(record)
    path.unlink()
    clock.now += SECOND
    with pytest.raises(FileNotFoundError, match=path.name):
        writer.flush_due(clock.now)
    writer.abandon()


def test_a_log_that_is_abandoned_can_be_told_from_a_whole_one(tmp_path: Path) -> None:
    clock, path = FakeClock(), tmp_path / "robot.mcap"
    writer = new_writer(tmp_path, clock)
    records = inputs(describe(1)) + ticks(1, 6)
    for record in records:
        writer.add(record)
    clock.now += SECOND
    writer.flush_due(clock.now)
    writer.abandon()
    assert writer.paths == [path]
    log = Log.open(path)
    assert log.truncated
    assert list(log.records()) == records
