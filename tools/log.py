"""Reads a log: whole or cut off, one file or several, as the records that were written.

What a log says about files or code is never followed; names in it are keys, no more.
"""

from __future__ import annotations

import hashlib
import re
import struct
from array import array
from collections.abc import Iterator
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from protocol.description import RobotDescription
from protocol.errors import DescriptionError, LogError
from protocol.messages import CDR_HEADER, WIRE_VERSION, Schema
from protocol.ring import Kind, Record
from tools.log_format import (
    CHANNELS,
    FORMAT,
    KIND_CHANNELS,
    MESSAGES,
    PROFILE,
    SIDES,
    TOPICS,
    file_name,
    topic_name,
    unpack_input,
)
from tools.mcap_scan import McapScan

Rows = npt.NDArray[Any]
Stamps = npt.NDArray[np.int64]

_NAME = re.compile(r"(robot|controller)(?:\.(\d{4,}))?\.mcap")


class Log:
    """One side of a run.

    What is read is one unbroken stretch: where a file is damaged, cut off or missing, the log ends,
    even if further files exist; those can be opened by themselves.

    Attributes:
        paths: the files, oldest first.
        robot, side: whose log it is.
        metadata: facts by group; of several files, the last one that says something.
        attachments: enclosed files by name, likewise.
        truncated: it ends early.
        missing: what is lost, in words, "" for nothing.
    """

    def __init__(self, scans: list[McapScan]) -> None:
        facts = [_facts(scan) for scan in scans]
        self.robot, self.side = facts[0]["robot"], facts[0]["side"]
        parts = [int(found["part"]) for found in facts]
        lost: list[str] = []
        if parts[0]:
            lost.append(f"everything before {scans[0].path.name}{_why(facts[-1])}")
        used = 0
        for used, scan in enumerate(scans, 1):
            if (end := _end_of(scan, parts[used - 1], parts[used:])) is not None:
                lost.append(end)
                break
        self.truncated = len(lost) > bool(parts[0])
        self.missing = "; ".join(lost)
        self._scans = scans[:used]
        self.paths = [scan.path for scan in self._scans]
        self.metadata = {name: f for scan in self._scans for name, f in scan.metadata.items()}
        self.attachments = {
            name: data for scan in self._scans for name, data in scan.attachments.items()
        }

    @classmethod
    def open(cls, path: Path, side: str | None = None) -> Log:
        """Open a file, or all files of one side in the folder of a run.

        Args:
            path: `*.mcap` or a folder.
            side: "robot" or "controller"; None for whatever there is, if it is one only.

        Raises:
            LogError: nothing there, not ours, of the other side, or of another version.
        """
        if side is not None and side not in SIDES:
            raise LogError(f"{path}: no side is called {side!r}. Choose one of {', '.join(SIDES)}")
        log = cls([McapScan.of(found) for found in _files(path, side)])
        if side not in {None, log.side}:
            raise LogError(f"{path}: is the log of the {log.side}. Name that of the {side}")
        return log

    @property
    def config(self) -> str:
        """The resolved configuration that the service ran with, as YAML.

        Raises:
            LogError: the log encloses none, or no text.
        """
        return self._attachment("config.yaml").decode(errors="replace")

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

    def records(self) -> Iterator[Record]:
        """Every record in the order in which it was processed; copies for viewers left out.

        Raises:
            LogError: a chunk of a finished file is damaged.
        """
        kinds = {channel: kind for kind, channel in KIND_CHANNELS.items()}
        inputs = CHANNELS["inputs"]
        for place, scan in enumerate(self._scans):
            for message in scan.messages():
                channel, _, stamp, _, payload = message
                kind = kinds.get(channel)
                if kind is not None:
                    yield Record(kind, stamp, payload)
                elif channel == inputs:
                    record, repeated = unpack_input(payload)
                    if not repeated or place == 0:  # it may come from a file that is gone
                        yield record

    def table(self, kind: Kind) -> tuple[Stamps, Rows]:
        """Log times [ns] and all messages of a kind, as a structured array.

        Where messages differ in the lengths of their arrays, as those of a stranger may do, these
        are the ones of the most frequent layout; `records` has all.

        Args:
            kind: STATE, SETPOINT or EVENT.
        """
        channel, by_size = KIND_CHANNELS[kind], dict[int, tuple[array[int], bytearray]]()
        for scan in self._scans:
            for message in scan.messages():
                if message[0] == channel:
                    payload = message[4]
                    found = by_size.get(len(payload))
                    if found is None:
                        found = by_size[len(payload)] = (array("q"), bytearray())
                    found[0].append(message[2])
                    found[1].extend(payload)
        schema = MESSAGES[kind].schema
        if not by_size:
            return np.empty(0, np.int64), np.empty(0, _empty(schema))
        stamps, data = max(by_size.values(), key=lambda found: len(found[0]))
        return _of_one_layout(schema, np.frombuffer(stamps, np.int64), data)

    def states(self) -> Rows:
        """Every State, as a structured array with the field names of `State.msg`."""
        return self.table(Kind.STATE)[1]

    def setpoints(self) -> Rows:
        """Every Setpoint, likewise."""
        return self.table(Kind.SETPOINT)[1]

    def stamps(self, kind: Kind) -> Stamps:
        """Log times [ns] of the rows that `table` gives."""
        return self.table(kind)[0]

    def _attachment(self, name: str) -> bytes:
        if name not in self.attachments:
            enclosed = ", ".join(sorted(self.attachments)) or "nothing"
            raise LogError(
                f"{self.paths[0]}: encloses no {name} (but {enclosed}). "
                "Name a log that a service of ours has written to its end or nearly so"
            )
        return self.attachments[name]


