"""The files of a log: which belong together, whether they are ours, and what is lost of them."""

from __future__ import annotations

import re
from contextlib import suppress
from pathlib import Path

from hoap3.protocol.errors import LogError
from hoap3.protocol.former_names import find_former_name
from hoap3.protocol.messages import WIRE_VERSION
from hoap3.protocol.runtime.shm_ring import Kind
from hoap3.tools.logs.log_format import (
    CHANNELS,
    FORMAT,
    LEAST_TOPICS,
    SIDES,
    TOPICS,
    topic_name,
    unpack_message,
)
from hoap3.tools.logs.mcap_scan import Damage, McapScan

MOST_NAMED = 5  # damaged places that are named one by one
LONGEST_PART = 9  # digits of a file's number
_FIRST = (Kind.DESCRIPTION, Kind.SESSION, Kind.CONFIG, Kind.TOKEN, Kind.REQUEST, Kind.AUTHORITY)
_CYCLE = (Kind.STATE, Kind.EVENT, Kind.RESET, Kind.SETPOINT)
_ORDER = {"robot": (*_FIRST, Kind.EVENT, *_CYCLE), "controller": (*_FIRST, *_CYCLE)}
"""In which records of one log time are processed, where another tool has shuffled them."""
_RISING = frozenset({CHANNELS["state"], CHANNELS["setpoint"]})
"""Channels whose log times rise."""
_NAME = re.compile(r"(robot|controller)(?:\.(\d{4,}))?\.mcap")


def files_of(path: Path, side: str | None) -> list[Path]:
    """The file, or all files of one side in the folder of a run, oldest first.

    Raises:
        LogError: there are none, or of both sides where none is named.
    """
    if not path.is_dir():
        return [path]
    found: dict[str, dict[int, Path]] = {}
    for file in path.iterdir():
        if match := _NAME.fullmatch(file.name):
            found.setdefault(match[1], {})[int(match[2] or 0)] = file
    if side is None and len(found) > 1:
        raise LogError(f"{path}: holds logs of {' and '.join(sorted(found))}. Say which side")
    parts = found.get(side or next(iter(found), ""))
    if not parts:
        raise LogError(
            f"{path}: holds no {side or 'robot'}.mcap. Name a log or the folder of a run"
        )
    return [parts[part] for part in sorted(parts)]


def unbroken(files: list[Path]) -> tuple[list[McapScan], str | None]:
    """The files that follow each other without a loss, and what is lost behind them, or None."""
    scans: list[McapScan] = []
    for file in files:
        try:
            scan = McapScan.of(file)
            check_ours(scan)
        except LogError as error:
            if not scans:
                raise
            return scans, str(error)
        if scans and _part(scan) != _part(scans[-1]) + 1:
            break
        scans.append(scan)
        if lost := _lost_at_end(scan):
            return scans, lost
    if scans[-1].metadata.get("end", {}).get("continues") == "true":
        return scans, f"the file that follows {scans[-1].path.name}, and all that came after"
    return scans, None


def describe_damages(damages: list[tuple[McapScan, Damage]], begin: int) -> list[str]:
    """Where chunks are damaged, and between which times no record is left."""
    words = [
        f"{scan.path.name}: {damage.size} bytes at byte {damage.start} are damaged, "
        f"no record is left{_span(damage, begin)}"
        for scan, damage in damages[:MOST_NAMED]
    ]
    more = len(damages) - len(words)
    return [*words, f"and {more} more such places"] if more else words


def _span(damage: Damage, begin: int) -> str:
    """Between which times of the log a damage lies; "" where no message is left at all."""
    after, before = damage.after, damage.before
    if after is None and before is None:
        return ""
    if after is None or before is None:
        word, stamp = ("before", before) if after is None else ("after", after)
        return f" {word} {((stamp or 0) - begin) / 1e9:.3f} s"
    return f" between {(after - begin) / 1e9:.3f} s and {(before - begin) / 1e9:.3f} s"


def _is_part(text: str) -> bool:
    return text.isdecimal() and len(text) <= LONGEST_PART


def _part(scan: McapScan) -> int:
    return int(scan.metadata["log"]["part"])


