"""Settings of the controllers of several tasks by accelerations, and the bounds that they name."""

from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import Field

from hoap3.protocol.config.changeable import CHANGEABLE
from hoap3.protocol.errors import ConfigError
from hoap3.protocol.messages import FloatArray
from hoap3.protocol.robot.description import RobotDescription
from hoap3.remote_controller.constraints.registry import ConstraintSettings
from hoap3.remote_controller.controllers.acceleration.joint_bounds import (
    BoundSettings,
    JointBounds,
    Positive,
)
from hoap3.remote_controller.controllers.acceleration.soles.settings import ContactSettings
from hoap3.remote_controller.controllers.base import Controller
from hoap3.remote_controller.tasks.accelerations.settings import AccelerationTask


class HierarchyBounds(BoundSettings):
    """Within which the robot, that keeps bounds of its own, need not intervene."""

    acceleration_share: float = Field(0.95, gt=0, le=1, description="of the greatest acceleration")
    margin_rad: float = Field(
        4e-3, ge=0, description="distance from the ends of the usable range [rad or m]"
    )
    speed_share: float = Field(
        0.97, gt=0, le=1, description="of the greatest speed", json_schema_extra=CHANGEABLE
    )
    brake_share: float = Field(
        0.85, gt=0, le=1, description="of the acceleration that stopping in time counts on"
    )
    softness_rad: float = Field(
        1e-6, ge=0, description="how far beyond the margin a joint is drawn back gently [rad or m]"
    )
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


class HierarchyParameters(Controller.Parameters):
    """Tasks and bounds of all of them."""

    tasks: tuple[AccelerationTask, ...] = Field(min_length=1, description="what shall be")
    constraints: tuple[ConstraintSettings, ...] = Field(
        (), description="what is kept beside the bounds, as rows of the accelerations"
    )
    bounds: HierarchyBounds = Field(HierarchyBounds(), description="of the motion")
    compensate_friction: bool = Field(
        True, description="count the viscous friction of the URDF among the torques"
    )
    base: Literal["fixed", "free"] = Field(
        "fixed", description="free: the robot may fall, and its soles stand on the ground"
    )
    contacts: ContactSettings = Field(ContactSettings(), description="of the soles of a free base")


class RegularisedParameters(HierarchyParameters):
    """And what damps the tasks."""

    w_r: float = Field(
        0.01,
        ge=1e-6,
        le=1e3,
        description="ω_r: weight of the regularisation; less is more exact, but livelier",
        json_schema_extra=CHANGEABLE,
    )
    null_damping_per_s: float = Field(
        10.0,
        ge=0,
        le=1e4,
        description="d: motion that no task speaks of brakes with −d·dq; 0: it goes on",
        json_schema_extra=CHANGEABLE,
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
