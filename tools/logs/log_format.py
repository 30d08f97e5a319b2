"""What a log holds: its topics, their schemas, and the few messages that are not of our wire.

Every channel is CDR with a `ros2msg` schema, so any ROS 2 reader opens a log. State, Setpoint,
Event and Target are logged as they were sent. All that came in as JSON goes to the topic `inputs`,
as a `std_msgs/msg/String` with the text

    {"kind": "session", "stamp": 123, "repeated": false, "body": {...}}

where `stamp` is the monotonic stamp [ns] of the record and `repeated` marks a copy at the head of
a further file. What cannot be decoded is kept there too: kind `malformed`, body
`{"kind": "setpoint", "base64": "..."}`. `joint_states` is derived from State, for viewers.
"""

from __future__ import annotations

import base64
import json
import re
import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hoap3.protocol.errors import WireError
from hoap3.protocol.messages import CDR_HEADER, Event, Message, Schema, Setpoint, State, Target
from hoap3.protocol.runtime.shm_ring import Kind, Record

PROFILE = "ros2"
FORMAT = "1"  # of what this module lays down
SIDES = ("robot", "controller")
REPEATED = frozenset({Kind.DESCRIPTION, Kind.SESSION, Kind.AUTHORITY, Kind.CONFIG})
"""Kinds of which each file of a log holds the last one of the files before it."""
OF_OTHERS = frozenset({Kind.REQUEST, Kind.TOKEN, Kind.CONFIG})
"""Kinds that tell what others did or are; no loop depends on them."""
MESSAGES: dict[Kind, type[Message]] = {
    Kind.STATE: State,
    Kind.SETPOINT: Setpoint,
    Kind.EVENT: Event,
    Kind.TARGET: Target,
}
"""Kinds that are logged as they were sent."""
SCHEMAS = {kind: message.schema for kind, message in MESSAGES.items()}
TICK = {Kind.STATE: "tick", Kind.SETPOINT: "tick", Kind.EVENT: "tick", Kind.TARGET: "first_tick"}
"""The field of a message that says where in the robot's schedule it belongs."""
SENT_STAMP = {Kind.STATE: "stamp_published", Kind.SETPOINT: "stamp_encoded", Kind.EVENT: "stamp"}
"""The field of a message that holds the sender's stamp, where there is one."""