def check_ours(scan: McapScan) -> None:
    """Refuse a file that is none of our logs; number the channels of one that is as ours.

    Raises:
        LogError: it is none, or of another version.
    """
    file = scan.path
    facts, needed = (
        scan.metadata.get("log", {}),
        {"format", "wire_version", "robot", "side", "part"},
    )
    if not needed <= facts.keys():
        facts = scan.metadata["log"] = _inferred(scan)
    if not (scan.whole or scan.has_messages) and len(scan.channels) < LEAST_TOPICS:
        raise LogError(f"{file}: {scan.problem}, before any record. Nothing can be saved")
    if not facts or facts["side"] not in SIDES or not _is_part(facts["part"]):
        raise LogError(f"{file}: is an MCAP file, but none of ours. Name a log of `hoap3`")
    if former := find_former_name("log", f"wire version {facts['wire_version']}"):
        raise LogError(f"{file}: {former.old} {former.problem}. {former.remedy}")
    if (facts["format"], facts["wire_version"]) != (FORMAT, str(WIRE_VERSION)):
        raise LogError(
            f"{file}: has format {facts['format']}, wire version {facts['wire_version']}; this "
            f"version reads format {FORMAT}, wire version {WIRE_VERSION}. "
            "Read it with the version that wrote it"
        )
    merged = {f"{m.get('side')} of {m.get('robot')}, part {m.get('part')}" for m in scan.logs}
    if len(merged) > 1:
        raise LogError(
            f"{file}: holds several logs in one file ({'; '.join(sorted(merged))}), whose messages "
            "cannot be told apart. Name the files that were merged"
        )
    known = {topic_name(facts["robot"], t.leaf): (n, t) for n, t in enumerate(TOPICS, 1)}
    ids = dict.fromkeys(scan.channels, 0)
    for number, channel in scan.channels.items():
        ours, topic = known.get(channel.topic, (0, TOPICS[0]))
        schema = scan.schemas.get(channel.schema_id)
        if ours == number or schema is None or schema.name == topic.schema_name:
            ids[number] = ours
    if not any(ids.values()):
        raise LogError(f"{file}: its topics are not those of our logs. Name a log of `hoap3`")
    if any(number != ours for number, ours in ids.items()):
        scan.ids = ids
    if scan.ids or scan.moved:
        order = _ORDER[facts["side"]]
        scan.sort(lambda channel, data: _rank(channel, data, order), _RISING)


def _inferred(scan: McapScan) -> dict[str, str]:
    """The facts about a log that another tool wrote without them; none where they are not known."""
    robots, side = set(), _NAME.fullmatch(scan.path.name)
    for channel in scan.channels.values():
        robot, _, leaf = channel.topic.removeprefix("/robots/").rpartition("/")
        schema = scan.schemas.get(channel.schema_id)
        for topic in TOPICS:
            if schema and (leaf, schema.name, schema.data.decode(errors="replace")) == (
                *(topic.leaf, topic.schema_name),
                topic.schema_text,
            ):
                robots.add(robot)
    if len(robots) != 1:
        return {}
    if side is None:
        raise LogError(
            f"{scan.path}: its metadata `log` are missing, so it is not known whose log it is. "
            "Name the file robot.mcap or controller.mcap"
        )
    scan.doubts.append("its metadata `log` are missing, as of a log that another tool has filtered")
    facts = {"format": FORMAT, "wire_version": str(WIRE_VERSION), "part": side[2] or "0"}
    return {**facts, "robot": robots.pop(), "side": side[1]}


def _rank(channel: int, data: bytes, order: tuple[int, ...]) -> int:
    """The place of a message among those with its log time."""
    with suppress(ValueError):
        record, _ = unpack_message(channel, 0, data)
        if record is not None and record.kind in order:
            return order.index(record.kind)
    return len(order)


def lost_at_begin(first: Path, facts: dict[str, str], newest: dict[str, str]) -> str | None:
    """What is lost before the first file: its part counts from 0."""
    if facts["part"] == "0":
        return None
    deleted, cap = newest.get("deleted"), newest.get("cap_bytes")
    why = f": the cap of {cap} bytes deleted {deleted}" if deleted else ""
    return f"everything before {first.name}{why}"


def _lost_at_end(scan: McapScan) -> str | None:
    """What is lost behind this file, as far as the file itself can tell."""
    if not scan.whole:
        rest = scan.size - scan.end
        return f"{scan.path.name}: {scan.problem}; {rest} bytes and all that came after are lost"
    if scan.metadata.get("repair", {}).get("problem"):
        dropped = scan.metadata["repair"].get("dropped_bytes", "?")
        return f"{scan.path.name} was cut off and repaired; {dropped} bytes and what came after"
    return None
