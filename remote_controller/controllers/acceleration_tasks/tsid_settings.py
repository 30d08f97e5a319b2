"""Settings of `tsid`: the goal, the gains and the bounds."""

from __future__ import annotations

from typing import Self

from pydantic import Field, model_validator

from hoap3.remote_controller.controllers.acceleration_tasks.frame_goals import Gains, GoalSettings
from hoap3.remote_controller.controllers.acceleration_tasks.joint_bounds import BoundSettings
from hoap3.remote_controller.controllers.base import Controller
from hoap3.remote_controller.tasks.accuracy import (
    TOLERANCE_DEG,
    TOLERANCE_M,
    ToleranceDeg,
    ToleranceM,
)


class PostureSettings(Gains):
    """What the joints do where the task leaves them free."""

    posture: str | None = Field(
        None, description="q_r, one of the robot's description; null: where it starts"
    )
    posture_rad: tuple[float, ...] = Field((), description="instead: q_r itself [rad or m]")
    weight: float = Field(
        1e-3,
        gt=0,
        description="w of (33), beside the task's 1; a smaller w is more exact, the elbow drifts",
    )


class TsidBounds(BoundSettings):
    """Within which the robot, that keeps bounds of its own, need not intervene."""

    acceleration_share: float = Field(0.95, gt=0, le=1, description="of the greatest acceleration")
    margin_rad: float = Field(
        4e-3, ge=0, description="distance from the ends of the usable range [rad or m]"
    )
    speed_share: float = Field(0.97, gt=0, le=1, description="of the greatest speed")
    brake_share: float = Field(
        0.85, gt=0, le=1, description="of the acceleration that stopping in time counts on"
    )
    softness_rad: float = Field(
        1e-6, ge=0, description="how far beyond the margin a joint is drawn back gently [rad or m]"
    )


class Parameters(Controller.Parameters):
    """Problem (33), part by part."""

    frame: str | None = Field(
        None, description="frame that shall get there; null: that of the robot's default task"
    )
    goal: GoalSettings | None = Field(
        None,
        description="where it shall be; null: where the robot's default task has it, with the "
        "orientation that it has at the start",
    )
    tolerance_m: ToleranceM = TOLERANCE_M
    tolerance_deg: ToleranceDeg = TOLERANCE_DEG
    task: Gains = Field(Gains(), description="of the frame's acceleration")
    posture: PostureSettings = Field(PostureSettings(), description="of the null space")
    bounds: TsidBounds = Field(TsidBounds(), description="of the accelerations")
    compensate_friction: bool = Field(
        True, description="count the viscous friction of the URDF among the torques"
    )

    @model_validator(mode="after")
    def _frame_of_goal(self) -> Self:
        if self.frame is None and self.goal is not None:
            raise ValueError("has a goal, but no frame that shall get there: add `frame`")
        return self
