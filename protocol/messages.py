"""The only module that knows the bytes of the wire: messages as ROS 2 CDR, little endian.

The `.msg` files in `msg/` are the schema. For given array lengths the layout of a message is fixed,
so a message owns one aligned buffer: arrays are views into it, scalars are packed and unpacked in
one call. The same bytes travel over the link and go into the log. Offsets:
docs/reference/wire.md.
"""

from __future__ import annotations

import ctypes
import re
import struct
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, cached_property, lru_cache
from importlib import resources
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np
import numpy.typing as npt

from hoap3.protocol.errors import WireError

FloatArray = npt.NDArray[np.float64]

WIRE_VERSION = 2
CDR_HEADER = b"\x00\x01\x00\x00"  # plain CDR, little endian, no options
MAX_JOINTS = 128
MAX_ELEMENTS = 1024  # of an array
LAYOUTS = 64  # that are kept: peers may send messages of any lengths
SCALAR_FORMATS = {"uint32": "I", "uint64": "Q", "int64": "q", "float64": "d"}
_FIELD = re.compile(r"^(?P<type>\w+)(?P<array>\[\])?\s+(?P<name>[a-z]\w*)\s*(?:#.*)?$")
_CONSTANT = re.compile(r"^\w+\s+(?P<name>[A-Z]\w*)=(?P<value>-?\d+)\s*(?:#.*)?$")


