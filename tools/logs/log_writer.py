"""Writes what an observer reads from its ring into MCAP files that every ROS 2 reader opens.

A chunk is cut, and handed to the operating system, before it spans half a second of log time or of
wall time: who kills the observer loses less than one second. Why the chunks are our own work and
not the library's stands in `hoap3.tools.logs.mcap_write`.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Self

from mcap.records import Attachment, Channel, Metadata
from mcap.records import Schema as McapSchema

from hoap3.protocol import __version__
from hoap3.protocol.errors import DescriptionError, WireError
from hoap3.protocol.messages import WIRE_VERSION
from hoap3.protocol.robot.description import RobotDescription
from hoap3.protocol.runtime.shm_ring import Kind, Record
from hoap3.tools.logs.files import LockedFolder
from hoap3.tools.logs.log_format import (
    CHANNELS,
    FORMAT,
    KIND_CHANNELS,
    PROFILE,
    REPEATED,
    SCHEMAS,
    SENT_STAMP,
    TICK,
    TOPICS,
    JointStates,
    Layout,
    file_name,
    pack_input,
    topic_name,
)
from hoap3.tools.logs.mcap_write import McapFile

CHUNK_BYTES = 1 << 20
SPAN_NS = 500_000_000  # of a chunk, in log time and in wall time
BACK_NS = 100_000_000  # of it, for stamps that are older than the first one of a chunk
JOINT_STATE_NS = 10_000_000
_MEDIA_TYPES = {
    ".json": "application/json",
    ".urdf": "application/xml",
    ".yaml": "application/yaml",
    ".txt": "text/plain",
}


def topics(robot: str) -> dict[int, tuple[McapSchema, Channel]]:
    """Schema and channel of each topic of a robot's log, by their number."""
    found = {}
    for place, topic in enumerate(TOPICS, 1):
        schema = McapSchema(place, topic.schema_text.encode(), "ros2msg", topic.schema_name)
        name, qos = topic_name(robot, topic.leaf), {"offered_qos_profiles": topic.qos}
        found[place] = schema, Channel(place, name, "cdr", qos, place)
    return found


