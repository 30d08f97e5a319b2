"""Tasks as controllers of accelerations and torques have them in a config."""

from __future__ import annotations

import math
from typing import Annotated, ClassVar, Self

from pydantic import Field, model_validator

from hoap3.protocol.config.changeable import CHANGEABLE, CRITICAL_DAMPING
from hoap3.protocol.config.settings import Settings
from hoap3.remote_controller.references.postures import PostureValues
from hoap3.remote_controller.tasks.registry import LabelledTask

Triple = tuple[float, float, float]


class Gains(Settings):
    """Of a wanted acceleration kp·error − kd·velocity."""

    kp: float = Field(10.0, gt=0, description="of the error [1/s²]", json_schema_extra=CHANGEABLE)
    kd: Annotated[float | None, CRITICAL_DAMPING] = Field(
        None,
        ge=0,
        description="[1/s]; null: 2√kp, critical damping",
        json_schema_extra=CHANGEABLE,
    )

    @property
    def both(self) -> tuple[float, float]:
        """Gains kp and kd."""
        return self.kp, 2.0 * math.sqrt(self.kp) if self.kd is None else self.kd


class GoalSettings(PostureValues):
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


class AccelerationTask(LabelledTask, Gains):
    """A task that asks for an acceleration: ë = −kp·e − kd·ė."""

    hints: ClassVar = {"gain_per_s": "Accelerations have the gains kp [1/s²] and kd [1/s]"}
