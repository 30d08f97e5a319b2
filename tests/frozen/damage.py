"""Damage copies of logs, at places that depend on nothing but a seed and the size of the file."""

from __future__ import annotations

import random
from collections.abc import Callable
from pathlib import Path

from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer


def truncate(path: Path, share: float) -> None:
    """Keep this share of a file."""
    content = path.read_bytes()
    path.write_bytes(content[: int(len(content) * share)])


def flip(path: Path, seed: int, begin: float = 0.0, end: float = 1.0, count: int = 1) -> None:
    """Invert random bits between two shares of the length of a file."""
    rng, content = random.Random(seed), bytearray(path.read_bytes())
    for _ in range(count):
        place = int(len(content) * rng.uniform(begin, end))
        content[min(place, len(content) - 1)] ^= 1 << rng.randrange(8)
    path.write_bytes(content)


def flip_in_chunks(path: Path, *shares: float) -> None:
    """Invert a bit in the middle of the chunks with the messages at these shares of the time.

    How many messages a chunk has, and so its place, depends on how fast the log was written.
    """
    with path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    chunks, content = summary.chunk_indexes, bytearray(path.read_bytes())
    end = max(chunk.message_end_time for chunk in chunks)
    for share in shares:
        chunk = next(c for c in chunks if c.message_end_time >= share * end)
        content[chunk.chunk_start_offset + chunk.chunk_length // 2] ^= 1
    path.write_bytes(content)


def rewrite(path: Path) -> None:
    """Write all messages, attachments and metadata with another writer: LZ4, other channel ids."""
    source = path.rename(path.with_suffix(".before"))
    with source.open("rb") as stream, path.open("wb") as target:
        reader, writer = make_reader(stream), Writer(target, compression=CompressionType.LZ4)
        writer.start("ros2", "frozen")
        for _ in range(5):  # so that later ids differ
            schema = writer.register_schema("unused", "ros2msg", b"string data\n")
            writer.register_channel(f"/unused{schema}", "cdr", schema)
        channels: dict[int, int] = {}
        for schema, channel, message in reader.iter_messages(log_time_order=False):
            if channel.id not in channels:
                place = writer.register_schema(schema.name, schema.encoding, schema.data)
                words = channel.topic, channel.message_encoding, place, channel.metadata
                channels[channel.id] = writer.register_channel(*words)
            times = message.log_time, message.data, message.publish_time, message.sequence
            writer.add_message(channels[channel.id], *times)
        for file in reader.iter_attachments():
            about = file.create_time, file.log_time, file.name, file.media_type
            writer.add_attachment(*about, file.data)
        for record in reader.iter_metadata():
            writer.add_metadata(record.name, record.metadata)
        writer.finish()
    source.unlink()


def each(damage: Callable[[Path], None]) -> Callable[[Path], None]:
    """The damage of a folder in which each log is damaged."""

    def apply(folder: Path) -> None:
        for path in sorted(folder.glob("*.mcap")):
            damage(path)

    return apply


DAMAGES: dict[str, Callable[[Path], None]] = {
    "truncated": each(lambda path: truncate(path, 0.6)),
    "without_footer": each(lambda path: truncate(path, 0.9999)),
    "bit_in_head": each(lambda path: flip(path, 1, end=0.01)),
    "bits_in_chunks": each(lambda path: flip_in_chunks(path, 0.3, 0.6)),
    "bit_in_summary": each(lambda path: flip(path, 3, 0.995)),
    "rewritten": each(rewrite),
    "empty": each(lambda path: truncate(path, 0.0)),
    "without_controller": lambda folder: (folder / "controller.mcap").unlink(),
}
"""By name: what is done to the folder of a log."""
