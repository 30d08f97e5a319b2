"""Tasks of a hierarchy as a config has them."""

from __future__ import annotations

import math
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from hoap3.protocol.config.settings import NAME_PATTERN
from hoap3.remote_controller.controllers.acceleration_tasks.frame_goals import (
    Gains,
    GoalSettings,
    Triple,
)
from hoap3.remote_controller.references.settings import TargetSettings
from hoap3.remote_controller.tasks.accuracy import (
    TOLERANCE_DEG,
    TOLERANCE_M,
    JointToleranceDeg,
    JointToleranceM,
    ToleranceDeg,
    ToleranceM,
)


class _Task(Gains):
    name: str = Field(pattern=NAME_PATTERN, description="by which priorities speak of it")


class _WithLength(_Task):
    tolerance_m: ToleranceM = TOLERANCE_M


class PositionSettings(_WithLength):
    """The origin of a frame at a target."""

    kind: Literal["position"]
    frame: str = Field(description="whose origin it is")
    target: TargetSettings | None = Field(
        None, description="where it shall be; null: where it is at the start"
    )
    reference: str | None = Field(
        None, description="frame in which the target is given, which stands; null: the base frame"
    )


class PoseSettings(_WithLength):
    """A frame at a pose."""

    tolerance_deg: ToleranceDeg = TOLERANCE_DEG

    kind: Literal["pose"]
    frame: str = Field(description="whose pose it is")
    goal: GoalSettings | None = Field(
        None, description="where it shall be; null: where it is at the start"
    )


class PostureTaskSettings(_Task):
    """All joints, or some, in a posture."""

    kind: Literal["posture"]
    posture: str | None = Field(
        None, description="one of the robot's description; null: where it starts"
    )
    posture_rad: tuple[float, ...] = Field((), description="instead: of all its joints [rad or m]")
    joints: tuple[str, ...] = Field((), description="which joints; empty: all")
    tolerance_deg: JointToleranceDeg = TOLERANCE_DEG
    tolerance_m: JointToleranceM = TOLERANCE_M


class ForceSettings(_WithLength):
    """The origin of a frame at a target, until it touches; then along a normal a force.

    Both in one task of three rows: two tasks without priority over each other would each feed into
    the rows of the other.
    """

    kind: Literal["force"]
    frame: str = Field(description="whose origin touches")
    target: TargetSettings = Field(
        description="where it shall be; below the surface, so that it gets there"
    )
    reference: str | None = Field(
        None, description="frame in which target and normal are given, which stands; null: base"
    )
    normal: Triple = Field(description="of the surface, towards the robot; of any length")
    force_n: float = Field(gt=0, description="with which it shall press")
    tolerance_n: float | None = Field(
        None,
        gt=0,
        description="error of the force at the end that counts as reached [N]; null: 5 % of "
        "`force_n`, at least 0.5",
    )
    sensor: str | None = Field(None, description="frame of the wrench sensor; null: `frame`")
    force_kp: float = Field(0.0, ge=0, description="of the error of the force")
    force_ki_per_s: float = Field(
        5.0, ge=0, description="of its integral, which adds or takes at most force_n"
    )
    force_kd: float = Field(
        0.0, ge=0, description="of the velocity along the normal while it touches [1/s]"
    )
    touch_n: float = Field(
        0.5, gt=0, description="force from which on it touches, until it is removed or begins anew"
    )

    @model_validator(mode="after")
    def _a_direction(self) -> Self:
        if not 1e-6 <= math.hypot(*self.normal) <= 1e6:
            raise ValueError("should have a normal that points somewhere, of a length near 1")
        return self


AnyTask = Annotated[
    PositionSettings | PoseSettings | PostureTaskSettings | ForceSettings,
    Field(discriminator="kind"),
]
