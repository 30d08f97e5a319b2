"""Damaged logs, and such that are whole but hold what no service of ours writes.

Each is given to everything that reads logs. A tenth of the damage is in the bytes of the file; the
rest is in records that are packed again with right lengths and checksums.
"""

from __future__ import annotations

import json
import random
import threading
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from fuzzing import (
    CORPUS,
    NUMBERS,
    Findings,
    amount,
    mutate_bytes,
    mutate_text,
    mutate_tree,
)
from mcap.records import Attachment, Channel, Metadata, Schema

from hoap3.protocol.runtime.shm_ring import Kind
from hoap3.tools.analysis.replay import replay
from hoap3.tools.analysis.report.content import read_content
from hoap3.tools.analysis.report.page import write_report
from hoap3.tools.logs.export import export
from hoap3.tools.logs.log import Log, payload_hash
from hoap3.tools.logs.log_format import CHANNELS, pack_string, unpack_string
from hoap3.tools.logs.mcap_scan import McapMessage, McapScan
from hoap3.tools.logs.mcap_write import McapFile
from hoap3.tools.logs.repair import repair
from hoap3.tools.verify.verify import verify
from hoap3.tools.view.sources.log_overview import Overview
from hoap3.tools.view.sources.log_source import LogSource

FOLDER = CORPUS / "logs"
SIDES = ("robot", "controller")
LARGEST = (1 << 64) - 1


def scan(path: Path) -> None:
    """What every command does first."""
    log = Log.open(path)
    for kind in (Kind.STATE, Kind.SETPOINT, Kind.EVENT):
        log.table(kind)
    payload_hash(log)
    log.names("extra")


def exported(path: Path) -> None:
    for ending in (".csv", ".npz"):
        export(path, path.with_suffix(ending))


def repaired(path: Path) -> None:
    """A log is repaired, and what comes of it is a whole log."""
    out = path.with_suffix(".repaired.mcap")
    out.unlink(missing_ok=True)
    report = repair(path)
    assert McapScan.of(report.out).whole
    assert not McapScan.of(report.out).damages


def viewed(path: Path) -> None:
    """As the page shows it: its frames, and the whole at a glance."""
    log = Log.indexed(path)
    overview = Overview(log, log.begin, 2)
    overview._run()  # what its thread does
    json.dumps(overview.as_json())
    source = LogSource([path])
    try:
        json.dumps(source.hello())
        player = source.player()
        for at_s in (-1.0, 0.0, 0.01, 1e9):
            player.seek(at_s)
            player.frame()
    finally:
        source.close()


def reported(path: Path) -> None:
    json.dumps(read_content(path).as_json())


def drawn(path: Path) -> None:
    write_report(path, out=path.with_suffix(".html"))


READERS: dict[str, Callable[[Path], object]] = {
    "scan": scan,
    "export": exported,
    "repair": repaired,
    "replay": lambda path: replay(path, []),
    "verify": verify,
    "view": viewed,
    "report": reported,
}


@cache
def sample(side: str) -> tuple[bytes, McapScan, tuple[McapMessage, ...]]:
    """A small log: its bytes, and what is in it."""
    path = FOLDER / f"{side}.mcap"
    whole = McapScan.of(path)
    return path.read_bytes(), whole, tuple(whole.messages())


def mutated(draw: random.Random, path: Path, side: str) -> None:
    """Write a log that is damaged."""
    raw, whole, messages = sample(side)
    path.unlink(missing_ok=True)
    if draw.random() < 0.3:
        path.write_bytes(mutate_bytes(draw, raw))
    else:
        _rewritten(draw, path, whole, list(messages))


def _rewritten(
    draw: random.Random, path: Path, whole: McapScan, messages: list[McapMessage]
) -> None:
    """The same log, whole, with something else in it."""
    metadata = {name: dict(facts) for name, facts in whole.metadata.items()}
    attachments = dict(whole.attachments)
    channels = dict(whole.channels)
    for _ in range(draw.choice((1, 1, 2, 4))):
        match draw.randrange(10):
            case 0:
                facts = metadata[draw.choice(list(metadata))]
                key = draw.choice(list(facts))
                facts[key] = draw.choice(("", "x", str(draw.choice(NUMBERS)), facts[key] * 2, "²"))
            case 1:
                name = draw.choice(list(attachments))
                text = attachments[name].decode(errors="replace")
                attachments[name] = mutate_text(draw, text).encode(errors="replace")
            case 2:
                group = draw.choice((metadata, attachments, channels))
                del group[draw.choice(list(group))]  # type: ignore[arg-type]
            case _:
                at = draw.randrange(len(messages))
                messages[at : at + 1] = _other(draw, messages, messages[at])
    file = McapFile(path, whole.profile, "fuzz", compress=draw.random() < 0.5)
    for name, facts in metadata.items():
        file.add(Metadata(name, facts))
    for name, data in attachments.items():
        file.add(Attachment(0, 0, name, "application/octet-stream", data))
    for schema in whole.schemas.values():
        file.add(Schema(schema.id, schema.data, schema.encoding, schema.name))
    for channel in channels.values():
        file.add(Channel(channel.id, channel.topic, "cdr", channel.metadata, channel.schema_id))
    for message in messages:
        file._offsets.setdefault(message[0], [])  # also of a channel that is not told
        file._counts.setdefault(message[0], 0)
        file.message(*message)
    file.finish()


