"""Settings of `tsid`: the goal, the gains and the bounds."""

from __future__ import annotations

import math
from typing import Self

from pydantic import Field, model_validator

from protocol.settings import Settings
from remote_controller.controllers.controller import Controller
from remote_controller.controllers.joint_bounds import BoundSettings

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

    kp: float = Field(10.0, gt=0, description="[1/s²]")
    kd: float | None = Field(None, ge=0, description="[1/s]; null: 2√kp, critical damping")

    @property
    def both(self) -> tuple[float, float]:
        """Gains kp and kd."""
        return self.kp, 2.0 * math.sqrt(self.kp) if self.kd is None else self.kd


class PostureSettings(Gains):
    """What the joints do where the task leaves them free."""

    posture: str | None = Field(
        None, description="q_r, one of the robot's description; null: where it starts"
    )
    posture_rad: tuple[float, ...] = Field((), description="instead: q_r itself [rad or m]")
    weight: float = Field(1e-3, gt=0, description="w, beside the task's 1")


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
        1e-6,
        ge=0,
        description="how far beyond the margin a joint is drawn back gently [rad or m]",
    )


class Parameters(Controller.Parameters):
    """Problem (33), part by part."""

    frame: str = Field(description="frame that shall get there")
    goal: GoalSettings = Field(description="where it shall be")
    task: Gains = Field(Gains(), description="of the frame's acceleration")
    posture: PostureSettings = Field(PostureSettings(), description="of the null space")
    bounds: TsidBounds = Field(TsidBounds(), description="of the accelerations")
    compensate_friction: bool = Field(
        True, description="count the viscous friction of the URDF among the torques"
    )
