"""Settings of `ghc_velocity`: the tasks, their priorities, and the bounds of the velocities."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from protocol.description import RobotDescription
from protocol.errors import ConfigError
from protocol.messages import FloatArray
from protocol.settings import RobotName, Settings
from remote_controller.controllers.controller import VelocityController
from remote_controller.priorities.settings import PrioritySettings
from remote_controller.tasks.registry import TaskSettings

Positive = Annotated[float, Field(gt=0)]


class RankedTask(TaskSettings):
    """A task, under the name by which priorities know it."""

    name: RobotName | None = Field(None, description="in priorities and the log; null: the task's")
    gain_per_s: float = Field(5.0, gt=0, description="g of the wanted velocity −g·e − ∂e/∂t [1/s]")

    @property
    def label(self) -> str:
        """The name by which priorities know it."""
        return self.name or self.task


class VelocityBounds(Settings):
    """What joints may do, beside their ranges; the robot need not intervene then."""

    speed_rad_s: Positive | None = Field(
        None, description="greatest speed of every joint; null: the description's [rad/s or m/s]"
    )
    acceleration_rad_s2: Positive | None = Field(
        None,
        description="greatest acceleration; null: what the robot brakes with [rad/s² or m/s²]",
    )
    margin_rad: float = Field(
        1e-9, ge=0, description="taken off both ends of the usable range [rad or m]"
    )

    def limits(self, description: RobotDescription, file: str) -> FloatArray:
        """Range, greatest speed and acceleration, (4, n), none beyond the description's.

        Raises:
            ConfigError: the margin leaves nothing of a range.
        """
        robot, room = description, description.upper - description.lower
        if (room < 2.0 * self.margin_rad).any():
            joint = int(np.argmin(room))
            raise ConfigError(
                file,
                "parameters.bounds.margin_rad",
                self.margin_rad,
                f"leaves nothing of the range of joint {robot.joint_names[joint]!r}",
                f"At most {room[joint] / 2.0}",
            )
        hardest = robot.setpoint_acceleration_max
        acceleration = self.acceleration_rad_s2 or robot.brake_acceleration
        return np.array(
            [
                robot.lower + self.margin_rad,
                robot.upper - self.margin_rad,
                np.minimum(robot.velocity, self.speed_rad_s or np.inf),
                np.minimum(hardest, acceleration) * np.ones(robot.n),
            ]
        )


class Parameters(VelocityController.Parameters):
    """Problem (13) for velocities, section 8."""

    tasks: tuple[RankedTask, ...] = Field(min_length=1, description="what shall be done")
    priorities: PrioritySettings = Field(
        PrioritySettings(), description="which tasks keep which out; without any, none does"
    )
    bounds: VelocityBounds = Field(VelocityBounds(), description="of the joint velocities")
    regularisation: float = Field(
        1e-6, ge=1e-8, description="ω_r: how soon a task gives way near a singularity [m² or rad²]"
    )
    smoothing: float = Field(
        0.0,
        ge=0,
        description="s₀: singular values from which on a direction is kept free in full; 0: all, "
        "however small, as the paper has it",
    )
    kinematics_from: Literal["measured", "reference"] = Field(
        "measured", description="joint positions that kinematics are computed from"
    )