def payload_hash(log: Log) -> str:
    """SHA-256 over kind, stamp and bytes of every record: equal for equal runs in lockstep."""
    digest = hashlib.sha256()
    for record in log.records():
        digest.update(struct.pack("<Iqq", record.kind, record.stamp, len(record.payload)))
        digest.update(record.payload)
    return digest.hexdigest()


def _files(path: Path, side: str | None) -> list[Path]:
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
        raise LogError(f"{path}: holds no {side or 'robot'}.mcap. Name a log or the folder of a run")
    return [parts[part] for part in sorted(parts)]


def _facts(scan: McapScan) -> dict[str, str]:
    """The group `log` of a file's metadata, once the file is known to be one of ours."""
    facts = scan.metadata.get("log", {})
    if not {"format", "wire_version", "robot", "side", "part"} <= facts.keys():
        if not scan.whole and scan.profile in {"", PROFILE}:
            raise LogError(f"{scan.path}: {scan.problem}, before any record. Nothing can be saved")
        raise LogError(f"{scan.path}: is an MCAP file, but none of ours. Name a log of `hoap3`")
    version = f"format {facts['format']}, wire version {facts['wire_version']}"
    if (facts["format"], facts["wire_version"]) != (FORMAT, str(WIRE_VERSION)):
        raise LogError(
            f"{scan.path}: has {version}; this version reads format {FORMAT}, wire version "
            f"{WIRE_VERSION}. Read it with the version that wrote it"
        )
    expected = {place: topic_name(facts["robot"], t.leaf) for place, t in enumerate(TOPICS, 1)}
    topics = {place: channel.topic for place, channel in scan.channels.items()}
    if not scan.whole and len(topics) < len(expected):
        raise LogError(f"{scan.path}: {scan.problem}, before any record. Nothing can be saved")
    if scan.profile != PROFILE or topics != expected or facts["side"] not in SIDES:
        raise LogError(f"{scan.path}: its topics are not those of our logs. Name a log of `hoap3`")
    if not facts["part"].isdecimal():
        raise LogError(f"{scan.path}: its metadata are not those of our logs. Name a log of `hoap3`")
    return facts


def _why(facts: dict[str, str]) -> str:
    deleted = len(facts.get("deleted", "").split())
    cap = facts.get("cap_bytes", "?")
    return f" ({deleted} deleted by the cap of {cap} bytes)" if deleted else ""


def _end_of(scan: McapScan, part: int, following: list[int]) -> str | None:
    """What is lost behind this file, or None where the log goes on or was ended here."""
    name = scan.path.name
    if not scan.whole:
        lost = f"{name}: {scan.problem}; {scan.size - scan.end} bytes and what came after are lost"
        return lost + (f", {len(following)} further files are not read" if following else "")
    if following and following[0] == part + 1:
        return None
    if following or scan.metadata.get("end", {}).get("continues") == "true":
        return f"{file_name(name.split('.')[0], part + 1)}, which follows {name}, is not there"
    return None


def _empty(schema: Schema) -> np.dtype[Any]:
    return schema.dtype(dict.fromkeys(schema.arrays, 0))


def _of_one_layout(schema: Schema, stamps: Stamps, data: bytearray) -> tuple[Stamps, Rows]:
    """Those of equally long messages whose arrays are as long as in most of them."""
    raw = np.frombuffer(data, np.uint8).reshape(len(stamps), -1)
    left = np.ones(len(stamps), bool)
    best, dtype = np.zeros(len(stamps), bool), _empty(schema)
    while left.sum() > best.sum():
        lengths = schema.lengths_in(raw[int(np.argmax(left))].tobytes())
        alike = left.copy()
        for name, at in schema.offsets(lengths)[0].items():
            word = lengths[name].to_bytes(4, "little")
            start = len(CDR_HEADER) + at
            alike &= (raw[:, start : start + 4] == np.frombuffer(word, np.uint8)).all(axis=1)
        if alike.sum() > best.sum():
            best, dtype = alike, schema.dtype(lengths)
        left &= ~alike
    rows = np.frombuffer(data, dtype)
    return (stamps, rows) if best.all() else (stamps[best], rows[best])
