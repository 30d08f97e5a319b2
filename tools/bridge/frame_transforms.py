"""`foxglove.FrameTransforms` of a robot as CDR, under the name that it has in ROS 2.

The schema is Foxglove's (https://docs.foxglove.dev/docs/sdk/schemas/frame-transforms).
"""

from __future__ import annotations

import struct

from hoap3.protocol.description import RobotDescription
from hoap3.protocol.messages import CDR_HEADER, FloatArray
from hoap3.tools.bridge.link_frames import LinkFrames
from hoap3.tools.logs.log_format import LATEST_STAMP

_RULE = "=" * 80
SCHEMA_NAME = "foxglove_msgs/msg/FrameTransforms"
SCHEMA = f"""\
foxglove_msgs/FrameTransform[] transforms
{_RULE}
MSG: foxglove_msgs/FrameTransform
builtin_interfaces/Time timestamp
string parent_frame_id
string child_frame_id
geometry_msgs/Vector3 translation
geometry_msgs/Quaternion rotation
{_RULE}
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
{_RULE}
MSG: geometry_msgs/Vector3
float64 x
float64 y
float64 z
{_RULE}
MSG: geometry_msgs/Quaternion
float64 x
float64 y
float64 z
float64 w
"""
_STAMP, _POSE = struct.Struct("<iI"), struct.Struct("<7d")


class FrameTransforms:
    """Packs where the links are. The names are laid out once; a message is stamps and numbers.

    Args:
        description: of the robot.
    """

    def __init__(self, description: RobotDescription) -> None:
        self._frames = LinkFrames(description)
        body = bytearray(struct.pack("<I", len(self._frames.children)))
        self._places: list[tuple[int, int]] = []
        for names in zip(self._frames.parents, self._frames.children, strict=True):
            _align(body, 4)
            stamp = len(body)
            body += bytes(_STAMP.size)
            for name in names:
                _align(body, 4)
                raw = name.encode() + b"\0"
                body += struct.pack("<I", len(raw)) + raw
            _align(body, 8)
            self._places.append((stamp, len(body)))
            body += bytes(_POSE.size)
        self._body = body

    def pack(self, q: FloatArray, base: FloatArray, stamp: int) -> bytes:
        """The message.

        Args:
            q, base: as `LinkFrames.poses` takes them.
            stamp: of every frame [ns].
        """
        time = divmod(stamp % LATEST_STAMP, 1_000_000_000)
        poses = self._frames.poses(q, base).tolist()
        for (at, numbers), pose in zip(self._places, poses, strict=True):
            _STAMP.pack_into(self._body, at, *time)
            _POSE.pack_into(self._body, numbers, *pose)
        return CDR_HEADER + bytes(self._body)


def _align(body: bytearray, size: int) -> None:
    body += bytes(-len(body) % size)
