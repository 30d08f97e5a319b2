"""Where live targets are: the numbers of each as its layout has them, at some joint positions."""

from __future__ import annotations

from collections.abc import Sequence

from hoap3.protocol.messages import FloatArray
from hoap3.tools.picture.poses import Poses
from hoap3.tools.view.picture.config_scene import Steered


def present(target: Steered, poses: Poses, q: FloatArray) -> list[float] | None:
    """What would hold the robot where it is, as far as one target can; None where nobody knows.

    Args:
        target: which.
        poses: of the robot, updated.
        q: (n,) its joint positions [rad or m].
    """
    if target.kind == "posture":
        return [float(q[place]) for place in target.joints]
    if target.reference is None:
        return None
    if target.kind == "com":
        return poses.com_from(target.reference) if poses.com is not None else None
    if target.frame is None:
        return None
    seen = poses.seen_from(target.frame, target.reference)
    parts = {"frame_position": seen[:3], "frame_orientation": seen[3:], "frame_pose": seen}
    return parts.get(target.kind)


def all_present(
    targets: Sequence[Steered], poses: Poses, q: FloatArray
) -> list[list[float] | None]:
    """The same of each."""
    return [present(target, poses, q) for target in targets]
