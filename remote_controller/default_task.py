"""What a controller does whose config names no task: the robot's own `default_task`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hoap3.protocol.errors import ConfigError, FrameNotFoundError, NoDefaultTaskError
from hoap3.protocol.messages import FloatArray
from hoap3.protocol.robot.description import COM, DefaultTask, RobotDescription
from hoap3.remote_controller.model.kinematics import Kinematics
from hoap3.remote_controller.tasks.registry import TaskSettings


@dataclass(frozen=True)
class Goal:
    """A point of the robot, and where it shall be.

    Attributes:
        point: a frame, or `com`.
        reference: the frame that it is seen from.
        target_m: (x, y, z) in the reference's axes [m].
    """

    point: str
    reference: str
    target_m: tuple[float, float, float]

    @property
    def settings(self) -> TaskSettings:
        """As a config would name it."""
        target = {"kind": "point", "position_m": list(self.target_m)}
        if self.point == COM:
            return TaskSettings(task="com", parameters={"frame": self.reference, "target": target})
        frames = {"frame": self.point, "reference": self.reference}
        return TaskSettings(task="frame_position", parameters={**frames, "target": target})


def default_goal(
    description: RobotDescription, key: str, point: str | None = None, reference: str | None = None
) -> Goal:
    """The robot's default task, its target computed for the initial posture.

    Args:
        description: of the robot.
        key: where the task could have been named, for errors.
        point, reference: instead of those of the default task.

    Raises:
        NoDefaultTaskError: the robot has no default task.
        ConfigError: its target is for another point.
        FrameNotFoundError: the robot has no such frame.
    """
    task = description.default_task
    if task is None:
        _check_frames(description, point, reference)
        problem = f"is missing, and robot {description.name!r} has no default task"
        remedy = "Name it, or write `default_task` into the robot's robot.yaml"
        raise NoDefaultTaskError("", key, None, problem, remedy)
    if task.target_m is not None and point not in {None, task.point}:
        remedy = "Write where the point shall be"
        raise ConfigError("", key, None, f"no target is named for the point {point!r}", remedy)
    changed = {"point": point or task.point, "reference": reference or task.reference}
    task = task.model_copy(update=changed)
    target = task.target_m
    if target is None:
        start = np.zeros(3)
        _read(description, task, start)
        x, y, z = (start + np.array(task.move_m)).tolist()
        target = (x, y, z)
    return Goal(task.point, task.reference, target)


def _check_frames(description: RobotDescription, *frames: str | None) -> None:
    """Refuse frames that are named, but that the robot does not have."""
    for frame in frames:
        if frame not in {None, COM, *description.frames}:
            raise FrameNotFoundError(str(frame), description.name, description.frames)


def _read(description: RobotDescription, task: DefaultTask, out: FloatArray) -> None:
    """Write where the point is in the initial posture, (3,) [m]."""
    kinematics = Kinematics(description)
    reference = kinematics.frame_id(task.reference)
    if task.point == COM:
        kinematics.update(description.initial_position)
        kinematics.com(reference, out, np.zeros((3, description.n)))
        return
    frame = kinematics.frame_id(task.point)
    kinematics.update(description.initial_position)
    kinematics.frame(frame, reference, out, np.zeros((3, 3)), np.zeros((6, description.n)))
