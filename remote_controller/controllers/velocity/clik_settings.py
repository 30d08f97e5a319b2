"""Settings of `clik` and `clik_sdp`: tasks in the order of their priorities, and their gains."""

from __future__ import annotations

from pydantic import Field

from hoap3.remote_controller.controllers.velocity.velocity_task_stack_settings import (
    LabelledTask,
    LabelledTaskParameters,
)
from hoap3.remote_controller.solvers.sdp.sdp_gains import DELTA

TASKS = "what shall be done, the most important first; null: the default task of the robot"


class WeightedTask(LabelledTask):
    """A task of V = ½ Σ w|e|²."""

    weight: float = Field(
        1.0, ge=1e-12, le=1e12, description="w of V = ½ Σ w|e|²; more for the upper tasks"
    )


class SteadyTask(WeightedTask):
    """A task with a gain that stays as it is."""

    gain_per_s: float = Field(1.0, gt=0, le=1e6, description="λ of all its rows [1/s]")


class ClikParameters(LabelledTaskParameters):
    """What both have."""

    tasks: tuple[WeightedTask, ...] | None = Field(None, min_length=1, description=TASKS)
    damping: float = Field(
        0.0, ge=0, le=1e6, description="d: Jᵀ(JJᵀ + d²I)⁻¹ stands for the pseudoinverse J⁺"
    )


class SteadyParameters(ClikParameters):
    """Constant gains."""

    tasks: tuple[SteadyTask, ...] | None = Field(None, min_length=1, description=TASKS)


class SdpParameters(ClikParameters):
    """Gains by semidefinite programming."""

    beta_per_s: float = Field(
        4.0, gt=0, le=1e6, description="β̃: the rate at which V shall fall [1/s]"
    )
    delta: float = Field(DELTA, ge=1e-12, le=1e3, description="δ: what large gains cost [1]")
    budget: int = Field(
        60,
        ge=1,
        le=1000,
        description="iterations that one cycle may take; then the last gains stay",
    )
