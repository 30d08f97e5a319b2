"""Reads a log: whole or cut off, one file or several, as the records that were written.

What a log says about files or code is never followed; names in it are keys, no more.
"""

from __future__ import annotations

import hashlib
import json
import shlex
import struct
from bisect import bisect_right
from collections import OrderedDict
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from functools import cached_property
from itertools import accumulate, product
from pathlib import Path
from typing import Any, NamedTuple, Self, TypeVar

import numpy as np
import numpy.typing as npt

from hoap3.protocol.config.settings import parse_yaml
from hoap3.protocol.errors import ConfigError, DescriptionError, LogError, WireError
from hoap3.protocol.messages import Setpoint, State
from hoap3.protocol.robot.description import RobotDescription
from hoap3.protocol.runtime.shm_ring import Kind, Record
from hoap3.tools.logs.disk_rows import DiskRecords, MessageTable
from hoap3.tools.logs.log_files import (
    check_ours,
    describe_damages,
    files_of,
    lost_at_begin,
    unbroken,
)
from hoap3.tools.logs.log_format import (
    CHANNELS,
    OF_OTHERS,
    SCHEMAS,
    SIDES,
    pack_gap,
    unpack_message,
)
from hoap3.tools.logs.mcap_scan import Damage, McapMessage, McapScan

Rows = npt.NDArray[Any]
Stamps = npt.NDArray[np.int64]

NEVER_OURS = (
    *(WireError, LookupError, TypeError, ValueError),
    *(ArithmeticError, AttributeError, RecursionError),
)
"""What reading a record may raise that no service of ours has written."""

KEPT = 4  # unpacked chunks, of some 1 MiB each
Loaded = TypeVar("Loaded", State, Setpoint)

_TABLES = (Kind.STATE, Kind.SETPOINT, Kind.EVENT)


class Moment(NamedTuple):
    """A State of a log, its answer, and the log times of both [ns]; None where there is none."""

    state: State
    stamp: int
    setpoint: Setpoint | None
    answered: int | None


