"""A damaged chunk costs what it holds, and is named; a log that claims too much is not unpacked."""

from __future__ import annotations

import os
import re
import resource
import struct
import subprocess
import sys
import zlib
from collections.abc import Callable
from io import BytesIO
from pathlib import Path
from typing import IO

import pytest
import zstandard
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.records import Attachment, Chunk, Metadata
from support.log_samples import START, Sample, chunks_of, describe, inputs, ticks, write

from hoap3.protocol.errors import LogError
from hoap3.protocol.messages import Target
from hoap3.protocol.runtime.shm_ring import Kind, Record
from hoap3.tools.logs import mcap_scan
from hoap3.tools.logs.export import export
from hoap3.tools.logs.log import Log
from hoap3.tools.logs.mcap_scan import MAX_CHUNK, McapScan
from hoap3.tools.logs.mcap_write import MAGIC, MESSAGE_HEAD, McapFile
from hoap3.tools.logs.repair import repair


@pytest.fixture(scope="module")
def sample(tmp_path_factory: pytest.TempPathFactory) -> Sample:
    found = Sample.of(tmp_path_factory.mktemp("log"), 3000)
    assert len(found.chunks) > 4
    return found


def changed(path: Path, content: bytes, *places: int, wrong: int = 255) -> Path:
    """A file with some bytes that are wrong."""
    found = bytearray(content)
    for place in places:
        found[place] ^= wrong
    path.write_bytes(found)
    return path


def without_gaps(log: Log) -> list[Record]:
    return [record for record in log.records() if record.kind != Kind.GAP]


def gaps(log: Log) -> int:
    return sum(record.kind == Kind.GAP for record in log.records())


@pytest.mark.slow
@given(data=st.data())
@settings(max_examples=15)
def test_one_wrong_byte_costs_its_chunk_and_no_other(
    tmp_path_factory: pytest.TempPathFactory, sample: Sample, data: st.DataObject
) -> None:
    chunk = data.draw(st.sampled_from(sample.chunks))
    start = chunk.chunk_start_offset
    header = data.draw(st.booleans())  # opcode and length, or all behind the range of times
    first, last = (start, start + 8) if header else (start + 25, start + chunk.chunk_length - 1)
    at, wrong = data.draw(st.integers(first, last)), data.draw(st.integers(1, 255))
    path = changed(tmp_path_factory.mktemp("wrong") / "robot.mcap", sample.content, at, wrong=wrong)
    log = Log.open(path)
    assert not log.truncated
    assert f"bytes at byte {start} are damaged" in log.missing
    assert without_gaps(log) == sample.without(chunk)
    assert gaps(log) == 1
    report = repair(path)
    assert (report.whole, report.dropped_bytes) == (False, 0)
    assert report.damaged == log.missing
    repaired = Log.open(report.out)
    assert list(repaired.records()) == list(log.records())
    assert repaired.missing == log.missing
    with report.out.open("rb") as stream:
        assert sum(1 for _ in make_reader(stream, validate_crcs=True).iter_messages()) > 1000


def test_a_wrong_byte_in_the_index_of_a_chunk_costs_no_record(
    tmp_path: Path, sample: Sample
) -> None:
    chunk = sample.chunks[1]
    for at in range(9):  # opcode and length of a record between two chunks
        place = chunk.chunk_start_offset + chunk.chunk_length + at
        log = Log.open(changed(tmp_path / "robot.mcap", sample.content, place))
        assert "outside its chunks is damaged" in log.missing
        assert list(log.records()) == sample.records