@dataclass(frozen=True, eq=False)
class Schema:
    """One `.msg` file: its text, its scalars in order, then its arrays in order."""

    name: str
    text: str
    scalars: dict[str, str]
    arrays: tuple[str, ...]
    constants: dict[str, int]

    @property
    def ros_name(self) -> str:
        """Name of the type as ROS 2 readers know it."""
        return f"hoap3_msgs/msg/{self.name}"

    @property
    def version(self) -> int:
        """What `wire_version` of such a message is; that of an Event is 1."""
        return self.constants.get("WIRE_VERSION", 1)

    @cached_property
    def scalar_struct(self) -> struct.Struct:
        """Every scalar, without padding: the schemas keep each at its natural alignment."""
        return struct.Struct("<" + "".join(SCALAR_FORMATS[kind] for kind in self.scalars.values()))

    @property
    def c_fields(self) -> list[tuple[str, Any]]:
        """The scalars as fields of a C structure, whose layout is the same."""
        types = {kind: getattr(ctypes, f"c_{kind}", ctypes.c_double) for kind in SCALAR_FORMATS}
        return [(name, types[kind]) for name, kind in self.scalars.items()]

    def offsets(self, lengths: dict[str, int]) -> tuple[dict[str, int], int]:
        """Byte offsets behind the CDR header: of each array's length, and of the end.

        A sequence is its length as uint32, then its elements aligned to 8 bytes. An empty one
        has no elements and therefore no padding. Arrays that `lengths` does not name are empty.
        """
        places: dict[str, int] = {}
        end = self.scalar_struct.size
        for array in self.arrays:
            places[array] = end = -(-end // 4) * 4
            end += 4
            if count := lengths.get(array, 0):
                end = -(-end // 8) * 8 + 8 * count
        return places, end

    def dtype(self, lengths: dict[str, int]) -> np.dtype[Any]:
        """Structured dtype of one whole message, CDR header included, for reading many at once."""
        places, end = self.offsets(lengths)
        packed = [(name, "<" + SCALAR_FORMATS[kind]) for name, kind in self.scalars.items()]
        fields: dict[str, Any] = dict(np.dtype(packed).fields or {})
        for name, count in ((name, lengths.get(name, 0)) for name in self.arrays):
            fields[name] = ("<f8", (count,)), _first_element(places[name], count)
        formats, offsets = zip(*fields.values(), strict=True)
        layout: Any = {
            "names": list(fields),
            "formats": formats,
            "offsets": [len(CDR_HEADER) + offset for offset in offsets],
            "itemsize": len(CDR_HEADER) + end,
        }
        dtype: np.dtype[Any] = np.dtype(layout)
        return dtype

    def lengths_in(self, payload: bytes) -> dict[str, int]:
        """Array lengths that one message states; WireError where they disagree with its size."""
        lengths, expected = self.measure(payload)
        if len(payload) != expected:
            raise WireError(
                "size", f"{self.name}: {len(payload)} bytes where {expected} are expected"
            )
        return lengths

    def fits(self, payload: bytes, lengths: tuple[int, ...]) -> bool:
        """Whether a payload is such a message with arrays of these lengths, in their order."""
        layout = _layout(self, lengths)
        frame = layout.frame
        return len(payload) == frame.size and frame.unpack(payload) == layout.expected

    def measure(self, payload: bytes) -> tuple[dict[str, int], int]:
        """Array lengths that the begin of `payload` states, and the size of such a message.

        Raises:
            WireError: it ends before the last length, or one is too large.
        """
        lengths: dict[str, int] = {}
        at = len(CDR_HEADER) + self.scalar_struct.size  # a multiple of four
        for name in self.arrays:
            if at + 4 > len(payload):
                raise WireError("size", f"{self.name}: {len(payload)} bytes end before {name!r}")
            (count,) = struct.unpack_from("<I", payload, at)
            if count > MAX_ELEMENTS:
                raise WireError("size", f"{self.name}: {name!r} claims {count} elements")
            lengths[name] = count
            at = len(CDR_HEADER) + _first_element(at - len(CDR_HEADER), count) + 8 * count
        return lengths, at


@cache
def schema(name: str) -> Schema:
    """The schema of `State`, `Setpoint`, `Event` or `Target`, read from its `.msg` file."""
    file = resources.files("hoap3.protocol") / "msg" / f"{name}.msg"
    text = file.read_text(encoding="utf-8")
    scalars: dict[str, str] = {}
    arrays: list[str] = []
    constants: dict[str, int] = {}
    for line in text.splitlines():
        if constant := _CONSTANT.match(line):
            constants[constant["name"]] = int(constant["value"])
        elif field := _FIELD.match(line):
            if field["array"]:
                arrays.append(field["name"])
            else:
                scalars[field["name"]] = field["type"]
    return Schema(name, text, scalars, tuple(arrays), constants)


class _Layout(NamedTuple):
    """Of a message whose arrays have certain lengths.

    Attributes:
        empty: the buffer of one that is all zeros; the CDR header ends its first word.
        arrays: places of each array's elements in it.
        frame, expected: what is the same in all such messages, and what it is.
    """

    empty: FloatArray
    arrays: dict[str, slice]
    frame: struct.Struct
    expected: tuple[Any, ...]


@lru_cache(maxsize=LAYOUTS)
def _layout(schema: Schema, lengths: tuple[int, ...]) -> _Layout:
    """The layout of a message; `lengths` are those of all arrays, in their order."""
    places, end = schema.offsets(dict(zip(schema.arrays, lengths, strict=True)))
    empty = np.zeros(1 + -(-end // 8))
    payload = empty.data.cast("B")[8 - len(CDR_HEADER) : 8 + end]
    struct.pack_into("<4sI", payload, 0, CDR_HEADER, schema.version)
    arrays, frame, at = {}, "<4sI", 4
    for (name, place), count in zip(places.items(), lengths, strict=True):
        struct.pack_into("<I", payload, len(CDR_HEADER) + place, count)
        frame, at = f"{frame}{place - at}xI", place + 4
        first = (8 + _first_element(place, count)) // 8
        arrays[name] = slice(first, first + count)
    whole = struct.Struct(f"{frame}{end - at}x")
    return _Layout(empty, arrays, whole, whole.unpack(payload))


class Message(ctypes.LittleEndianStructure):
    """A message in one preallocated, writable buffer, aligned for float64.

    The buffer is the message: scalars are attributes that read and write it, arrays are float64
    views of it, and `dump` copies it out. Integers wrap as they do in C.

    Raises:
        WireError: `load` got bytes of another size, header, length or version.
    """

    schema: ClassVar[Schema]
    wire_version: int
    _words: FloatArray
    _bytes: memoryview
    _layout: _Layout

    @classmethod
    def allocate(cls, **lengths: int) -> Self:
        """A message of zeros whose arrays have these lengths; others are empty.

        Raises:
            TypeError: it has no such array.
        """
        if unknown := lengths.keys() - set(cls.schema.arrays):
            raise TypeError(f"{cls.schema.name} has no array {', '.join(sorted(unknown))}")
        layout = _layout(cls.schema, tuple(lengths.get(name, 0) for name in cls.schema.arrays))
        return cls._over(layout.empty.copy(), layout)

    @classmethod
    def _over(cls, words: FloatArray, layout: _Layout) -> Self:
        """The message that `words` are the buffer of."""
        whole = words.data.cast("B")
        message = cls.from_buffer(whole, 8)  # so that both scalars and arrays are aligned
        message._words, message._layout = words, layout
        message._bytes = whole[8 - len(CDR_HEADER) : 8 - len(CDR_HEADER) + layout.frame.size]
        for name, place in layout.arrays.items():
            setattr(message, name, words[place])
        return message

    def __init__(self, *_: int, **__: int) -> None:  # done; ctypes would take them for scalars
        super().__init__()

    @classmethod
    def like(cls, payload: bytes) -> Self:
        """A message of zeros whose arrays are as long as `payload` states.

        Raises:
            WireError: the lengths disagree with its size.
        """
        return cls.allocate(**cls.schema.lengths_in(payload))

    @property
    def lengths(self) -> dict[str, int]:
        """Of its arrays, by name."""
        return {name: len(getattr(self, name)) for name in self.schema.arrays}

    @property
    def size(self) -> int:
        """Bytes on the wire, CDR header included."""
        return self._layout.frame.size

    def load(self, payload: bytes) -> None:
        """Take the content of `payload`. The message is unchanged where that fails."""
        layout = self._layout
        if len(payload) != layout.frame.size or layout.frame.unpack(payload) != layout.expected:
            raise self._refusal(payload)
        self._bytes[:] = payload

    def dump(self) -> bytes:
        """The message as bytes for the wire or the log."""
        return self._bytes.tobytes()

    def copy(self) -> Self:
        """Another message of the same content, whatever another thread loads meanwhile."""
        other = self._over(self._layout.empty.copy(), self._layout)
        other._bytes[:] = self._bytes
        return other

    def _refusal(self, payload: bytes) -> WireError:
        name, size, expected = self.schema.name, self.size, self._layout.expected
        if len(payload) != size:
            return WireError("size", f"{name}: {len(payload)} bytes where {size} are expected")
        header, version, *counts = self._layout.frame.unpack(payload)
        if header != CDR_HEADER or counts != list(expected[2:]):
            return WireError(
                "layout",
                f"{name}: header {header.hex()} and arrays of {counts} elements where "
                f"{CDR_HEADER.hex()} and {list(expected[2:])} are expected",
            )
        spoken = self.schema.version
        return WireError("wire_version", f"{name}: wire version {version} where {spoken} is spoken")

    @classmethod
    def scalars(cls, payload: bytes, *names: str) -> tuple[Any, ...]:
        """Some scalars of a payload, without loading it.

        Raises:
            WireError: it is too short.
        """
        if len(payload) < len(CDR_HEADER) + cls.schema.scalar_struct.size:
            raise WireError("size", f"{cls.schema.name}: {len(payload)} bytes are too few")
        return _reader(cls.schema.name, names)(payload)


class State(Message):
    """What the robot publishes at each tick; units and meaning stand in `msg/State.msg`."""

    schema = schema("State")
    _fields_ = schema.c_fields

    IDLE, ACTIVE, STOPPING, STOPPED = range(4)

    mode: int
    session_id: int
    tick: int
    epoch: int
    epoch_from_tick: int
    stamp_intended: int
    stamp_actual: int
    stamp_published: int
    stamp_sent_previous: int
    skipped: int
    late: int
    lost: int
    duplicate: int
    out_of_order: int
    rejected: int
    success_rate: float
    q: FloatArray
    dq: FloatArray
    tau: FloatArray
    reference: FloatArray
    wrench: FloatArray
    reference_rate: FloatArray
    reference_acceleration: FloatArray
    followed: FloatArray
    base: FloatArray
    contact: FloatArray
    imu: FloatArray

    def __new__(cls, joints: int, wrench: int = 0, **arrays: int) -> Self:
        """Of a robot with `joints` joints, and `wrench` figures from its force sensors.

        Args:
            joints, wrench: see above.
            arrays: lengths of further arrays, by name.
        """
        per_joint = dict.fromkeys(("q", "dq", "tau", "reference"), joints)
        message = cls.allocate(**per_joint, wrench=wrench, **arrays)
        message.followed[:] = -1.0
        return message

    def __repr__(self) -> str:
        names = ("IDLE", "ACTIVE", "STOPPING", "STOPPED")[self.mode : self.mode + 1] or (self.mode,)
        arrays = {name: np.round(getattr(self, name), 4).tolist() for name in self.schema.arrays}
        shown = {"tick": self.tick, "mode": names[0], **arrays}
        return f"State({', '.join(f'{name}={each}' for name, each in shown.items() if each != [])})"


class Setpoint(Message):
    """The controller's answer to one State; see `msg/Setpoint.msg`.

    Attributes:
        certificate: view of `v`, `v_rate_required`, `v_rate_predicted`, `rho`, `margin` and
            `kkt_residual`, (6,), for kernels that write them all.
    """

    schema = schema("Setpoint")
    _fields_ = schema.c_fields

    POSITION, ACCELERATION, TORQUE = range(3)

    command: int
    session_id: int
    tick: int
    epoch: int
    stamp_state: int
    stamp_received: int
    stamp_decoded: int
    stamp_kinematics: int
    stamp_solved: int
    stamp_encoded: int
    stamp_sent_previous: int
    v: float
    v_rate_required: float
    v_rate_predicted: float
    rho: float
    margin: float
    kkt_residual: float
    active_joints: int
    solver_status: int
    solver_path: int
    fallback: int
    values: FloatArray
    extra: FloatArray
    decision: FloatArray
    slacks: FloatArray
    gains: FloatArray
    next: FloatArray
    certificate: FloatArray

    def __new__(cls, joints: int, extra: int = 0, **arrays: int) -> Self:
        """For `joints` joints, with `extra` figures that the controller declares.

        Args:
            joints, extra: see above.
            arrays: lengths of further arrays, by name.
        """
        return cls.allocate(values=joints, extra=extra, **arrays)

    @classmethod
    def _over(cls, words: FloatArray, layout: _Layout) -> Self:
        message = super()._over(words, layout)
        first, last = ((8 + getattr(cls, name).offset) // 8 for name in ("v", "kkt_residual"))
        message.certificate = words[first : last + 1]
        return message


STAMP_FIELDS = frozenset(
    name for name in Setpoint.schema.scalars if name.startswith("stamp_") and name != "stamp_state"
)
"""Fields of a Setpoint that tell when, not what: a replay compares them in lockstep logs only."""

COMMANDS = {
    "position": Setpoint.POSITION,
    "acceleration": Setpoint.ACCELERATION,
    "torque": Setpoint.TORQUE,
}
"""Setpoint.command by the names that descriptions have."""


class Event(Message):
    """Something that is not part of every tick; see `msg/Event.msg`."""

    schema = schema("Event")
    _fields_ = schema.c_fields

    kind: int
    session_id: int
    tick: int
    stamp: int
    detail: int

    def __new__(cls) -> Self:
        """Always of one size."""
        return cls.allocate()


class Target(Message):
    """Where a task shall go; see `msg/Target.msg`."""

    schema = schema("Target")
    _fields_ = schema.c_fields

    target: int
    number: int
    points: int
    dimension: int
    tick_step: int
    session_id: int
    epoch: int
    first_tick: int
    values: FloatArray
    rates: FloatArray

    def __new__(cls, points: int, dimension: int, *, rates: int = 0) -> Self:
        """Of so many points with `dimension` numbers each, and so many of a rate; 0 for none."""
        message = cls.allocate(values=points * dimension, rates=points * rates)
        message.points, message.dimension = points, dimension
        return message


@cache
def _reader(message: str, names: tuple[str, ...]) -> Callable[[bytes], tuple[Any, ...]]:
    """Reads some of a message's scalars out of its payload, and skips the others."""
    kinds = schema(message).scalars
    code = "".join(
        SCALAR_FORMATS[kind] if name in names else f"{struct.calcsize(SCALAR_FORMATS[kind])}x"
        for name, kind in kinds.items()
    )
    read = struct.Struct(f"<{len(CDR_HEADER)}x{code}").unpack_from
    stand = [name for name in kinds if name in names]
    if stand == list(names):
        return read
    places = [stand.index(name) for name in names]
    return lambda payload: tuple(map(read(payload).__getitem__, places))


def _first_element(place: int, count: int) -> int:
    """Offset of a sequence's first element, given the offset of its length."""
    return -(-(place + 4) // 8) * 8 if count else place + 4