class LogWriter:
    """The log of one side of a run, in one file or several.

    A full file is followed by a further one that stands by itself: `robot.mcap`,
    `robot.0001.mcap`, … Where all of them would exceed the cap, the oldest are deleted, and the
    metadata `log` of the next file says which.

    Args:
        path: the first file, `*.mcap`, or the folder where it becomes `<side>.mcap`.
        robot: name of the robot, which stands in the topics.
        side: "robot" or "controller": whose records these are.
        attachments: files to enclose, by name; `config.yaml` is the one that replay needs.
        metadata: facts by group. The groups `log`, `clock` and `end` are the writer's own.
        cap_bytes: of all files together.
        file_bytes: of one file; at most half the cap.
        compress: chunks with zstd.
        now: monotonic wall time [ns].

    Raises:
        UsageError: a file exists already, or cannot be made.
        OSError: a write failed, such as for want of space; what `add` was given since the last
            chunk is lost, everything before it stays, and more can be added.
    """

    def __init__(
        self,
        path: Path,
        *,
        robot: str,
        side: str,
        attachments: Mapping[str, bytes],
        metadata: Mapping[str, Mapping[str, str]],
        cap_bytes: int = 1_000_000_000,
        file_bytes: int = 250_000_000,
        compress: bool = True,
        now: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        if path.suffix != ".mcap":
            path = path / file_name(side, 0)
        self._first, self._robot, self._side, self._compress = path, robot, side, compress
        self._cap_bytes, self._now = cap_bytes, now
        self._file_bytes = min(file_bytes, cap_bytes // 2)
        self._chunk_bytes = min(CHUNK_BYTES, self._file_bytes // 8)
        self._attachments = dict(attachments)
        self._clock = _read_clocks()
        self._metadata = {**metadata, "clock": {key: str(ns) for key, ns in self._clock.items()}}
        self._sizes: dict[Path, int] = {}
        self._deleted: list[str] = []
        self._part = 0
        self._last: dict[Kind, Record] = {}
        self._lanes = {kind: _Lane(kind, channel) for kind, channel in KIND_CHANNELS.items()}
        self._state_lane = self._lanes[Kind.STATE]
        self._joint_states: JointStates | None = None
        self._joint_tick = -1
        self._since, self._until = 1, 0  # log time of the chunk at hand: nothing fits
        self._opened = 0  # its begin in wall time
        self._added = 0
        self._closed = False
        self._file = self._begin_file()
        self._folder = LockedFolder(path.parent)

    @property
    def paths(self) -> list[Path]:
        """The files that exist, oldest first."""
        return [*self._sizes, self._file.path] if not self._closed else list(self._sizes)

    @property
    def size(self) -> int:
        """Bytes of these files that were handed to the operating system."""
        sizes, file = self._sizes.copy(), self._file
        return sum({**sizes, file.path: file.size}.values())

    def add(self, record: Record) -> None:
        """Take one record, not older than time 0; reading gives it back, whatever its payload."""
        stamp, payload = record.stamp, record.payload
        if not self._since <= stamp < self._until or len(self._file.chunk) >= self._chunk_bytes:
            self._begin_chunk(stamp)
        lane = self._lanes.get(record.kind)
        if lane is None or not (lane.fits(payload) or self._learn(lane, payload)):
            self._add_input(record)
            return
        tick, *told = lane.fields(payload)
        sent = told[0] if told else stamp
        self._file.message(lane.channel, tick, stamp, sent, payload)
        if lane is self._state_lane and sent // JOINT_STATE_NS != self._joint_tick:
            self._add_joint_state(stamp, tick, sent, payload)
        self._added += 1
        if not self._added & 63:
            self.flush_due(self._now())

    def flush_due(self, now_ns: int) -> None:
        """Cut the chunk at hand if it is old; call it now and then while nothing is added.

        Args:
            now_ns: monotonic wall time.
        """
        if self._file.chunk and now_ns - self._opened >= SPAN_NS:
            self._cut()

    def close(self) -> None:
        """Finish the file at hand. Once is enough, twice does no harm."""
        if not self._closed:
            self._closed = True
            try:
                self._finish_file(continues=False)
            finally:
                self._folder.free()

    def abandon(self) -> None:
        """Leave the file at hand cut off as it is, after a write that failed; for `close`."""
        if not self._closed:
            self._closed = True
            self._sizes[self._file.path] = self._file.size
            self._file.abandon()
            self._folder.free()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _cut(self) -> None:
        self._since, self._until = 1, 0
        self._file.cut()

    def _begin_chunk(self, stamp: int) -> None:
        self._cut()
        if self._file.size + 2 * self._chunk_bytes >= self._file_bytes:
            self._finish_file(continues=True)
            self._part += 1
            self._make_room()
            self._file = self._begin_file()
            for record in self._last.values():
                data = pack_input(record, repeated=True)
                self._file.message(CHANNELS["inputs"], 0, stamp, record.stamp, data)
        self._since, self._until = stamp - BACK_NS, stamp - BACK_NS + SPAN_NS
        self._opened = self._now()

    def _learn(self, lane: _Lane, payload: bytes) -> bool:
        """Adopt the layout of this message; False where it is none."""
        try:
            lengths = lane.learn(payload)
        except WireError:
            return False
        if lane is self._state_lane and self._joint_states is not None:
            self._joint_states.learn(lane.schema.dtype(lengths), lengths)
        return True

    def _add_joint_state(self, stamp: int, tick: int, sent: int, state: bytes) -> None:
        self._joint_tick = sent // JOINT_STATE_NS
        if self._joint_states is None:
            return
        data = self._joint_states.pack(state, sent)
        if data is not None:
            self._file.message(CHANNELS["joint_states"], tick, stamp, sent, data)

    def _add_input(self, record: Record) -> None:
        if record.kind == Kind.DESCRIPTION:
            self._describe(record)
        if record.kind in REPEATED:
            self._last.pop(record.kind, None)
            self._last[record.kind] = record
        stamp = max(record.stamp, 0)
        self._file.message(CHANNELS["inputs"], 0, stamp, stamp, pack_input(record))

    def _describe(self, record: Record) -> None:
        """Enclose a new description, and name joint states by it."""
        if self._attachments.get("description.json") == record.payload:
            return
        enclosed = {"description.json": record.payload}
        self._joint_states = None
        try:
            description = RobotDescription.from_json(record.payload)
        except DescriptionError:
            pass  # it is in the log as it came; nothing can be derived from it
        else:
            enclosed["robot.urdf"] = description.urdf.encode()
            self._joint_states = JointStates(description.joint_names)
            self._state_lane.size = -1  # the next State shows its layout
        self._attachments.update(enclosed)
        for name, data in enclosed.items():
            self._attach(self._file, name, data)

    def _attach(self, file: McapFile, name: str, data: bytes) -> None:
        media_type = _MEDIA_TYPES.get(Path(name).suffix, "application/octet-stream")
        created, logged = self._clock["realtime_ns"], self._clock["monotonic_ns"]
        file.add(Attachment(created, logged, name, media_type, data))

    def _begin_file(self) -> McapFile:
        path = self._first
        if self._part:
            path = path.with_name(file_name(path.stem, self._part))
        file = McapFile(path, PROFILE, f"hoap3 {__version__}", compress=self._compress)
        log = {
            "format": FORMAT,
            "wire_version": str(WIRE_VERSION),
            "robot": self._robot,
            "side": self._side,
            "part": str(self._part),
            "deleted": ", ".join(self._deleted),
            "cap_bytes": str(self._cap_bytes),
        }
        for name, facts in {**self._metadata, "log": log}.items():
            file.add(Metadata(name, dict(facts)))
        for name, data in self._attachments.items():
            self._attach(file, name, data)
        for schema, channel in topics(self._robot).values():
            file.add(schema)
            file.add(channel)
        file.flush()
        return file

    def _finish_file(self, *, continues: bool) -> None:
        try:
            self._file.add(Metadata("end", {"continues": str(continues).lower()}))
        finally:
            self._file.finish()
            self._sizes[self._file.path] = self._file.size

    def _make_room(self) -> None:
        while self._sizes and sum(self._sizes.values()) + self._file_bytes > self._cap_bytes:
            path = next(iter(self._sizes))
            path.unlink(missing_ok=True)
            del self._sizes[path]
            self._deleted.append(path.name)


class _Lane(Layout):
    """How messages of one kind look, as far as their entry in the log needs it.

    Attributes:
        fields: message → tick (its lower 32 bits), and the sender's stamp if it has one.
    """

    def __init__(self, kind: Kind, channel: int) -> None:
        super().__init__(SCHEMAS[kind])
        self.channel, self._named = channel, {TICK[kind]: "I"}
        if kind in SENT_STAMP:
            self._named[SENT_STAMP[kind]] = "Q"
        self.fields: Callable[[bytes], tuple[Any, ...]] = tuple

    def learn(self, payload: bytes) -> dict[str, int]:
        """Take the layout of `payload`, and return the lengths of its arrays."""
        lengths = super().learn(payload)
        fields: Any = self.schema.dtype(lengths).fields
        self.fields = self.reader({int(fields[name][1]): c for name, c in self._named.items()})
        return lengths


def _read_clocks() -> dict[str, int]:
    """Monotonic and wall clock, taken together: the monotonic one is read before and after."""
    before = time.monotonic_ns()
    realtime = time.time_ns()
    after = time.monotonic_ns()
    return {"monotonic_ns": (before + after) // 2, "realtime_ns": realtime}
