"""Where a frame shall be, and how it is drawn there, as a config has it."""

from __future__ import annotations

import math
from typing import Self

import numpy as np
from pydantic import Field, model_validator

from hoap3.protocol.config.settings import Settings
from hoap3.protocol.description import COM, RobotDescription
from hoap3.protocol.errors import ConfigError
from hoap3.protocol.messages import FloatArray
from hoap3.remote_controller.default_task import Goal
from hoap3.remote_controller.model.frame_dynamics import FrameDynamics, FramesDynamics
from hoap3.remote_controller.references.postures import posture_of

Triple = tuple[float, float, float]


class GoalSettings(Settings):
    """Where the frame shall be: at a pose, or where it is in a posture of the robot."""

    posture: str | None = Field(None, description="of the robot's description")
    posture_rad: tuple[float, ...] = Field((), description="instead: a posture itself [rad or m]")
    position_m: Triple | None = Field(None, description="or: the frame's origin")
    rotation_rad: Triple = Field((0.0, 0.0, 0.0), description="axis × angle of its orientation")
    reference: str | None = Field(
        None, description="frame in which the pose is given, which stands; null: the base frame"
    )

    @model_validator(mode="after")
    def _one_goal(self) -> Self:
        given = (self.posture is not None, bool(self.posture_rad), self.position_m is not None)
        if sum(given) != 1:
            raise ValueError("should have one of posture, posture_rad and position_m")
        return self


class Gains(Settings):
    """Of a wanted acceleration kp·error − kd·velocity."""

    kp: float = Field(10.0, gt=0, description="of log(H⁻¹H_d) in (34) [1/s²]")
    kd: float | None = Field(None, ge=0, description="[1/s]; null: 2√kp, critical damping")

    @property
    def both(self) -> tuple[float, float]:
        """Gains kp and kd."""
        return self.kp, 2.0 * math.sqrt(self.kp) if self.kd is None else self.kd


def default_pose(robot: RobotDescription, goal: Goal, key: str) -> tuple[FloatArray, FloatArray]:
    """H_d of the robot's default task, with the orientation of the initial posture; as `pose_of`.

    Raises:
        ConfigError: the default task is for the centre of mass, or seen from a frame that moves.
        FrameNotFoundError: the robot has no such frame.
    """
    if goal.point == COM:
        problem = f"is missing, and the default task of {robot.name!r} is for its centre of mass"
        raise ConfigError("", key, None, problem, "Name a frame and a goal for it")
    dynamics = FrameDynamics(robot, goal.point)
    origin, axes = reference_of(robot, dynamics, goal.reference, key)
    _, rotation = dynamics.placement(robot.initial_position, goal.point)
    return origin + axes @ np.array(goal.target_m), rotation


def pose_of(
    robot: RobotDescription, dynamics: FramesDynamics, frame: str, goal: GoalSettings, key: str
) -> tuple[FloatArray, FloatArray]:
    """H_d of a frame in the root's axes: origin (3,) [m] and rotation (3, 3).

    Args:
        robot, dynamics: which; the dynamics of any of its frames.
        frame: that shall get there.
        goal: as it stands under `key`.

    Raises:
        ConfigError: a posture or a reference that the robot does not have, or one that moves.
    """
    from hoap3.remote_controller.controllers.acceleration_tasks.se3_pd_kernels import rotation_of

    if goal.position_m is None:
        q = posture_of(robot, goal.posture, goal.posture_rad, f"{key}.posture")
        return dynamics.placement(q, frame)
    origin, axes = reference_of(robot, dynamics, goal.reference, f"{key}.reference")
    turn = np.zeros((3, 3))
    rotation_of(np.array(goal.rotation_rad), turn)
    return origin + axes @ np.array(goal.position_m), np.ascontiguousarray(axes @ turn)


def reference_of(
    robot: RobotDescription, dynamics: FramesDynamics, name: str | None, key: str
) -> tuple[FloatArray, FloatArray]:
    """Origin (3,) [m] and axes (3, 3) of a frame that stands, in the root; by default the base's.

    Raises:
        ConfigError: the robot has no such frame, or joints move it.
    """
    reference = name or robot.base_frame
    if reference not in robot.frames:
        remedy = f"Its frames: {', '.join(robot.frames)}"
        raise ConfigError("", key, reference, "the robot has no such frame", remedy)
    if not dynamics.stands(reference):
        problem, remedy = "joints move it", f"Name one that stands, such as {robot.base_frame}"
        raise ConfigError("", key, reference, problem, remedy)
    return dynamics.placement(robot.initial_position, reference)