class Log:
    """One side of a run.

    Where a file is cut off or missing, the log ends, even if further files exist; those can be
    opened by themselves. Damaged chunks of a file are skipped, and `missing` names them.

    Args:
        scans: the files, oldest first.
        lost: what is lost behind them; None for nothing.

    Attributes:
        scans, paths: the files, oldest first.
        robot, side: whose log it is.
        metadata: facts by group; of several files, the last one that says something.
        attachments: enclosed files by name, the last one of each.
        truncated: it ends early.
        from_begin: the first file that was written is there.
        damages: what cannot be read inside it, in words, "" for nothing.
        missing: what is lost, in words, "" for nothing.
        held, unreadable: messages of each kind that `table` last gave, and had to leave out.
        unread: what `chunk` could not read so far: (chunk, place in it), None for all of a chunk.
    """

    def __init__(self, scans: list[McapScan], lost: str | None = None) -> None:
        self.scans, self.truncated = scans, lost is not None
        self.paths = [scan.path for scan in scans]
        self.metadata = {name: f for scan in scans for name, f in scan.metadata.items()}
        self.attachments = {name: data for scan in scans for name, data in scan.attachments.items()}
        first = scans[0].metadata["log"]
        self.robot, self.side = first["robot"], first["side"]
        before = lost_at_begin(self.paths[0], first, self.metadata["log"])
        self.from_begin = before is None
        damages = [(scan, damage) for scan in scans for damage in scan.damages]
        repaired = [scan.metadata.get("repair", {}).get("damaged", "") for scan in scans]
        doubts = [f"{scan.path.name}: {what}" for scan in scans for what in scan.doubts]
        named = (*describe_damages(damages, self._begin), *doubts, *repaired)
        self.damages = "; ".join(filter(None, named))
        self.missing = "; ".join(filter(None, (before, self.damages, lost)))
        self._unpacked: DiskRecords | None = None
        self.held: dict[Kind, int] = {}
        self.unreadable: dict[Kind, int] = {}
        self._chunks = [
            (scan, place, span) for scan in scans for place, span in enumerate(scan.spans)
        ]
        self._kept: OrderedDict[int, list[Record]] = OrderedDict()
        self.unread = set[tuple[int, int | None]]()

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
        log = cls(*unbroken(files_of(Path(path), side)))
        if side not in {None, log.side}:
            raise LogError(f"{path}: is the log of the {log.side}. Name that of the {side}")
        return log

    @classmethod
    def indexed(cls, path: Path, side: str | None = None) -> Log:
        """Open a log without a look into its chunks: any moment of it within milliseconds.

        Memory does not grow with the log. A damaged chunk is found when it is read.

        Args:
            path, side: as for `open`.

        Raises:
            LogError: as for `open`, or a log without any message.
        """
        scans = [McapScan.of(file, verify=False) for file in files_of(path, side)]
        for scan in scans:
            check_ours(scan)
        log = cls(scans)
        if not log.chunks:
            raise LogError(f"{path}: holds no message. Name a log of `hoap3`")
        return log

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

    @cached_property
    def others(self) -> int:
        """How many messages lie on topics that are not ours."""
        foreign = [scan for scan in self.scans if 0 in scan.ids.values()]
        return sum(message[0] == 0 for scan in foreign for message in scan.messages())

    @property
    def chunks(self) -> int:
        """How many chunks there are."""
        return len(self._chunks)

    @property
    def begin(self) -> int:
        """Log time of the oldest message [ns]."""
        return min(span[0] for _, _, span in self._chunks)

    @property
    def end(self) -> int:
        """Log time of the newest message [ns]."""
        return max(span[1] for _, _, span in self._chunks)

    @property
    def _begin(self) -> int:
        """Log time of its first message [ns], or 0."""
        return next((scan.begin for scan in self.scans if scan.begin is not None), 0)

    @cached_property
    def session(self) -> dict[str, Any]:
        """What its first session states; empty where there is none that can be read."""
        found = next(self.records(Kind.SESSION), None)
        with suppress(ValueError, RecursionError):
            content = json.loads(found.payload) if found is not None else {}
            return content if isinstance(content, dict) else {}
        return {}

    def names(self, key: str) -> list[str]:
        """Names that its first session gives: `extra` columns, or `conditions`."""
        found = self.session.get(key)
        return [str(name) for name in found] if isinstance(found, list) else []

    def records(self, *kinds: Kind) -> Iterator[Record]:
        """Every record in the order in which it was processed; copies for viewers left out.

        In the place of what is damaged stands a record of kind GAP.

        Args:
            kinds: only records of these; none for all.

        Raises:
            LogError: a record of another version.
        """
        if self._unpacked is not None:
            return self._unpacked.read(kinds)
        return (record for record in self._read() if not kinds or record.kind in kinds)

    def _read(self, say: Callable[[str], None] = lambda _: None) -> Iterator[Record]:
        for place, scan in enumerate(self.scans):
            for channel, _, stamp, _, payload in _with_gaps(scan, say):
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
        table = self._tables()[kind]
        stamps, rows = table.rows
        self.held[kind], self.unreadable[kind] = len(rows), table.unreadable
        if table.unreadable and not len(rows):
            raise LogError(
                f"{self.paths[0]}: none of its {table.unreadable} messages of kind {kind.name} can "
                "be read. Read the log with the version that wrote it"
            )
        return stamps, rows

    def messages(self, kind: Kind, rows: npt.NDArray[np.int64]) -> Iterator[bytes]:
        """Messages as they were logged, by their numbers in `table`."""
        return self._tables()[kind].messages(rows)

    def load(self, say: Callable[[str], None] = lambda _: None) -> Self:
        """Unpack the log once, into temporary files that all later reads use.

        Args:
            say: takes progress.
        """
        self._tables(say)
        return self

    def _tables(self, say: Callable[[str], None] = lambda _: None) -> dict[Kind, MessageTable]:
        if self._unpacked is None:
            schemas = {kind: SCHEMAS[kind] for kind in _TABLES}
            self._unpacked = DiskRecords(self._read(say), schemas)
        return self._unpacked.tables

    def count(self, kind: Kind) -> int:
        """How many messages of a kind `table` has; 0 where the log is not loaded."""
        return len(self._unpacked.tables[kind]) if self._unpacked is not None else 0

    def states(self) -> Rows:
        """Every State, as a structured array with the field names of `State.msg`."""
        return self.table(Kind.STATE)[1]

    def setpoints(self) -> Rows:
        """Every Setpoint as such an array."""
        return self.table(Kind.SETPOINT)[1]

    def stamps(self, kind: Kind) -> Stamps:
        """Log times [ns] of the rows that `table` gives."""
        return self.table(kind)[0]

    def chunk(self, number: int, *, keep: bool = True) -> list[Record]:
        """The records of one chunk in their order; those of a damaged one are lost.

        Args:
            number: its place, from 0.
            keep: whether it may be asked for again soon.
        """
        found = self._kept.get(number)
        if found is None:
            found = self._read_chunk(number)
            if keep:
                self._kept[number] = found
                if len(self._kept) > KEPT:
                    self._kept.popitem(last=False)
        elif keep:
            self._kept.move_to_end(number)
        return found

    def state_at(self, stamp: int) -> Moment | None:
        """The last State up to a log time [ns], and the Setpoint that answers it.

        Returns:
            None where there is no State up to then.
        """
        for number in range(max(bisect_right(self._firsts, stamp) - 1, 0), -1, -1):
            for record in reversed(self.chunk(number)):
                if record.kind == Kind.STATE and record.stamp <= stamp:
                    state = _loaded(State, record.payload)
                    if state is not None:
                        return Moment(state, record.stamp, *self._answer(state, number))
        return None

    @cached_property
    def _firsts(self) -> list[int]:
        """Log times of the first messages of each chunk [ns], rising, whatever a file claims."""
        return list(accumulate((span[0] for _, _, span in self._chunks), max))

    def _answer(self, state: State, number: int) -> tuple[Setpoint | None, int | None]:
        for place in range(number, min(number + 2, self.chunks)):
            for record in self.chunk(place):
                if record.kind != Kind.SETPOINT:
                    continue
                try:
                    tick, session = Setpoint.scalars(record.payload, "tick", "session_id")
                except WireError:
                    continue
                if (tick, session) == (state.tick, state.session_id):
                    return _loaded(Setpoint, record.payload), record.stamp
        return None, None

    def _read_chunk(self, number: int) -> list[Record]:
        scan, place, _ = self._chunks[number]
        try:
            messages = scan.chunk(place)
        except (LogError, OSError):  # also a deleted file, as of a log that rotates
            self.unread.add((number, None))
            return []
        found = []
        for at, (channel, _, stamp, _, payload) in enumerate(messages):
            try:
                record, _ = unpack_message(channel, stamp, payload)
            except ValueError:
                self.unread.add((number, at))  # of a version that is not known
                continue
            if record is not None:
                found.append(record)
        return found


