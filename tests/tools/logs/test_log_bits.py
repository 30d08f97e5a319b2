"""Each bit of a log that is wrong is found by a repair, which restores it or names it."""

from __future__ import annotations

import random
import struct
from functools import cache
from pathlib import Path

import pytest
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.stream_reader import StreamReader
from support.command_bench import inside
from support.log_samples import describe, inputs, ticks, write

from hoap3.protocol.errors import Hoap3Error
from hoap3.tools.logs.export import export
from hoap3.tools.logs.log import Log
from hoap3.tools.logs.mcap_write import MAGIC
from hoap3.tools.logs.repair import repair

REDUNDANT = {"SCHEMA", "CHANNEL", "MESSAGE_INDEX", "CHUNK_INDEX", "STATISTICS", "FOOTER"}
REDUNDANT |= {"ATTACHMENT_INDEX", "METADATA_INDEX", "SUMMARY_OFFSET", "begin", "end"}
KINDS = sorted(REDUNDANT | {"HEADER", "METADATA", "ATTACHMENT", "CHUNK", "DATA_END"})
RECORDS = inputs(describe(2)) + ticks(2, 700)


@cache
def sample(folder: Path) -> tuple[bytes, dict[str, list[tuple[int, int]]]]:
    """A log, and where its records of each kind begin and end."""
    content = write(folder, RECORDS).paths[0].read_bytes()
    found = {"begin": [(0, len(MAGIC))], "end": [(len(content) - len(MAGIC), len(content))]}
    at = len(MAGIC)
    while at < len(content) - len(MAGIC):
        (length,) = struct.unpack_from("<Q", content, at + 1)
        found.setdefault(Opcode(content[at]).name, []).append((at, at + 9 + length))
        at += 9 + length
    return content, found


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("whole")


def flipped(path: Path, content: bytes, bit: int) -> Path:
    changed = bytearray(content)
    changed[bit // 8] ^= 1 << bit % 8
    path.write_bytes(changed)
    return path


def assert_found(path: Path, kind: str, bit: int) -> None:
    """The repair says what is wrong; what it says is restored is as it was."""
    path.with_suffix(".repaired.mcap").unlink(missing_ok=True)
    try:
        report = repair(path)
    except Hoap3Error:
        assert kind not in REDUNDANT, bit  # nothing can be saved, which is an error
        return
    assert not report.whole, (kind, bit)
    found = report.rebuilt or report.doubts or report.damaged or report.dropped_bytes
    assert found or kind == "FOOTER", (kind, bit)  # without it a file is unfinished, but complete
    log = Log.open(report.out)
    if kind != "CHUNK":
        assert [r for r in log.records() if r in RECORDS] == RECORDS, (kind, bit)
    if report.doubts:
        assert all(doubt in log.missing for doubt in report.doubts.split("; "))
    with report.out.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        count = sum(1 for _ in reader.iter_messages(log_time_order=False))
        assert count == summary.statistics.message_count
        stream.seek(0)
        assert list(StreamReader(stream, validate_crcs=True).records)


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_a_flipped_bit_is_found(tmp_path: Path, folder: Path, kind: str) -> None:
    content, places = sample(folder)
    draw = random.Random(kind)
    for _ in range(5):
        begin, end = draw.choice(places[kind])
        bit = draw.randrange(8 * begin, 8 * end)
        assert_found(flipped(tmp_path / "robot.mcap", content, bit), kind, bit)


@pytest.mark.long
@pytest.mark.parametrize("kind", KINDS)
def test_every_bit_of_a_record_is_found(tmp_path: Path, folder: Path, kind: str) -> None:
    """All of a short one, many of a long one."""
    content, places = sample(folder)
    draw = random.Random(kind)
    begin, end = draw.choice(places[kind])
    bits = range(8 * begin, 8 * end)
    head = bits[: 9 * 8]  # opcode and length
    for bit in sorted({*head, *draw.sample(bits, min(len(bits), 150))}):
        assert_found(flipped(tmp_path / "robot.mcap", content, bit), kind, bit)


@pytest.mark.parametrize("kind", ["CHUNK_INDEX", "STATISTICS", "SUMMARY_OFFSET"])
def test_a_damaged_summary_is_restored(tmp_path: Path, folder: Path, kind: str) -> None:
    content, places = sample(folder)
    begin, _ = places[kind][0]
    path = flipped(tmp_path / "robot.mcap", content, 8 * (begin + 9 + 5))
    assert not Log.open(path).missing
    done = inside("record", "--repair", path, "--json")
    assert done.code == 0
    assert done.json()["rebuilt"]
    assert not Log.open(tmp_path / "robot.repaired.mcap").missing


@pytest.mark.parametrize(
    "kind", ["METADATA", "ATTACHMENT", "HEADER", "MESSAGE_INDEX", "SCHEMA", "CHANNEL"]
)
def test_other_damage_outside_chunks_is_named(tmp_path: Path, folder: Path, kind: str) -> None:
    content, places = sample(folder)
    path = flipped(tmp_path / "robot.mcap", content, 8 * (places[kind][0][1] - 8))
    named = {"ATTACHMENT": "the enclosed config.yaml is damaged"}.get(
        kind, "something outside its chunks is damaged: its header, metadata"
    )
    assert named in Log.open(path).missing
    assert not export(path, tmp_path / "a.csv").complete
    done = inside("record", "--repair", path, "--json")
    assert done.code == 1
    assert named in done.json()["doubts"]
    assert inside("record", "--repair", tmp_path).code == 1  # again, of the folder
    assert named in Log.open(tmp_path / "robot.repaired.mcap").missing


def test_an_index_that_leaves_a_chunk_out_is_found(tmp_path: Path, folder: Path) -> None:
    """Also where every CRC is right again: other readers would not see the messages."""
    from hoap3.tools.logs.mcap_write import McapFile

    content, _ = sample(folder)
    source = tmp_path / "a.mcap"
    source.write_bytes(content)
    forgotten = McapFile._summarise

    def summarise(file: McapFile) -> None:
        del file._chunks[0]
        forgotten(file)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(McapFile, "_summarise", summarise)
        path = write(tmp_path / "robot.mcap", RECORDS).paths[0]
    report = repair(path)
    assert "messages" in report.rebuilt
    assert list(Log.open(report.out).records()) == RECORDS
    assert repair(source).whole
