"""Settings of `ghc_velocity`: the tasks, their priorities, and the bounds of the velocities."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

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
        0.0, ge=0, description="taken off both ends of the usable range [rad or m]"
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
