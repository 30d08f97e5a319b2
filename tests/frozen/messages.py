"""Read the messages of a log with the mcap packages, independently of the reader under test."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from .difference import Difference
from .json_tree import compare_json
from .tables import compare_tables

TOPICS = "state", "setpoint", "events", "targets"
"""Topics of which every byte is compared; `inputs` holds JSON, `joint_states` is derived."""


class Topic:
    """Messages of one topic in the order of the file: log times, bytes, and their decoder."""

    def __init__(self, decode: Callable[[bytes], Any]) -> None:
        self.decode = decode
        self.times: list[int] = []
        self.data: list[bytes] = []

    def rows(self) -> dict[str, dict[str, Any]]:
        """Decoded messages by tick; further ones of a tick have a number."""
        rows, seen = {}, Counter[int]()
        for time, data in zip(self.times, self.data, strict=True):
            message = self.decode(data)
            fields = {name: value_of(getattr(message, name)) for name in message.__slots__}
            tick = fields.get("tick", fields.get("first_tick"))
            key = f"tick {tick}" + (f" ({seen[tick] + 1})" if seen[tick] else "")
            seen[tick] += 1
            rows[key] = {"log_time": time, **fields}
        return rows


def value_of(value: Any) -> Any:
    """An array as numpy has it."""
    return np.array(value, dtype=float) if isinstance(value, list) else value


def read_topics(path: Path) -> dict[str, Topic]:
    """All messages by the last part of their topics."""
    topics: dict[str, Topic] = {}
    factory = DecoderFactory()
    with path.open("rb") as stream:
        for schema, channel, message in make_reader(stream).iter_messages(log_time_order=False):
            leaf = channel.topic.rpartition("/")[2]
            if leaf not in topics:
                decode = factory.decoder_for(channel.message_encoding, schema)
                topics[leaf] = Topic(decode)
            topics[leaf].times.append(message.log_time)
            topics[leaf].data.append(message.data)
    return topics


def compare_logs(old: Path, new: Path, path: str) -> Iterator[Difference]:
    """Yield the differences of two logs; messages are decoded only where bytes differ."""
    before, after = read_topics(old), read_topics(new)
    for name in TOPICS:
        one, other = before.get(name), after.get(name)
        if one is None and other is None:
            continue
        if one is None or other is None:
            yield Difference(f"{path}{name}", "added" if one is None else "removed")
        elif (one.times, one.data) != (other.times, other.data):
            found = list(compare_tables(one.rows(), other.rows(), f"{path}{name}."))
            yield from found or [Difference(f"{path}{name}", "changed", "bytes", "other bytes")]
    yield from compare_json(inputs_of(before), inputs_of(after), f"{path}inputs")


def inputs_of(topics: dict[str, Topic]) -> dict[str, list[Any]]:
    """JSON records of a log by their kind."""
    found: dict[str, list[Any]] = {}
    topic = topics.get("inputs")
    for data in topic.data if topic else ():
        assert topic is not None
        content = json.loads(topic.decode(data).data)
        found.setdefault(content.pop("kind"), []).append(content)
    return found
