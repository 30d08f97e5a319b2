"""Frames that no joint moves, and poses that are given in them."""

from __future__ import annotations

import numpy as np

from hoap3.protocol.errors import ConfigError
from hoap3.protocol.messages import FloatArray
from hoap3.protocol.robot.description import RobotDescription
from hoap3.remote_controller.model.frame_dynamics import FramesDynamics
from hoap3.remote_controller.references.postures import posture_of
from hoap3.remote_controller.references.settings import PointSettings
from hoap3.remote_controller.tasks.frames.frame_pose import FramePoseTask

Pose = tuple[FloatArray, FloatArray]


def stands(robot: RobotDescription, frame: str) -> bool:
    """Whether no joint moves a frame; True for one that the robot does not have."""
    above = {joint.child: joint for joint in robot.structure.joints}
    while frame in above:
        if above[frame].name in robot.structure.moved:
            return False
        frame = above[frame].parent
    return True


def check_stands(robot: RobotDescription, frame: str, key: str) -> None:
    """Refuse a frame that the robot does not have, or that joints move.

    Raises:
        ConfigError: with the key.
    """
    if frame not in robot.frames:
        remedy = f"Its frames: {', '.join(robot.frames)}"
        raise ConfigError("", key, frame, "the robot has no such frame", remedy)
    if not stands(robot, frame):
        problem, remedy = "joints move it", f"Name one that stands, such as {robot.base_frame}"
        raise ConfigError("", key, frame, problem, remedy)


def reference_of(
    robot: RobotDescription, dynamics: FramesDynamics, name: str | None, key: str
) -> Pose:
    """Origin (3,) [m] and axes (3, 3) of a frame that stands, in the root; by default the base's.

    Raises:
        ConfigError: the robot has no such frame, or joints move it.
    """
    reference = name or robot.base_frame
    check_stands(robot, reference, key)
    return dynamics.placement(robot.initial_position, reference)


def turned(axes: FloatArray, rotation_rad: tuple[float, float, float]) -> FloatArray:
    """Axes (3, 3), as columns, turned by an axis × angle that is given in them [rad]."""
    from hoap3.remote_controller.tasks.accelerations.se3_pd_kernels import rotation_of

    turn = np.zeros((3, 3))
    rotation_of(np.array(rotation_rad), turn)
    return np.ascontiguousarray(axes @ turn)


def pose_of(
    robot: RobotDescription, dynamics: FramesDynamics, wanted: FramePoseTask.Parameters
) -> Pose | None:
    """H_d of a frame in the root's axes; None: where it is at the start.

    Args:
        robot, dynamics: which; the dynamics of any of its frames.
        wanted: the frame and its pose, at a point that stays.

    Returns:
        Origin (3,) [m] and rotation (3, 3).

    Raises:
        ConfigError: a posture or a reference that the robot does not have, or one that moves.
    """
    if isinstance(wanted.target, PointSettings):
        origin, axes = reference_of(robot, dynamics, wanted.reference, "reference")
        place = origin + axes @ np.array(wanted.target.position_m)
        return place, turned(axes, wanted.rotation)
    if wanted.posture is None and not wanted.posture_rad:
        return None
    q = posture_of(robot, wanted.posture, wanted.posture_rad, "posture")
    return dynamics.placement(q, wanted.frame)
