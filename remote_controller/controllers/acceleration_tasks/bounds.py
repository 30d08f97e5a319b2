"""Bounds of accelerations and torques within which a hierarchy is solved."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from hoap3.protocol.description import RobotDescription
from hoap3.protocol.errors import ConfigError
from hoap3.protocol.messages import FloatArray
from hoap3.remote_controller.controllers.acceleration_tasks.joint_bounds import (
    JointBounds,
    Positive,
)
from hoap3.remote_controller.controllers.acceleration_tasks.tsid_settings import TsidBounds


class HierarchyBounds(TsidBounds):
    """Those of `tsid`, and of speeds and torques."""

    speed_max: tuple[Positive, ...] = Field(
        (),
        description="of all joints, or of each [rad/s or m/s], where it is less than the "
        "description's; empty: that",
    )
    torque_max: tuple[Positive, ...] = Field(
        (),
        description="of all joints, or of each [N m or N], where it is less than the description's "
        "effort; empty: that",
    )


def bounds_of(robot: RobotDescription, settings: HierarchyBounds) -> tuple[JointBounds, FloatArray]:
    """Bounds of the accelerations, and the greatest torques, (n,) [N m or N].

    Raises:
        ConfigError: limits and settings that do not go together.
    """
    speeds = _least(robot.velocity, settings.speed_max, "bounds.speed_max")
    slower = tuple(
        joint.model_copy(update={"velocity": float(speed)})
        for joint, speed in zip(robot.joints, speeds, strict=True)
    )
    bounds = JointBounds(robot.model_copy(update={"joints": slower}), settings)
    return bounds, _least(robot.effort, settings.torque_max, "bounds.torque_max")


def _least(own: FloatArray, given: tuple[float, ...], key: str) -> FloatArray:
    if len(given) not in {0, 1, own.size}:
        problem, remedy = f"has {len(given)} values", f"Give none, one, or {own.size}"
        raise ConfigError("", key, None, problem, remedy)
    least: FloatArray = np.minimum(own, np.array(given or own))
    return least
