"""Reads a log: whole or cut off, one file or several, as the records that were written.

A log of an earlier wire version is read as one of today whose new arrays are empty. What a log
says about files or code is never followed; names in it are keys, no more.
"""

from __future__ import annotations

import hashlib
import json
import re
import struct
from collections.abc import Iterator, Sequence
from contextlib import suppress
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from hoap3.protocol.config.settings import parse_yaml
from hoap3.protocol.description import RobotDescription
from hoap3.protocol.errors import ConfigError, DescriptionError, LogError, WireError
from hoap3.protocol.messages import WIRE_VERSION
from hoap3.protocol.runtime.shm_ring import Kind, Record
from hoap3.protocol.wire_versions import OLDEST
from hoap3.tools.logs.disk_rows import MessageTable
from hoap3.tools.logs.log_format import (
    CHANNELS,
    FORMAT,
    LEAST_TOPICS,
    OF_OTHERS,
    SCHEMAS,
    SIDES,
    TOPICS,
    pack_gap,
    topic_name,
    unpack_message,
)
from hoap3.tools.logs.mcap_scan import Damage, McapMessage, McapScan

Rows = npt.NDArray[Any]
Stamps = npt.NDArray[np.int64]

MOST_NAMED = 5  # damaged places that are named one by one
LONGEST_PART = 9  # digits of a file's number
VERSIONS = tuple(str(version) for version in range(OLDEST, WIRE_VERSION + 1))  # that are read

NEVER_OURS = (
    *(WireError, LookupError, TypeError, ValueError),
    *(ArithmeticError, AttributeError, RecursionError),
)
"""What reading a record may raise that no service of ours has written."""

_FIRST = (Kind.DESCRIPTION, Kind.SESSION, Kind.CONFIG, Kind.TOKEN, Kind.REQUEST, Kind.AUTHORITY)
_CYCLE = (Kind.STATE, Kind.EVENT, Kind.RESET, Kind.SETPOINT)
_ORDER = {"robot": (*_FIRST, Kind.EVENT, *_CYCLE), "controller": (*_FIRST, *_CYCLE)}
"""In which records of one log time are processed, where another tool has shuffled them."""
_RISING = frozenset({CHANNELS["state"], CHANNELS["setpoint"]})

_TABLES = (Kind.STATE, Kind.SETPOINT, Kind.EVENT)
_NAME = re.compile(r"(robot|controller)(?:\.(\d{4,}))?\.mcap")


class Enclosed:
    """Files that the logs of a side enclose.

    Attributes:
        paths: of the logs.
        attachments: enclosed files by name, the last one of each.
    """

    paths: list[Path]
    attachments: dict[str, bytes]

    @property
    def config(self) -> str:
        """The resolved configuration that the service ran with, as YAML.

        Raises:
            LogError: the log encloses none, or no text.
        """
        return self._attachment("config.yaml").decode(errors="replace")

    @property
    def settings(self) -> dict[str, Any] | None:
        """The same as data; None where there is none that can be read."""
        try:
            return parse_yaml(self.config, f"config.yaml of {self.paths[0]}")
        except (LogError, ConfigError):
            return None

    @cached_property
    def description(self) -> RobotDescription:
        """The robot, as it last described itself.

        Raises:
            LogError: the log holds no description, or none that is valid.
        """
        try:
            return RobotDescription.from_json(self._attachment("description.json"))
        except DescriptionError as error:
            raise LogError(
                f"{self.paths[0]}: its description is not valid: {error}. "
                "Read the log with the version that wrote it"
            ) from error

    @property
    def joint_names(self) -> Sequence[str]:
        """Of the description; empty where there is none that is valid."""
        try:
            return self.description.joint_names
        except LogError:
            return ()

    def _attachment(self, name: str) -> bytes:
        if name not in self.attachments:
            enclosed = ", ".join(sorted(self.attachments)) or "nothing"
            raise LogError(
                f"{self.paths[0]}: encloses no {name} (but {enclosed}). "
                "Name a log that a service of ours has written to its end or nearly so"
            )
        return self.attachments[name]


