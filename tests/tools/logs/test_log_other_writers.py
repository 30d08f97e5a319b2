"""Logs that other MCAP tools have written again are read, and say the same."""

from __future__ import annotations

import random
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import CompressionType, IndexType, Writer
from support.log_samples import describe, inputs, ticks, write

from hoap3.protocol.errors import LogError
from hoap3.protocol.runtime.shm_ring import Kind
from hoap3.tools.logs.export import export
from hoap3.tools.logs.indexed_log import IndexedLog
from hoap3.tools.logs.log import Log
from hoap3.tools.logs.repair import repair

Order = Callable[[list[Any]], list[Any]]
KINDS = (Kind.STATE, Kind.SETPOINT, Kind.EVENT)


def shuffled(messages: list[Any]) -> list[Any]:
    random.Random(4).shuffle(messages)
    return messages


def by_topic(messages: list[Any]) -> list[Any]:
    return sorted(messages, key=lambda found: found[1].topic, reverse=True)


def in_reverse(messages: list[Any]) -> list[Any]:
    return messages[::-1]


def rewritten(
    out: Path,
    *sources: Path,
    order: Order = list,
    keep: Callable[[str], bool] = lambda _: True,
    metadata: bool = True,
    first_id: int = 0,
    profile: str | None = None,
    other: str = "",
    **options: Any,
) -> Path:
    """A copy of logs that the library's own writer has made."""
    with out.open("wb") as stream:
        writer = Writer(stream, **options)
        schemas: dict[tuple[Path, int], int] = {}
        channels: dict[tuple[Path, int], int] = {}
        for source in sources:
            with source.open("rb") as given:
                reader = make_reader(given)
                header = reader.get_header()
                if source == sources[0]:
                    writer.start(profile if profile is not None else header.profile, "another")
                    for _ in range(first_id):
                        writer.register_schema("another/msg/Type", "ros2msg", b"")
                messages = order(list(reader.iter_messages()))
                for schema, channel, message in messages:
                    assert schema is not None
                    if not keep(channel.topic):
                        continue
                    if (source, schema.id) not in schemas:
                        schemas[source, schema.id] = writer.register_schema(
                            schema.name, schema.encoding, schema.data
                        )
                    if (source, channel.id) not in channels:
                        number = schemas[source, schema.id]
                        channels[source, channel.id] = writer.register_channel(
                            channel.topic, channel.message_encoding, number, channel.metadata
                        )
                    writer.add_message(
                        channels[source, channel.id],
                        *(message.log_time, message.data, message.publish_time, message.sequence),
                    )
                if metadata:
                    for each in reversed(list(reader.iter_attachments())):
                        writer.add_attachment(
                            each.create_time, each.log_time, each.name, each.media_type, each.data
                        )
                    for facts in reader.iter_metadata():
                        writer.add_metadata(facts.name, facts.metadata)
        if other:
            number = writer.register_schema("std_msgs/msg/String", "ros2msg", b"string data")
            channel = writer.register_channel(other, "cdr", number)
            for stamp in range(3):
                writer.add_message(channel, stamp, b"\0\1\0\0\2\0\0\0a\0", stamp)
        writer.finish()
    return out


@pytest.fixture(scope="module")
def ours(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("ours")
    return write(folder, inputs(describe(2)) + ticks(2, 300)).paths[0]


WAYS: dict[str, dict[str, Any]] = {
    "lz4": {"compression": CompressionType.LZ4, "chunk_size": 4096},
    "zstd": {"compression": CompressionType.ZSTD, "chunk_size": 1 << 14},
    "uncompressed": {"compression": CompressionType.NONE},
    "no chunks": {"use_chunking": False},
    "no summary": {
        "use_statistics": False,
        "use_summary_offsets": False,
        "repeat_schemas": False,
        "repeat_channels": False,
        "index_types": IndexType.NONE,
        "chunk_size": 4096,
    },
    "no CRCs": {"enable_crcs": False},
    "data CRC": {"enable_data_crcs": True},
    "other ids": {"first_id": 7},
    "other profile": {"profile": ""},
    "shuffled": {"order": shuffled, "chunk_size": 4096},
    "by topic": {"order": by_topic, "chunk_size": 4096},
    "in reverse, no chunks": {"order": in_reverse, "use_chunking": False},
}


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
    expected, found = IndexedLog(ours), IndexedLog(path)
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
    with pytest.raises(LogError, match=r"robot\.mcap or controller\.mcap"):
        Log.open(rewritten(tmp_path / "a.mcap", ours, metadata=False))


def test_the_logs_of_both_sides_in_one_file_are_refused(tmp_path: Path, ours: Path) -> None:
    other = write(tmp_path, inputs(describe(2)) + ticks(2, 30), side="controller").paths[0]
    path = rewritten(tmp_path / "both.mcap", ours, other)
    with pytest.raises(LogError, match=r"controller of sample.*robot of sample.*merged"):
        Log.open(path)


@pytest.mark.parametrize("compression", [CompressionType.LZ4, CompressionType.ZSTD])
def test_a_damaged_chunk_of_another_writer_is_skipped(
    tmp_path: Path, ours: Path, compression: CompressionType
) -> None:
    path = rewritten(tmp_path / "robot.mcap", ours, compression=compression, chunk_size=4096)
    with path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    content = bytearray(path.read_bytes())
    chunk = summary.chunk_indexes[20]
    content[chunk.chunk_start_offset + chunk.chunk_length // 2] ^= 255
    path.write_bytes(content)
    log = Log.open(path)
    assert f"byte {chunk.chunk_start_offset} are damaged" in log.missing
    assert 250 < len(log.states()) < 300
    assert not log.truncated
