"""Logs that other MCAP tools have written again are read, and say the same."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from mcap.writer import CompressionType
from support.log_samples import chunks_of, describe, inputs, ticks, write
from support.logs.rewritten_log import WAYS, rewritten

from hoap3.protocol.errors import LogError
from hoap3.protocol.runtime.shm_ring import Kind
from hoap3.tools.logs.export import export
from hoap3.tools.logs.log import Log
from hoap3.tools.logs.repair import repair

KINDS = (Kind.STATE, Kind.SETPOINT, Kind.EVENT)


@pytest.fixture(scope="module")
def ours(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("ours")
    return write(folder, inputs(describe(2)) + ticks(2, 300)).paths[0]


@pytest.mark.parametrize("way", WAYS)
def test_a_rewritten_log_has_the_same_records(tmp_path: Path, ours: Path, way: str) -> None:
    path = rewritten(tmp_path / "robot.mcap", ours, **WAYS[way])
    ours_log, log = Log.open(ours), Log.open(path)
    assert not log.missing
    assert list(log.records()) == list(ours_log.records())
    for kind in KINDS:
        for found, expected in zip(log.table(kind), ours_log.table(kind), strict=True):
            assert found.tobytes() == expected.tobytes()
    assert log.description == ours_log.description
    assert log.config == ours_log.config
    written = [export(each, tmp_path / f"{n}.csv") for n, each in enumerate((ours, path))]
    assert written[0].out.read_bytes() == written[1].out.read_bytes()
    assert written[1].complete


@pytest.mark.parametrize("way", WAYS)
def test_a_rewritten_log_is_shown_at_any_time(tmp_path: Path, ours: Path, way: str) -> None:
    path = rewritten(tmp_path / "robot.mcap", ours, **WAYS[way])
    expected, found = Log.indexed(ours), Log.indexed(path)
    assert (found.begin, found.end) == (expected.begin, expected.end)
    for stamp in np.linspace(expected.begin, expected.end, 7).astype(int).tolist():
        one, other = expected.state_at(stamp), found.state_at(stamp)
        assert (one is None) == (other is None)
        if one is not None and other is not None:
            assert other.state.dump() == one.state.dump()
            assert other.stamp == one.stamp


@pytest.mark.parametrize("way", WAYS)
def test_a_rewritten_log_is_whole_and_its_begin_can_be_saved(
    tmp_path: Path, ours: Path, way: str
) -> None:
    path = rewritten(tmp_path / "robot.mcap", ours, **WAYS[way])
    assert repair(path).whole
    content = path.read_bytes()
    path.write_bytes(content[: len(content) * 9 // 10])
    log = Log.open(path)
    report = repair(path)
    assert report.messages > 100
    assert list(Log.open(report.out).records()) == list(log.records())


def test_messages_on_other_topics_are_counted(tmp_path: Path, ours: Path) -> None:
    path = rewritten(tmp_path / "robot.mcap", ours, other="/camera")
    log = Log.open(path)
    assert log.others == 3
    assert list(log.records()) == list(Log.open(ours).records())
    assert export(path, tmp_path / "a.csv").left_out["messages on other topics"] == 3


def test_a_log_without_its_metadata_is_read_as_far_as_it_goes(tmp_path: Path, ours: Path) -> None:
    path = rewritten(tmp_path / "robot.mcap", ours, metadata=False)
    log = Log.open(path)
    assert (log.robot, log.side) == ("sample", "robot")
    assert list(log.records()) == list(Log.open(ours).records())
    assert "metadata" in log.missing
    assert not export(path, tmp_path / "a.csv").complete
    with pytest.raises(LogError, match=r"a\.mcap.*robot\.mcap"):
        Log.open(rewritten(tmp_path / "a.mcap", ours, metadata=False))


def test_the_logs_of_both_sides_in_one_file_are_refused(tmp_path: Path, ours: Path) -> None:
    other = write(tmp_path, inputs(describe(2)) + ticks(2, 30), side="controller").paths[0]
    path = rewritten(tmp_path / "both.mcap", ours, other)
    with pytest.raises(LogError, match=r"both\.mcap.*controller.*robot"):
        Log.open(path)


@pytest.mark.parametrize("compression", [CompressionType.LZ4, CompressionType.ZSTD])
def test_a_damaged_chunk_of_another_writer_is_skipped(
    tmp_path: Path, ours: Path, compression: CompressionType
) -> None:
    path = rewritten(tmp_path / "robot.mcap", ours, compression=compression, chunk_size=4096)
    content = bytearray(path.read_bytes())
    chunk = chunks_of(path)[20]
    content[chunk.chunk_start_offset + chunk.chunk_length // 2] ^= 255
    path.write_bytes(content)
    log = Log.open(path)
    assert f"byte {chunk.chunk_start_offset}" in log.missing
    assert 250 < len(log.states()) < 300
    assert not log.truncated
