"""Settings of controllers of joint velocities with several tasks: the tasks and the bounds."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from hoap3.protocol.config.changeable import CHANGEABLE
from hoap3.protocol.config.settings import Settings
from hoap3.protocol.description import RobotDescription
from hoap3.protocol.errors import ConfigError
from hoap3.protocol.messages import FloatArray
from hoap3.remote_controller.controllers.base import VelocityController
from hoap3.remote_controller.controllers.singularity import LeaveSingularity
from hoap3.remote_controller.tasks.registry import LabelledTask

INSIDE = 1.0 - 1e-9  # of the greatest acceleration: the robot judges by rounded positions
Positive = Annotated[float, Field(gt=0)]


class VelocityBounds(Settings):
    """What joints may do, beside their ranges; the robot need not intervene then."""

    speed_rad_s: Positive | None = Field(
        None,
        description="greatest speed of every joint; null: the description's [rad/s or m/s]",
        json_schema_extra=CHANGEABLE,
    )
    acceleration_rad_s2: Positive | None = Field(
        None, description="greatest acceleration; null: what the robot brakes with [rad/s² or m/s²]"
    )
    margin_rad: float = Field(
        1e-9, ge=0, description="taken off both ends of the usable range [rad or m]"
    )

    def limits(self, description: RobotDescription) -> FloatArray:
        """Range, greatest speed and acceleration, (4, n), none beyond the description's.

        Raises:
            ConfigError: the margin leaves nothing of a range.
        """
        robot, room = description, description.upper - description.lower
        if (room < 2.0 * self.margin_rad).any():
            joint = int(np.argmin(room))
            problem = f"leaves nothing of the range of joint {robot.joint_names[joint]!r}"
            remedy = f"At most {room[joint] / 2.0}"
            raise ConfigError("", "bounds.margin_rad", self.margin_rad, problem, remedy)
        hardest = INSIDE * robot.setpoint_acceleration_max
        acceleration = self.acceleration_rad_s2 or robot.brake_acceleration
        return np.array(
            [
                robot.lower + self.margin_rad,
                robot.upper - self.margin_rad,
                np.minimum(robot.velocity, self.speed_rad_s or np.inf),
                np.minimum(hardest, acceleration) * np.ones(robot.n),
            ]
        )


class LabelledTaskParameters(VelocityController.Parameters):
    """What all of them have."""

    tasks: tuple[LabelledTask, ...] | None = Field(min_length=1, description="what shall be done")
    bounds: VelocityBounds = Field(VelocityBounds(), description="of the joint velocities")
    kinematics_from: Literal["measured", "reference"] = Field(
        "measured", description="joint positions that kinematics are computed from"
    )
    leave_singularity: LeaveSingularity = False
