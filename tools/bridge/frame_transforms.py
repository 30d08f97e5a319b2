"""`foxglove.FrameTransforms` of a robot as CDR, under the name that it has in ROS 2.

The schema is Foxglove's (https://docs.foxglove.dev/docs/sdk/schemas/frame-transforms).
"""

from __future__ import annotations

import struct

from hoap3.protocol.messages import CDR_HEADER, FloatArray
from hoap3.protocol.robot.description import RobotDescription
from hoap3.tools.logs.log_format import LATEST_STAMP
from hoap3.tools.picture.poses import Poses

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


def world_frame(description: RobotDescription) -> str:
    """Return the name of the top frame, where a fixed base frame lies; no link has that name."""
    name = "world"
    while name in description.frames:
        name += "_"
    return name


class FrameTransforms:
    """Packs the pose of each link in the frame of its parent link.

    The names are laid out once; a message is stamps and numbers.

    Args:
        description: of the robot.

    Attributes:
        parents, children: names of the frames: the world and the root link, then the links before
            and behind each joint.
    """

    def __init__(self, description: RobotDescription) -> None:
        structure = description.structure
        self._poses = Poses(description)
        self.parents = (world_frame(description), *(joint.parent for joint in structure.joints))
        self.children = (structure.root, *(joint.child for joint in structure.joints))
        body = bytearray(struct.pack("<I", len(self.children)))
        self._places: list[tuple[int, int]] = []
        for names in zip(self.parents, self.children, strict=True):
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
        """Return the message.

        Args:
            q: (n,) joint positions [rad or m].
            base: pose of the root link in the world, its first 7 numbers, as State has it; empty
                where the base frame is fixed.
            stamp: of every frame [ns].
        """
        time = divmod(stamp % LATEST_STAMP, 1_000_000_000)
        poses = self._poses
        poses.update(q, base)
        relative = map(poses.seen_from, self.children[1:], self.parents[1:])
        each_pose = [poses.pose(self.children[0]), *relative]
        for (at, numbers), pose in zip(self._places, each_pose, strict=True):
            _STAMP.pack_into(self._body, at, *time)
            _POSE.pack_into(self._body, numbers, *pose)
        return CDR_HEADER + bytes(self._body)


def _align(body: bytearray, size: int) -> None:
    body += bytes(-len(body) % size)
