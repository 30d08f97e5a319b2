"""Settings of `ghc_velocity`: the tasks, their priorities, and the bounds of the velocities."""

from __future__ import annotations

from pydantic import Field

from hoap3.remote_controller.controllers.velocity.velocity_task_stack_settings import (
    LabelledTask,
    LabelledTaskParameters,
)
from hoap3.remote_controller.scheduling.settings import PrioritySettings


class RankedTask(LabelledTask):
    """A task that asks for a velocity of its own."""

    gain_per_s: float = Field(5.0, gt=0, description="g of the wanted velocity −g·e − ∂e/∂t [1/s]")


class Parameters(LabelledTaskParameters):
    """Problem (13) for velocities, section 8."""

    tasks: tuple[RankedTask, ...] = Field(min_length=1, description="what shall be done")
    priorities: PrioritySettings = Field(
        PrioritySettings(), description="which tasks keep which out; without any, none does"
    )
    regularisation: float = Field(
        1e-6, ge=1e-6, description="ω_r: how soon a task gives way near a singularity [m² or rad²]"
    )
    smoothing: float = Field(
        0.0,
        ge=0,
        le=1,
        description="s₀: singular values from which on a direction is kept free in full; 0: all, "
        "however small, as the paper has it",
    )