@pytest.mark.parametrize("lost", [(0,), (-1,), (1, 2), (0, -1), (1, 3)])
def test_the_time_that_is_missing_is_told(
    tmp_path: Path, sample: Sample, lost: tuple[int, ...]
) -> None:
    chunks = [sample.chunks[place] for place in lost]
    places = [chunk.chunk_start_offset + chunk.chunk_length // 2 for chunk in chunks]
    log = Log.open(changed(tmp_path / "robot.mcap", sample.content, *places))
    left = sample.without(*chunks)
    assert without_gaps(log) == left
    assert gaps(log) == (1 if lost == (1, 2) else len(lost))
    begin = left[0].stamp
    for chunk in chunks:
        before = [r.stamp for r in left if r.stamp < chunk.message_start_time]
        after = [r.stamp for r in left if r.stamp > chunk.message_end_time]
        if before:
            assert f"{(max(before) - begin) / 1e9:.3f} s" in log.missing
        if after:
            assert f"{(min(after) - begin) / 1e9:.3f} s" in log.missing
    written = export(tmp_path, tmp_path / "out.csv")
    assert not written.complete
    assert written.count == len({r.payload for r in left if r.kind == Kind.STATE})
    assert written.missing == log.missing


@pytest.mark.slow
def test_a_damaged_chunk_does_not_hide_the_files_that_follow(tmp_path: Path) -> None:
    records = inputs(describe(1)) + ticks(1, 4000)
    paths = write(tmp_path, records, file_bytes=200_000, cap_bytes=100_000_000).paths
    assert len(paths) > 2
    chunk = chunks_of(paths[0])[1]
    changed(paths[0], paths[0].read_bytes(), chunk.chunk_start_offset + chunk.chunk_length // 2)
    log = Log.open(tmp_path)
    assert log.paths == paths
    left = without_gaps(log)
    assert left[-1] == records[-1]
    report = repair(paths[0])
    assert report.damaged
    report.out.replace(paths[0])
    assert without_gaps(Log.open(tmp_path)) == left
    assert Log.open(tmp_path).missing == log.missing


def test_in_an_unfinished_log_what_is_behind_a_damaged_chunk_is_kept(
    tmp_path: Path, sample: Sample
) -> None:
    chunk, last = sample.chunks[1], sample.chunks[-1]
    place = chunk.chunk_start_offset + chunk.chunk_length // 2
    cut = sample.content[: last.chunk_start_offset + 100]
    log = Log.open(changed(tmp_path / "robot.mcap", cut, place))
    assert log.truncated
    assert without_gaps(log) == sample.without(chunk, last)
    report = repair(log.paths[0])
    assert report.damaged
    assert without_gaps(Log.open(report.out)) == sample.without(chunk, last)
    assert "100 bytes" in Log.open(report.out).missing


def forged(path: Path, source: Path, raw: bytes, times: int) -> Path:
    """A finished log with chunks that say the truth about themselves, without their index."""
    scan = McapScan.of(source)
    file = McapFile(path, scan.profile, "test")
    for name, facts in scan.metadata.items():
        file.add(Metadata(name, facts))
    for name, data in scan.attachments.items():
        file.add(Attachment(0, 0, name, "text/plain", data))
    for record in [*scan.schemas.values(), *scan.channels.values()]:
        file.add(record)
    packed, crc = zstandard.ZstdCompressor().compress(raw), zlib.crc32(raw)
    for _ in range(times):
        chunk = Chunk(
            compression="zstd",
            data=packed,
            message_start_time=START,
            message_end_time=START,
            uncompressed_crc=crc,
            uncompressed_size=len(raw),
        )
        chunk.write(file._pending)
    file.finish()
    return path


def message(data: bytes) -> bytes:
    return MESSAGE_HEAD.pack(5, len(data) + 22, 1, 0, START, START) + data


READ = """
import sys
from hoap3.tools.logs.log import Log
from hoap3.protocol.errors import LogError
from hoap3.protocol.runtime.shm_ring import Kind
from pathlib import Path
try:
    log = Log.open(Path(sys.argv[1]))
    print(len(log.table(Kind.STATE)[1]), log.missing)
except LogError as error:
    print(error)
"""


def bounded(path: Path) -> str:
    """What a process says of a log that may take some 30 s of CPU and 2 GiB of memory."""

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_CPU, (30, 30))
        resource.setrlimit(resource.RLIMIT_AS, (2 << 30, 2 << 30))

    command = [sys.executable, "-c", READ, str(path)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, preexec_fn=limit)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write(tmp_path_factory.mktemp("small"), inputs(describe(2)) + ticks(2, 20)).paths[0]


@pytest.mark.slow
def test_chunks_that_unpack_to_far_more_than_a_log_are_refused(tmp_path: Path, small: Path) -> None:
    raw = message(bytes((1 << 24) - 100))
    path = forged(tmp_path / "a.mcap", small, raw, 640)  # 10 GiB
    assert path.stat().st_size < 1 << 20
    assert "unpack to more bytes than a log of" in bounded(path)
    with pytest.raises(LogError, match=re.escape(str(path))):
        repair(path)


def test_a_chunk_that_is_too_large_is_skipped(tmp_path: Path, small: Path) -> None:
    raw = message(bytes(MAX_CHUNK + 1))
    log = Log.open(forged(tmp_path / "a.mcap", small, raw, 40))
    assert "no record is left" in log.missing
    assert list(log.records())[-1].kind == Kind.GAP


@pytest.mark.slow
def test_more_messages_than_a_log_can_hold_are_refused(tmp_path: Path, small: Path) -> None:
    path = forged(tmp_path / "a.mcap", small, message(b"") * 30_000, 40)
    assert path.stat().st_size < 1 << 20
    assert "unpack to more messages than a log of" in bounded(path)


def test_a_length_that_claims_all_memory_takes_none(tmp_path: Path, sample: Sample) -> None:
    """A sparse file makes the claim true."""
    content = bytearray(sample.content)
    struct.pack_into("<Q", content, sample.chunks[1].chunk_start_offset + 1, 1 << 40)
    path = tmp_path / "robot.mcap"
    path.write_bytes(content[: sample.chunks[2].chunk_start_offset])
    os.truncate(path, 1 << 41)
    assert list(Log.open(path).records()) == sample.without(*sample.chunks[1:])


def indexed(body: bytes, starts: list[int]) -> bytes:
    """A log with any records, whose index says that chunks begin at `starts` of them."""
    head = len(MAGIC)
    summary = b"".join(struct.pack("<BQQQQ", 8, 24, 0, 0, head + start) for start in starts)
    summary += struct.pack("<BQQQ", 2, 20, head + len(body), 0)
    return MAGIC + body + summary + struct.pack("<I", zlib.crc32(summary)) + MAGIC


def overlapping(opcode: int, head: bytes, count: int) -> bytes:
    """Records that all reach to the end of the last one; `head` has room for the length left."""
    size, body = 9 + len(head) + 8 * (opcode == 6), b""
    for place in range(count):
        left = size * (count - place - 1)
        body += struct.pack("<BQ", opcode, left + size - 9) + head
        body += struct.pack("<Q", left) * (opcode == 6)
    return indexed(body + b"\0" * 9, list(range(0, count * size, size)))


@pytest.mark.parametrize("kind", ["unknown", "footer", "chunk"])
def test_no_byte_is_read_again_for_each_entry_of_the_index(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    """A log's own index may name records that were read before, or that overlap each other."""
    count, taken, read = 1000, 0, 0
    content = {
        "unknown": indexed(struct.pack("<BQ", 200, 0) * count + bytes(9), list(range(0, 9000, 9))),
        "footer": overlapping(2, b"", count),
        "chunk": overlapping(6, struct.pack("<QQQII", 0, 0, 0, 0, 0), count),
    }[kind]
    path = tmp_path / "robot.mcap"
    path.write_bytes(content)
    following = McapScan._next

    class Counted(BytesIO):
        def fileno(self) -> int:
            return descriptor.fileno()

        def read(self, size: int | None = -1) -> bytes:
            nonlocal read
            data = super().read(size)
            read += len(data)
            return data

    def following_counted(scan: McapScan, stream: IO[bytes]) -> str:
        nonlocal taken
        taken += 1
        return following(scan, stream)

    monkeypatch.setattr(mcap_scan, "open_regular", lambda _: Counted(content))
    monkeypatch.setattr(McapScan, "_next", following_counted)
    with path.open("rb") as descriptor:
        McapScan.of(path)
    assert taken <= 2 * count + 10
    assert read <= 3 * len(content)


def test_what_is_no_file_is_not_opened(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "robot.mcap")
    for path in (tmp_path / "robot.mcap", tmp_path):
        with pytest.raises(LogError, match="FIFO"):
            Log.open(path)


def rewritten(path: Path, small: Path, change: Callable[[McapFile, McapScan], None]) -> Path:
    """A whole log of the same records, where `change` adds what stands before them."""
    scan = McapScan.of(small)
    file = McapFile(path, scan.profile, "test")
    change(file, scan)
    for each in (*scan.schemas.values(), *scan.channels.values()):
        file.add(each)
    for message_ in scan.messages():
        file.message(*message_)
    file.finish()
    return path


@pytest.mark.parametrize("wrong", ["", "12x4", "²", "9" * 30, "9" * 5000, "-1"])
def test_a_damaged_clock_does_not_stop_a_repair(tmp_path: Path, small: Path, wrong: str) -> None:
    """Metadata have no checksum."""

    def change(file: McapFile, scan: McapScan) -> None:
        for name, facts in scan.metadata.items():
            file.add(Metadata(name, {**facts, "monotonic_ns": wrong} if name == "clock" else facts))
        for name, data in scan.attachments.items():
            file.add(Attachment(0, 0, name, "text/plain", data))

    whole = rewritten(tmp_path / "a.mcap", small, change)
    path = tmp_path / "robot.mcap"
    path.write_bytes(whole.read_bytes()[:-100])
    assert list(Log.open(repair(path).out).records()) == list(Log.open(path).records())


def test_the_channel_of_targets_that_is_damaged_is_made_anew_by_a_repair(tmp_path: Path) -> None:
    target = Target(1, 3).dump()
    records = [*inputs(describe(2)), Record(Kind.TARGET, START + 10, target), *ticks(2, 5)]
    content = bytearray(write(tmp_path / "whole.mcap", records).paths[0].read_bytes())
    at = content.index(b"/robots/sample/targets")
    content[at - 2 * 2 - 4 - 9] = 0x70  # opcode of its record, in front of length, id, id, length
    path = tmp_path / "robot.mcap"
    path.write_bytes(content[:-100])
    out = repair(path).out
    assert McapScan.of(out).whole
    assert list(Log.open(out).records()) == records


def test_times_that_no_clock_gives_are_damage(tmp_path: Path) -> None:
    late = MESSAGE_HEAD.pack(5, MESSAGE_HEAD.size - 9, 1, 0, 1 << 63, 1 << 63)
    small = write(tmp_path, inputs(describe(2)) + ticks(2, 20)).paths[0]
    log = Log.open(forged(tmp_path / "a.mcap", small, late, 1))
    assert "no record is left" in log.missing
    log.states()
