"""Bounds of accelerations and torques within which a hierarchy is solved."""

from __future__ import annotations

from typing import Any

import numpy as np
from pydantic import Field

from hoap3.protocol.config.changeable import CHANGEABLE
from hoap3.protocol.description import RobotDescription
from hoap3.protocol.errors import ConfigError
from hoap3.protocol.messages import FloatArray
from hoap3.remote_controller.controllers.acceleration.joint_bounds import (
    BoundSettings,
    JointBounds,
    Positive,
)


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


def refuse_other_brakes(parameters: Any, *, brakes: bool) -> None:
    """Refuse a d that becomes 0, or no longer is 0.

    Args:
        parameters: with `null_damping_per_s`.
        brakes: whether it was above 0 when the controller was built.

    Raises:
        ConfigError: it is so.
    """
    d = parameters.null_damping_per_s
    if (d > 0.0) != brakes:
        problem = "switches the braking off" if brakes else "switches the braking on"
        remedy = "Take more than 0" if brakes else "Write it in the config, and begin anew"
        raise ConfigError("", "null_damping_per_s", d, problem, remedy)