def _other(draw: random.Random, messages: list[McapMessage], old: McapMessage) -> list[McapMessage]:
    """What stands in the place of a message."""
    channel, sequence, log, publish, data = old
    match draw.randrange(8):
        case 0:
            return []
        case 1:
            return [old, old]
        case 2:
            return [draw.choice(messages)]
        case 3:
            stamp = draw.choice((0, 1, log + 10**9, max(0, log - 10**9), 2**63 - 1, 2**63, LARGEST))
            return [(channel, sequence, stamp, publish, data)]
        case 4:
            return [(draw.randrange(9), sequence, log, publish, data)]
        case 5 | 6 if channel == CHANNELS["inputs"]:
            return [(channel, sequence, log, publish, _other_input(draw, data))]
        case _:
            return [(channel, sequence, log, publish, mutate_bytes(draw, data, [messages[0][4]]))]


def _other_input(draw: random.Random, data: bytes) -> bytes:
    """Another JSON record: one that is not what its kind asks for."""
    tree: Any = json.loads(unpack_string(data))
    if draw.random() < 0.3:
        tree["body"] = draw.choice((None, [], {}, 1, "a", [[]], {"session_id": "x"}))
    else:
        tree["body"] = mutate_tree(draw, tree["body"])
    if draw.random() < 0.1:
        tree["kind"] = draw.choice([kind.name.lower() for kind in Kind])
    text = json.dumps(tree, ensure_ascii=False)
    return pack_string(text.encode(errors="replace").decode())


def warm(reader: str, folder: Path) -> None:
    """Read the valid log first: whatever is compiled or imported is so then."""
    for side in SIDES:
        if reader == "replay" and side == "robot":
            continue
        path = folder / f"valid_{side}.mcap"
        path.write_bytes(sample(side)[0])
        READERS[reader](path)


LONG = {"scan": 3000, "export": 1500, "repair": 1500, "replay": 600, "verify": 1000}
LONG |= {"view": 900, "report": 400}  # and 1,100 files that are scanned: 10,000
CASES = [
    *(pytest.param(reader, 5, marks=pytest.mark.slow) for reader in READERS),
    *(pytest.param(reader, count, marks=pytest.mark.long) for reader, count in LONG.items()),
]


@pytest.mark.parametrize(("reader", "count"), CASES)
def test_a_damaged_log_is_read_as_far_as_may_be_or_refused(
    reader: str,
    count: int,
    findings: Findings,
    tmp_path: Path,
) -> None:
    draw, path = random.Random(f"{reader} {count}"), tmp_path / "damaged.mcap"
    warm(reader, tmp_path)

    def decode(given: bytes) -> None:
        READERS[reader](path)

    for _ in range(count):
        mutated(draw, path, "controller" if reader == "replay" else draw.choice(SIDES))
        findings.judge(decode, path.read_bytes())
    findings.check(count)


@amount(30, 1100)
def test_a_damaged_file_is_scanned_or_refused(
    count: int,
    findings: Findings,
    tmp_path: Path,
) -> None:
    draw, path = random.Random(count), tmp_path / "damaged.mcap"

    def decode(given: bytes) -> None:
        scan(path)

    for _ in range(count):
        mutated(draw, path, draw.choice(SIDES))
        findings.judge(decode, path.read_bytes())
    findings.check(count)


@pytest.mark.long
def test_the_report_of_a_damaged_log_is_drawn_or_refused(
    findings: Findings,
    tmp_path: Path,
) -> None:
    """A drawing alone takes a second or two."""
    draw, path = random.Random(7), tmp_path / "damaged.mcap"

    def decode(given: bytes) -> None:
        drawn(path)

    for _ in range(60):
        mutated(draw, path, draw.choice(SIDES))
        findings.judge(decode, path.read_bytes(), most_s=20.0)
    findings.check(60)
    assert threading.active_count() == 1