class Log(Enclosed):
    """One side of a run.

    Where a file is cut off or missing, the log ends, even if further files exist; those can be
    opened by themselves. Damaged chunks of a file are skipped, and `missing` names them.

    Attributes:
        scans, paths: the files, oldest first.
        robot, side: whose log it is.
        wire_version: of its messages, as they were written.
        metadata: facts by group; of several files, the last one that says something.
        truncated: it ends early.
        from_begin: the first file that was written is there.
        damages: what cannot be read inside it, in words, "" for nothing.
        missing: what is lost, in words, "" for nothing.
        held, unreadable: messages of each kind that `table` last gave, and had to leave out.
        others: how many messages lie on topics that are not ours.
    """

    def __init__(self, files: list[Path]) -> None:
        self.scans, lost = _unbroken(files)
        self.truncated = lost is not None
        self.paths = [scan.path for scan in self.scans]
        self.metadata = {name: f for scan in self.scans for name, f in scan.metadata.items()}
        self.attachments = merge_attachments(self.scans)
        first = self.scans[0].metadata["log"]
        self.robot, self.side = first["robot"], first["side"]
        self.wire_version = int(first["wire_version"])
        before = _lost_at_begin(self.paths[0], first, self.metadata["log"])
        self.from_begin = before is None
        damages = [(scan, damage) for scan in self.scans for damage in scan.damages]
        repaired = [scan.metadata.get("repair", {}).get("damaged", "") for scan in self.scans]
        doubts = [f"{scan.path.name}: {what}" for scan in self.scans for what in scan.doubts]
        named = (*_describe(damages, self._begin), *doubts, *repaired)
        self.damages = "; ".join(filter(None, named))
        self.missing = "; ".join(filter(None, (before, self.damages, lost)))
        self.held: dict[Kind, int] = {}
        self.unreadable: dict[Kind, int] = {}
        foreign = [scan for scan in self.scans if 0 in scan.ids.values()]
        self.others = sum(message[0] == 0 for scan in foreign for message in scan.messages())

    @classmethod
    def open(cls, path: Path | str, side: str | None = None) -> Log:
        """Open a file, or all files of one side in the folder of a run.

        Args:
            path: `*.mcap` or a folder.
            side: "robot" or "controller"; None for whatever there is, if it is one only.

        Raises:
            LogError: nothing there, not ours, of the other side, or of another version.
        """
        if side is not None and side not in SIDES:
            raise LogError(f"{path}: no side is called {side!r}. Choose one of {', '.join(SIDES)}")
        log = cls(files_of(Path(path), side))
        if side not in {None, log.side}:
            raise LogError(f"{path}: is the log of the {log.side}. Name that of the {side}")
        return log

    @property
    def _begin(self) -> int:
        """Log time of its first message [ns], or 0."""
        return next((scan.begin for scan in self.scans if scan.begin is not None), 0)

    @cached_property
    def session(self) -> dict[str, Any]:
        """What its first session states; empty where there is none that can be read."""
        found = next((record for record in self.records() if record.kind == Kind.SESSION), None)
        with suppress(ValueError, RecursionError):
            content = json.loads(found.payload) if found is not None else {}
            return content if isinstance(content, dict) else {}
        return {}

    def names(self, key: str) -> list[str]:
        """Names that its first session gives: `extra` columns, or `conditions`."""
        found = self.session.get(key)
        return [str(name) for name in found] if isinstance(found, list) else []

    def records(self) -> Iterator[Record]:
        """Every record in the order in which it was processed; copies for viewers left out.

        In the place of what is damaged stands a record of kind GAP.

        Raises:
            LogError: a record of another version.
        """
        for place, scan in enumerate(self.scans):
            for channel, _, stamp, _, payload in _with_gaps(scan):
                try:
                    record, repeated = unpack_message(channel, stamp, payload)
                except ValueError as error:
                    raise LogError(
                        f"{scan.path}: an input that this version does not know ({error}). "
                        "Read the log with the version that wrote it"
                    ) from error
                if record is not None and not (repeated and place):  # else the file may be gone
                    yield record

    def table(self, kind: Kind) -> tuple[Stamps, Rows]:
        """Log times [ns] and all messages of a kind, as a structured array that lies on disk.

        Messages may differ in the lengths of their arrays: each array of the table is as long as
        the longest, and NaN fills the rest. Scalars are in every message. Messages that do not
        have the schema of the kind are left out and counted in `unreadable`.

        Args:
            kind: STATE, SETPOINT or EVENT.

        Raises:
            LogError: messages of another version, or no room for them in the temporary folder.
        """
        table = self._tables[kind]
        stamps, rows = table.rows
        self.held[kind], self.unreadable[kind] = len(rows), table.unreadable
        if table.unreadable and not len(rows):
            raise LogError(
                f"{self.paths[0]}: none of its {table.unreadable} messages of kind {kind.name} can "
                "be read. Read the log with the version that wrote it"
            )
        return stamps, rows

    @cached_property
    def _tables(self) -> dict[Kind, MessageTable]:
        tables = {kind: MessageTable(SCHEMAS[kind]) for kind in _TABLES}
        for record in self.records():
            if record.kind in tables:
                tables[record.kind].add(record.stamp, record.payload)
        return tables

    def states(self) -> Rows:
        """Every State, as a structured array with the field names of `State.msg`."""
        return self.table(Kind.STATE)[1]

    def setpoints(self) -> Rows:
        """Every Setpoint as such an array."""
        return self.table(Kind.SETPOINT)[1]

    def stamps(self, kind: Kind) -> Stamps:
        """Log times [ns] of the rows that `table` gives."""
        return self.table(kind)[0]


def merge_attachments(scans: Sequence[McapScan]) -> dict[str, bytes]:
    """Enclosed files by name, of several files that have one the last."""
    return {name: data for scan in scans for name, data in scan.attachments.items()}


def payload_hash(log: Log) -> str:
    """SHA-256 over kind, stamp and bytes of every record: equal for equal runs in lockstep.

    Without what others did, and where: requests, tokens and the other side's configuration bear
    names that are new at each start.
    """
    digest = hashlib.sha256()
    for record in log.records():
        if record.kind in OF_OTHERS:
            continue
        digest.update(struct.pack("<Iqq", record.kind, record.stamp, len(record.payload)))
        digest.update(record.payload)
    return digest.hexdigest()


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


def _unbroken(files: list[Path]) -> tuple[list[McapScan], str | None]:
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


def _with_gaps(scan: McapScan) -> Iterator[McapMessage]:
    """The messages of a file; for each damage an input of kind GAP."""
    newest = scan.begin or 0
    for part in scan.parts():
        if isinstance(part, Damage):
            gap = pack_gap(part.size, part.after or newest)
            yield CHANNELS["inputs"], 0, part.after or newest, part.after or newest, gap
        else:
            yield from part


def _describe(damages: list[tuple[McapScan, Damage]], begin: int) -> list[str]:
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
    if facts["format"] != FORMAT or facts["wire_version"] not in VERSIONS:
        raise LogError(
            f"{file}: has format {facts['format']}, wire version {facts['wire_version']}; this "
            f"version reads format {FORMAT}, wire version {' or '.join(VERSIONS)}. "
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


def _lost_at_begin(first: Path, facts: dict[str, str], newest: dict[str, str]) -> str | None:
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