def _loaded(kind: type[Loaded], payload: bytes) -> Loaded | None:
    try:
        message = kind.like(payload)
        message.load(payload)
    except WireError:
        return None
    return message


def open_sides(*paths: Path) -> tuple[dict[str, Log], dict[str, str]]:
    """Open the logs of a session, one a side: of the folder of a run, or of each service's own.

    Args:
        paths: folders, or `*.mcap`.

    Returns:
        The logs by side, the robot's first, and why others that are there cannot be read.

    Raises:
        LogError: there is no log that can be read, two of one side, or none of a common session.
    """
    opened: dict[str, list[Log]] = {}
    unreadable: dict[str, str] = {}
    last: LogError | None = None
    for path in paths:
        for side in SIDES if path.is_dir() else (None,):
            try:
                log = Log.open(path, side)
            except LogError as error:
                last = error
                if side is None:
                    raise
                if any(path.glob(f"{side}*.mcap")):
                    unreadable[side] = str(error)
                continue
            opened.setdefault(log.side, []).append(log)
    if any(len(each) > 1 for each in opened.values()):
        raise LogError(_several_logs(opened))
    logs = {side: each[0] for side, each in opened.items()}
    if not logs and last is not None:
        for side, why in unreadable.items():
            raise LogError(f"The log of the {side} cannot be read: {why}")
        raise last
    if len(paths) > 1 and not _share_session(tuple(logs.values())):
        raise LogError(f"{paths[1]}: has no session in common with {paths[0]}")
    return {side: logs[side] for side in SIDES if side in logs}, unreadable


def _share_session(logs: Sequence[Log]) -> bool:
    """Whether one session of the robot is in each of these logs; True for a single log."""
    sessions = [
        {json.loads(each.payload).get("session_id") for each in log.records(Kind.SESSION)}
        for log in logs
    ]
    return len(logs) < 2 or bool(set.intersection(*sessions))


def _several_logs(opened: Mapping[str, Sequence[Log]]) -> str:
    """Which logs are of one side, as after a restart, and a command for each pair of a session."""
    sides = [opened[side] for side in SIDES if side in opened]
    several = max(sides, key=len)
    names = " and ".join(map(_place, several))
    commands = [
        f"hoap3 report {shlex.join(map(_place, pair))} --out report_{number}.html"
        for number, pair in enumerate(filter(_share_session, product(*sides)), 1)
    ]
    remedy = "Name one log of each side"
    if commands:
        remedy = f"Write one report each: {' and '.join(f'`{each}`' for each in commands)}"
    return (
        f"{names} are all logs of a {several[0].side}, and a report is of one log of each side. "
        f"{remedy}"
    )


def _place(log: Log) -> str:
    """The file of a log, or the folder of its files."""
    return str(log.paths[0] if len(log.paths) == 1 else log.paths[0].parent)


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


def _with_gaps(scan: McapScan, say: Callable[[str], None]) -> Iterator[McapMessage]:
    """The messages of a file; for each damage an input of kind GAP."""
    newest = scan.begin or 0
    for number, part in enumerate(scan.parts()):
        say(f"reading {scan.path.name}, {100 * number // scan.part_count} %")
        if isinstance(part, Damage):
            gap = pack_gap(part.size, part.after or newest)
            yield CHANNELS["inputs"], 0, part.after or newest, part.after or newest, gap
        else:
            yield from part
