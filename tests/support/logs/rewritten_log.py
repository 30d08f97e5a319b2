"""Logs as other MCAP tools write them: by the library's own writer, in any way that it has."""

from __future__ import annotations

import random
from collections.abc import Callable
from pathlib import Path
from typing import Any

from mcap.reader import make_reader
from mcap.writer import CompressionType, IndexType, Writer

Order = Callable[[list[Any]], list[Any]]


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
