"""The only module that knows bytes: messages as ROS 2 CDR, little endian.

The `.msg` files in `msg/` are the schema. For given array lengths the layout of a message is
fixed, so a message owns one aligned buffer: arrays are views into it, scalars are packed and
unpacked in one call. The same bytes travel over the link and go into the log.
docs/wire.md gives the offsets.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, cached_property
from importlib import resources
from operator import attrgetter, itemgetter
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from protocol.errors import WireError

FloatArray = npt.NDArray[np.float64]

WIRE_VERSION = 1
CDR_HEADER = b"\x00\x01\x00\x00"  # plain CDR, little endian, no options
MAX_JOINTS = 128
SCALAR_FORMATS = {"uint32": "I", "uint64": "Q", "int64": "q", "float64": "d"}
STAMP_FIELDS = frozenset(
    {
        "stamp_received",
        "stamp_decoded",
        "stamp_kinematics",
        "stamp_solved",
        "stamp_encoded",
        "stamp_sent_previous",
    }
)
"""Fields of a Setpoint that tell when, not what: a replay compares them in lockstep logs only."""

_FIELD = re.compile(r"^(?P<type>\w+)(?P<array>\[\])?\s+(?P<name>[a-z]\w*)\s*(?:#.*)?$")
_CONSTANT = re.compile(r"^\w+\s+(?P<name>[A-Z]\w*)=(?P<value>-?\d+)\s*(?:#.*)?$")


@dataclass(frozen=True)
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

    @cached_property
    def scalar_struct(self) -> struct.Struct:
        """Every scalar, without padding: the schemas keep each at its natural alignment."""
        return struct.Struct("<" + "".join(SCALAR_FORMATS[kind] for kind in self.scalars.values()))

    def offsets(self, lengths: dict[str, int]) -> tuple[dict[str, int], int]:
        """Byte offsets behind the CDR header: of each array's length, and of the end.

        A sequence is its length as uint32, then its elements aligned to 8 bytes. An empty one
        has no elements and therefore no padding.
        """
        places: dict[str, int] = {}
        end = self.scalar_struct.size
        for array in self.arrays:
            places[array] = end = -(-end // 4) * 4
            end += 4
            if lengths[array]:
                end = -(-end // 8) * 8 + 8 * lengths[array]
        return places, end

    def dtype(self, lengths: dict[str, int]) -> np.dtype[Any]:
        """Structured dtype of one whole message, CDR header included, for reading many at once."""
        places, end = self.offsets(lengths)
        names, formats, offsets = [], [], []
        at = len(CDR_HEADER)
        for name, kind in self.scalars.items():
            item = np.dtype("<" + SCALAR_FORMATS[kind])
            names.append(name)
            formats.append(item)
            offsets.append(at)
            at += item.itemsize
        for name in self.arrays:
            names.append(name)
            formats.append(np.dtype(("<f8", (lengths[name],))))
            offsets.append(len(CDR_HEADER) + _first_element(places[name], lengths[name]))
        layout: Any = {
            "names": names,
            "formats": formats,
            "offsets": offsets,
            "itemsize": len(CDR_HEADER) + end,
        }
        dtype: np.dtype[Any] = np.dtype(layout)
        return dtype

    def lengths_in(self, payload: bytes) -> dict[str, int]:
        """Array lengths that one message states; WireError where they disagree with its size."""
        lengths: dict[str, int] = {}
        for name in self.arrays:
            known = {other: lengths.get(other, 0) for other in self.arrays}
            at = len(CDR_HEADER) + self.offsets(known)[0][name]
            if at + 4 > len(payload):
                raise WireError("size", f"{self.name}: {len(payload)} bytes end before {name!r}")
            (lengths[name],) = struct.unpack_from("<I", payload, at)
            if lengths[name] > 8 * MAX_JOINTS:
                raise WireError("size", f"{self.name}: {name!r} claims {lengths[name]} elements")
        expected = len(CDR_HEADER) + self.offsets(lengths)[1]
        if len(payload) != expected:
            raise WireError(
                "size", f"{self.name}: {len(payload)} bytes where {expected} are expected"
            )
        return lengths


@cache
def schema(name: str) -> Schema:
    """The schema of `State`, `Setpoint` or `Event`, read from its `.msg` file."""
    text = (resources.files("protocol") / "msg" / f"{name}.msg").read_text(encoding="utf-8")
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


class Message:
    """A message in one preallocated, writable buffer, aligned for float64.

    Scalars are plain attributes; arrays are float64 views of the buffer, so writing into them
    writes the message.

    Raises:
        WireError: `load` got bytes of another size, header, length or version.
    """

    schema: ClassVar[Schema]
    wire_version: int

    def __init__(self, **lengths: int) -> None:
        places, end = self.schema.offsets(lengths)
        words = np.zeros(1 + -(-end // 8))
        whole = words.data.cast("B")
        self._bytes = whole[8 - len(CDR_HEADER) : 8 + end]  # so that the body is aligned
        self._bytes[: len(CDR_HEADER)] = CDR_HEADER
        self._struct = self.schema.scalar_struct
        self._names = tuple(self.schema.scalars)
        self._scalars = attrgetter(*self._names)
        self._guards: list[tuple[int, bytes]] = [(0, CDR_HEADER)]
        for name in self.schema.arrays:
            count = lengths[name]
            at = len(CDR_HEADER) + places[name]
            self._bytes[at : at + 4] = struct.pack("<I", count)
            self._guards.append((at, struct.pack("<I", count)))
            first = (8 + _first_element(places[name], count)) // 8
            setattr(self, name, words[first : first + count])
        for name, kind in self.schema.scalars.items():
            setattr(self, name, 0.0 if kind == "float64" else 0)
        self.wire_version = WIRE_VERSION

    @property
    def size(self) -> int:
        """Bytes on the wire, CDR header included."""
        return len(self._bytes)

    def load(self, payload: bytes) -> None:
        """Take the content of `payload`. The message is unchanged where that fails."""
        if len(payload) != len(self._bytes):
            raise WireError(
                "size",
                f"{self.schema.name}: {len(payload)} bytes where {len(self._bytes)} are expected",
            )
        for at, expected in self._guards:
            if payload[at : at + 4] != expected:
                raise WireError("layout", f"{self.schema.name}: unexpected bytes at offset {at}")
        values = self._struct.unpack_from(payload, len(CDR_HEADER))
        if values[0] != WIRE_VERSION:
            raise WireError(
                "wire_version",
                f"{self.schema.name}: wire version {values[0]} where {WIRE_VERSION} is spoken",
            )
        self._bytes[:] = payload
        self.__dict__.update(zip(self._names, values, strict=True))  # half the time of setattr

    @classmethod
    def scalars(cls, payload: bytes, *names: str) -> tuple[Any, ...]:
        """Some scalars of a payload, without loading it.

        Raises:
            WireError: it is too short.
        """
        layout = cls.schema.scalar_struct
        if len(payload) < len(CDR_HEADER) + layout.size:
            raise WireError("size", f"{cls.schema.name}: {len(payload)} bytes are too few")
        values = layout.unpack_from(payload, len(CDR_HEADER))
        return _pick(cls.schema.name, names)(values)

    def dump(self) -> bytes:
        """The message as bytes for the wire or the log."""
        self._struct.pack_into(self._bytes, len(CDR_HEADER), *self._scalars(self))
        return bytes(self._bytes)


class State(Message):
    """What the robot publishes at each tick; units and meaning stand in `msg/State.msg`."""

    schema = schema("State")

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

    def __init__(self, joints: int, wrench: int = 0) -> None:
        super().__init__(q=joints, dq=joints, tau=joints, reference=joints, wrench=wrench)


class Setpoint(Message):
    """The controller's answer to one State; see `msg/Setpoint.msg`."""

    schema = schema("Setpoint")

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

    def __init__(self, joints: int, extra: int = 0) -> None:
        super().__init__(values=joints, extra=extra)


class Event(Message):
    """Something that is not part of every tick; see `msg/Event.msg`."""

    schema = schema("Event")

    kind: int
    session_id: int
    tick: int
    stamp: int
    detail: int


@cache
def _pick(message: str, names: tuple[str, ...]) -> Callable[[tuple[Any, ...]], tuple[Any, ...]]:
    """Pick some of a message's scalars out of all of them."""
    places = {name: at for at, name in enumerate(schema(message).scalars)}
    if len(names) == 1:
        (place,) = (places[name] for name in names)
        return lambda values: (values[place],)
    return itemgetter(*(places[name] for name in names))


def _first_element(place: int, count: int) -> int:
    """Offset of a sequence's first element, given the offset of its length."""
    return -(-(place + 4) // 8) * 8 if count else place + 4
