"""What a panel of Foxglove publishes where somebody clicks: points and poses, as JSON or CDR."""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from hoap3.protocol.errors import UsageError
from hoap3.protocol.messages import CDR_HEADER

MAX_BYTES = 4096
_PLACE, _TURN = ("x", "y", "z"), ("x", "y", "z", "w")
_LENGTHS = {"PointStamped": 3, "PoseStamped": 7}


@dataclass(frozen=True)
class Clicked:
    """A point or a pose, and the frame that it is seen from.

    Attributes:
        frame: "" where none is named.
        values: x, y, z [m]; of a pose also qx, qy, qz, qw.
    """

    frame: str
    values: tuple[float, ...]


def read_clicked(schema: str, encoding: str, data: bytes) -> Clicked:
    """Read a message that a client has published.

    Args:
        schema: name of its type, as ROS 1 or ROS 2 has it.
        encoding: `json` or `cdr`.
        data: the message.

    Raises:
        UsageError: not one of these, or not what it says.
    """
    leaf = schema.rpartition("/")[2]
    if not schema.startswith("geometry_msgs/") or leaf not in _LENGTHS:
        raise UsageError(
            f"{schema!r:.80} is not taken as a target: publish "
            + " or ".join(f"geometry_msgs/{name}" for name in _LENGTHS)
        )
    if encoding not in {"json", "cdr"} or len(data) > MAX_BYTES:
        raise UsageError(
            f"{leaf}: {len(data)} bytes of {encoding!r:.20}; JSON or CDR of at most {MAX_BYTES} "
            "is taken"
        )
    try:
        return _from_json(leaf, data) if encoding == "json" else _from_cdr(leaf, data)
    except (
        *(ArithmeticError, AttributeError, LookupError, RecursionError, TypeError, ValueError),
        struct.error,
    ) as error:
        raise UsageError(f"{leaf}: not such a message ({error!r:.100})") from error


def _from_json(leaf: str, data: bytes) -> Clicked:
    content = json.loads(data)
    frame = str(content.get("header", {}).get("frame_id", ""))
    if leaf == "PointStamped":
        return Clicked(frame, _named(content["point"], _PLACE))
    pose = content["pose"]
    values = _named(pose["position"], _PLACE) + _named(pose["orientation"], _TURN)
    return Clicked(frame, values)


def _named(content: Mapping[str, Any], names: tuple[str, ...]) -> tuple[float, ...]:
    return tuple(float(content[name]) for name in names)


def _from_cdr(leaf: str, data: bytes) -> Clicked:
    if data[:4] != CDR_HEADER:
        raise ValueError("not plain CDR, little endian")
    body, count = data[4:], _LENGTHS[leaf]
    (length,) = struct.unpack_from("<I", body, 8)  # behind the stamp
    frame = body[12 : 12 + length].rstrip(b"\0").decode()
    at = -(-(12 + length) // 8) * 8
    return Clicked(frame, struct.unpack_from(f"<{count}d", body, at))