LATEST_STAMP = 2**31 * 1_000_000_000  # a ROS time has 32 bits of seconds
STRING = "string data\n"
JOINT_STATE = """\
# Joint positions, velocities and efforts, derived from State at 100 Hz for viewers.
std_msgs/Header header
string[] name
float64[] position
float64[] velocity
float64[] effort
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
_INPUT = re.compile(
    r'\{"kind": "(\w+)", "stamp": (-?\d+), "repeated": (true|false), "body": (.*)\}', re.DOTALL
)
_FOREVER = "{sec: 9223372036, nsec: 854775807}"


@dataclass(frozen=True)
class Topic:
    """One channel of a log; its place in `TOPICS`, from 1, is its id in the file."""

    leaf: str
    schema_name: str
    schema_text: str
    latched: bool = False

    @property
    def qos(self) -> str:
        """`offered_qos_profiles` as rosbag2 writes it: reliable, keep last 10, no deadlines."""
        return (
            "- {history: 1, depth: 10, reliability: 1, "
            f"durability: {1 if self.latched else 2}, deadline: {_FOREVER}, "
            f"lifespan: {_FOREVER}, liveliness: 1, liveliness_lease_duration: {_FOREVER}, "
            "avoid_ros_namespace_conventions: false}"
        )


TOPICS = (
    Topic("state", State.schema.ros_name, State.schema.text),
    Topic("setpoint", Setpoint.schema.ros_name, Setpoint.schema.text),
    Topic("events", Event.schema.ros_name, Event.schema.text),
    Topic("inputs", "std_msgs/msg/String", STRING, latched=True),
    Topic("joint_states", "sensor_msgs/msg/JointState", JOINT_STATE),
    Topic("targets", Target.schema.ros_name, Target.schema.text),
)
LEAST_TOPICS = 5  # as many have logs of wire version 1
CHANNELS = {topic.leaf: place for place, topic in enumerate(TOPICS, 1)}
KIND_CHANNELS = {
    Kind.STATE: CHANNELS["state"],
    Kind.SETPOINT: CHANNELS["setpoint"],
    Kind.EVENT: CHANNELS["events"],
    Kind.TARGET: CHANNELS["targets"],
}
_KINDS = {channel: kind for kind, channel in KIND_CHANNELS.items()}


def topic_name(robot: str, leaf: str) -> str:
    """Full name of a topic."""
    return f"/robots/{robot}/{leaf}"


def file_name(side: str, part: int) -> str:
    """`robot.mcap`, `robot.0001.mcap`, … as `part` counts from 0."""
    return f"{side}.{part:04d}.mcap" if part else f"{side}.mcap"


def pack_string(text: str) -> bytes:
    """`std_msgs/msg/String` as CDR."""
    raw = text.encode()
    return CDR_HEADER + struct.pack("<I", len(raw) + 1) + raw + b"\0"


def unpack_string(payload: bytes) -> str:
    """Text of a `std_msgs/msg/String`.

    Raises:
        ValueError: `payload` is none.
    """
    if payload[:4] != CDR_HEADER or payload[-1:] != b"\0" or len(payload) < 9:
        raise ValueError("not a std_msgs/msg/String")
    if int.from_bytes(payload[4:8], "little") != len(payload) - 8:
        raise ValueError("not a std_msgs/msg/String")
    return payload[8:-1].decode()


def pack_input(record: Record, *, repeated: bool = False) -> bytes:
    """A record for the topic `inputs`. Its JSON is kept to the byte; what is none, as base64."""
    kind = record.kind.name.lower()
    try:
        if record.kind in SCHEMAS:
            raise ValueError("a message that is none")
        body = record.payload.decode()
        json.loads(body)
    except (ValueError, RecursionError):
        encoded = base64.b64encode(record.payload).decode()
        kind, body = "malformed", json.dumps({"kind": kind, "base64": encoded})
    flag = "true" if repeated else "false"
    return pack_string(
        f'{{"kind": "{kind}", "stamp": {record.stamp}, "repeated": {flag}, "body": {body}}}'
    )


def pack_gap(size: int, stamp: int) -> bytes:
    """What stands for `size` damaged bytes of a log; `stamp` [ns] is of the newest record before.

    How many records they were is not known.
    """
    return pack_input(Record(Kind.GAP, stamp, b'{"dropped": 0, "damaged_bytes": %d}' % size))


def unpack_input(payload: bytes) -> tuple[Record, bool]:
    """The record that `pack_input` took, and whether it is a repetition.

    Raises:
        ValueError: none that `pack_input` made.
    """
    match = _INPUT.fullmatch(unpack_string(payload))
    if match is None:
        raise ValueError("not the expected JSON")
    kind, stamp, flag, body = match.groups()
    raw = body.encode()
    try:
        if kind == "malformed":
            content = json.loads(body)
            kind, raw = str(content["kind"]), base64.b64decode(content["base64"], validate=True)
        if not -(2**63) <= int(stamp) < 2**63:
            raise ValueError("a stamp that is out of range")
        return Record(Kind[kind.upper()], int(stamp), raw), flag == "true"
    except (KeyError, TypeError, RecursionError) as error:
        raise ValueError(f"not the expected content: {error!r:.80}") from error


def unpack_message(channel: int, stamp: int, payload: bytes) -> tuple[Record | None, bool]:
    """The record of a message, and whether it is a repetition; None: copies for viewers, others.

    Raises:
        ValueError: an input that `pack_input` did not make.
    """
    kind = _KINDS.get(channel)
    if kind is not None:
        return Record(kind, stamp, payload), False
    return unpack_input(payload) if channel == CHANNELS["inputs"] else (None, False)


class Layout:
    """The layout of the newest message of a kind, and whether others have it.

    Args:
        schema: of the messages.

    Attributes:
        size: bytes of the messages that the last one learnt is like; -1 for none.
    """

    def __init__(self, schema: Schema) -> None:
        self.schema, self.size = schema, -1
        self._guards: Callable[[bytes], tuple[Any, ...]] = tuple
        self._expected: tuple[Any, ...] = ()

    def fits(self, payload: bytes) -> bool:
        """Whether size, CDR header and the lengths of all arrays are those of the last learnt."""
        return len(payload) == self.size and self._guards(payload) == self._expected

    def learn(self, payload: bytes) -> dict[str, int]:
        """Take the layout of `payload`, and return the lengths of its arrays.

        Raises:
            WireError: not a message of this kind.
        """
        if payload[:4] != CDR_HEADER:
            raise WireError("layout", f"{self.schema.name}: no CDR header of ours")
        lengths = self.schema.lengths_in(payload)
        counts, _ = self.schema.offsets(lengths)
        self.size = len(payload)
        places = {len(CDR_HEADER) + at: "I" for at in counts.values()}
        self._guards = self.reader({0: "4s", **places})
        self._expected = (CDR_HEADER, *lengths.values())
        return lengths

    def reader(self, places: dict[int, str]) -> Callable[[bytes], tuple[Any, ...]]:
        """Return what reads the values at some offsets, given in rising order."""
        code, end = "<", 0
        for at, item in places.items():
            code += f"{at - end}x{item}"
            end = at + struct.calcsize("<" + item)
        return struct.Struct(f"{code}{self.size - end}x").unpack


class JointStates:
    """Packs `sensor_msgs/msg/JointState` from the bytes of a State.

    Args:
        names: joint names in wire order.

    The names are packed once, with what stands before and behind them; each message then is a
    stamp and three copies.
    """

    def __init__(self, names: Sequence[str]) -> None:
        self.n = len(names)
        body = bytearray(struct.pack("<iIIB", 0, 0, 1, 0))  # stamp; empty frame_id
        _append_count(body, self.n)
        for name in names:
            raw = name.encode() + b"\0"
            _append_count(body, len(raw))
            body += raw
        _append_count(body, self.n)
        body += bytes(-len(body) % 8)
        self._names = bytes(body[8:])
        self._between = struct.pack("<II", self.n, 0)  # count, and padding to 8
        self._slices: tuple[slice, ...] | None = None

    def learn(self, dtype: np.dtype[Any], lengths: dict[str, int]) -> None:
        """Take the layout of the States to come; one of another robot gives no joint states."""
        self._slices = None
        fields = dtype.fields
        if fields is not None and all(lengths[name] == self.n for name in ("q", "dq", "tau")):
            starts = [int(fields[name][1]) for name in ("q", "dq", "tau")]
            self._slices = tuple(slice(at, at + 8 * self.n) for at in starts)

    def pack(self, state: bytes, stamp: int) -> bytes | None:
        """The message with `stamp` [ns] in its header; None where the State does not fit."""
        if self._slices is None or not 0 <= stamp < LATEST_STAMP:
            return None
        q, dq, tau = self._slices
        time = struct.pack("<iI", *divmod(stamp, 1_000_000_000))
        parts = (CDR_HEADER, time, self._names, state[q], self._between, state[dq])
        return b"".join((*parts, self._between, state[tau]))


def _append_count(body: bytearray, count: int) -> None:
    body += bytes(-len(body) % 4) + struct.pack("<I", count)
