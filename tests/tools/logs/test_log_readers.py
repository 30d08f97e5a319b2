"""Logs open in the readers that users have: mcap, mcap_ros2 and rosbags."""

from __future__ import annotations

import json
import struct
import zlib
from collections import defaultdict
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.reader import make_reader
from mcap.records import Chunk, MessageIndex
from mcap.stream_reader import StreamReader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from support.log_samples import MS, START, describe, inputs, ticks, write

from hoap3.protocol.messages import Event, Message, Setpoint, State, Target
from hoap3.protocol.robot.description import RobotDescription
from hoap3.protocol.runtime.shm_ring import Kind, Record
from hoap3.tools.logs.log import Log

JOINTS = 5
Decoded = dict[str, list[tuple[int, Any]]]


@pytest.fixture(scope="module")
def records() -> list[Record]:
    return inputs(describe(JOINTS)) + ticks(JOINTS, 1200)


@pytest.fixture(scope="module")
def path(records: list[Record], tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("log")
    return write(folder, records).paths[0]


def by_mcap_ros2(path: Path) -> Iterator[tuple[str, int, Any]]:
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        for decoded in reader.iter_decoded_messages():
            yield decoded.channel.topic, decoded.message.log_time, decoded.decoded_message


def by_rosbags(path: Path) -> Iterator[tuple[str, int, Any]]:
    with AnyReader([path]) as reader:
        for connection, stamp, raw in reader.messages():
            yield connection.topic, stamp, reader.deserialize(raw, connection.msgtype)


@pytest.fixture(scope="module", params=[by_mcap_ros2, by_rosbags])
def decoded(request: pytest.FixtureRequest, path: Path) -> Decoded:
    read: Callable[[Path], Iterator[tuple[str, int, Any]]] = request.param
    found: Decoded = defaultdict(list)
    for topic, stamp, message in read(path):
        found[topic.removeprefix("/robots/sample/")].append((stamp, message))
    return found


@pytest.mark.parametrize(
    ("kind", "topic", "message"),
    [
        (Kind.STATE, "state", State(JOINTS)),
        (Kind.SETPOINT, "setpoint", Setpoint(JOINTS, 2)),
        (Kind.EVENT, "events", Event()),
    ],
)
def test_every_field_is_decoded(
    decoded: Decoded, records: list[Record], kind: Kind, topic: str, message: Message
) -> None:
    sent = [record for record in records if record.kind == kind]
    assert len(decoded[topic]) == len(sent)
    for (stamp, found), record in zip(decoded[topic], sent, strict=True):
        message.load(record.payload)
        assert stamp == record.stamp
        for name in message.schema.scalars:
            assert getattr(found, name) == getattr(message, name)
        for name in message.schema.arrays:
            assert np.array_equal(getattr(found, name), getattr(message, name))


def test_inputs_are_json_in_strings(decoded: Decoded, records: list[Record]) -> None:
    sent = [record for record in records if record.kind > Kind.EVENT]
    assert len(decoded["inputs"]) == len(sent) == 3
    for (stamp, found), record in zip(decoded["inputs"], sent, strict=True):
        text = json.loads(found.data)
        assert stamp == text["stamp"] == record.stamp
        assert text["kind"] == record.kind.name.lower()
        assert text["body"] == json.loads(record.payload)


def test_joint_states_are_states_at_100_hz(decoded: Decoded, records: list[Record]) -> None:
    state, names = State(JOINTS), list(describe(JOINTS).joint_names)
    sent = {record.stamp: record for record in records if record.kind == Kind.STATE}
    found = decoded["joint_states"]
    assert [stamp for stamp, _ in found] == [START + 1000 + 10 * MS * k for k in range(120)]
    for stamp, message in found:
        state.load(sent[stamp].payload)
        header = message.header
        assert header.stamp.sec * 1_000_000_000 + header.stamp.nanosec == state.stamp_published
        assert header.frame_id == ""
        assert list(message.name) == names
        assert np.array_equal(message.position, state.q)
        assert np.array_equal(message.velocity, state.dq)
        assert np.array_equal(message.effort, state.tau)


def test_sequence_is_the_tick_and_publish_time_the_senders(path: Path) -> None:
    stamps = {"state": "stamp_published", "setpoint": "stamp_encoded", "events": "stamp"}
    with path.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        topics = [f"/robots/sample/{leaf}" for leaf in stamps]
        for found in reader.iter_decoded_messages(topics=topics):
            message, content = found.message, found.decoded_message
            leaf = found.channel.topic.rsplit("/", 1)[1]
            assert message.sequence == content.tick
            assert message.publish_time == getattr(content, stamps[leaf])


def test_the_file_has_all_that_the_librarys_has(path: Path, records: list[Record]) -> None:
    with path.open("rb") as stream:  # the streaming reader checks the CRC of the data section too
        found = [type(r).__name__ for r in StreamReader(stream, validate_crcs=True).records]
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        summary = reader.get_summary()
        assert reader.get_header().profile == "ros2"
        attachments = {a.name: a for a in reader.iter_attachments()}
        metadata = {m.name: m.metadata for m in reader.iter_metadata()}
    assert summary is not None
    statistics = summary.statistics
    assert statistics is not None
    assert statistics.message_count == found.count("Message") == len(records) + 120
    assert statistics.chunk_count == len(summary.chunk_indexes) > 2
    assert statistics.attachment_count == len(attachments) == found.count("Attachment") == 3
    assert statistics.metadata_count == len(metadata) == found.count("Metadata") == 4
    assert statistics.channel_count == statistics.schema_count == 6
    assert statistics.message_start_time == min(record.stamp for record in records)
    assert statistics.message_end_time == max(record.stamp for record in records)
    assert statistics.channel_message_counts[1] == 1200
    offsets = [o for index in summary.chunk_indexes for o in index.message_index_offsets]
    assert found.count("MessageIndex") == len(offsets)
    assert attachments["config.yaml"].media_type == "application/yaml"
    for channel in summary.channels.values():
        assert channel.message_encoding == "cdr"
        assert summary.schemas[channel.schema_id].encoding == "ros2msg"
        assert "reliability: 1" in channel.metadata["offered_qos_profiles"]


def test_the_summary_has_its_crc(path: Path) -> None:
    """The library writes this CRC but does not check it; it ends before itself in the footer."""
    content = path.read_bytes()
    summary_start, _, crc = struct.unpack_from("<QQI", content, len(content) - 28)
    assert content[summary_start] == 3  # a schema comes first
    assert zlib.crc32(content[summary_start : len(content) - 12]) == crc


def test_seeking_by_time_and_topic(path: Path, records: list[Record]) -> None:
    begin, end = START + 301 * MS, START + 777 * MS
    with path.open("rb") as stream:
        reader = make_reader(stream)
        topic = "/robots/sample/setpoint"
        found = [
            (message.log_time, message.data)
            for _, _, message in reader.iter_messages([topic], starting_at=begin, ending_before=end)
        ]
        backward = [m.log_time for _, _, m in reader.iter_messages([topic], reverse=True)]
    expected = [r for r in records if r.kind == Kind.SETPOINT and begin <= r.stamp < end]
    assert found == [(record.stamp, record.payload) for record in expected]
    assert backward == sorted(backward, reverse=True)
    with AnyReader([path]) as bags:
        chosen = [c for c in bags.connections if c.topic == topic]
        stamps = [stamp for _, stamp, _ in bags.messages(chosen, start=begin, stop=end)]
    assert stamps == [record.stamp for record in expected]


def test_message_indexes_point_at_messages(path: Path) -> None:
    seen = 0
    with path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
        assert summary is not None
        for index in summary.chunk_indexes:
            stream.seek(index.chunk_start_offset + 9)
            chunk = Chunk.read(ReadDataStream(stream))
            raw = zstandard.decompress(chunk.data)
            for channel, offset in index.message_index_offsets.items():
                stream.seek(offset + 9)
                entries = MessageIndex.read(ReadDataStream(stream))
                assert entries.channel_id == channel
                for stamp, at in entries.records:
                    opcode, _, owner, _, log_time = struct.unpack_from("<BQHIQ", raw, at)
                    assert (opcode, owner, log_time) == (5, channel, stamp)
                    assert index.message_start_time <= stamp <= index.message_end_time
                    seen += 1
    assert summary.statistics is not None
    assert seen == summary.statistics.message_count


def test_latched_topics_say_so(path: Path) -> None:
    with AnyReader([path]) as reader:
        durability = {
            c.topic.rsplit("/", 1)[1]: c.ext.offered_qos_profiles[0].durability.name
            for c in reader.connections
        }
    assert durability.pop("inputs") == "TRANSIENT_LOCAL"
    assert set(durability.values()) == {"VOLATILE"}
    assert set(durability) == {"state", "setpoint", "events", "joint_states", "targets"}


@pytest.mark.parametrize("read", [by_mcap_ros2, by_rosbags])
def test_what_a_stranger_sends_does_not_break_readers(
    tmp_path: Path, read: Callable[[Path], Iterator[tuple[str, int, Any]]]
) -> None:
    """The robot logs setpoints as they arrive, before it refuses them."""
    records = inputs(describe(2)) + ticks(2, 4)
    good = next(record for record in records if record.kind == Kind.SETPOINT)
    count_at = 4 + Setpoint.schema.offsets({"values": 2, "extra": 2})[0]["values"]
    for at, word in ((0, b"\x00\x00\x00\x00"), (count_at, b"\xff\xff\xff\xff")):
        wrong = good.payload[:at] + word + good.payload[at + 4 :]
        records.append(Record(Kind.SETPOINT, records[-1].stamp + 1, wrong))
        records.append(Record(Kind.SETPOINT, records[-1].stamp + 1, good.payload))
    path = write(tmp_path, records).paths[0]
    topics = [topic.rsplit("/", 1)[1] for topic, _, _ in read(path)]
    assert topics.count("setpoint") == 4 + 2
    assert topics.count("inputs") == 3 + 2
    assert list(Log.open(path).records()) == records


@pytest.mark.parametrize("read", [by_mcap_ros2, by_rosbags])
def test_targets_are_logged_as_they_were_sent(
    tmp_path: Path, read: Callable[[Path], Iterator[tuple[str, int, Any]]]
) -> None:
    target = Target(2, 3, rates=3)
    target.first_tick, target.tick_step, target.epoch = 120, 50, 3
    target.values[:], target.rates[:] = range(6), range(10, 16)
    records = [*inputs(describe(2)), Record(Kind.TARGET, START + 1, target.dump())]
    path = write(tmp_path, records).paths[0]
    (found,) = [message for topic, _, message in read(path) if topic.endswith("targets")]
    assert (found.first_tick, found.tick_step, found.points, found.dimension) == (120, 50, 2, 3)
    assert list(found.values) == list(target.values)
    assert list(found.rates) == list(target.rates)
    assert list(Log.open(path).records()) == records


def test_joint_states_follow_a_new_description(tmp_path: Path) -> None:
    renamed = describe(2).to_json().replace(b"joint_", b"axis_")
    again = inputs(RobotDescription.from_json(renamed), START + 30 * MS)
    records = inputs(describe(2)) + ticks(2, 30) + again + ticks(2, 30, first=31)
    path = write(tmp_path, records).paths[0]
    names = [
        list(message.name)
        for topic, _, message in by_rosbags(path)
        if topic.endswith("joint_states")
    ]
    assert names == 3 * [["joint_0", "joint_x1"]] + 4 * [["axis_0", "axis_x1"]]


def test_a_state_of_another_robot_gives_no_joint_state(tmp_path: Path) -> None:
    path = write(tmp_path, inputs(describe(2)) + ticks(3, 30)).paths[0]
    topics = [topic.rsplit("/", 1)[1] for topic, _, _ in by_mcap_ros2(path)]
    assert topics.count("state") == 30
    assert "joint_states" not in topics
