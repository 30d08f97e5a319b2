"""Torques no greater than a limit."""

from __future__ import annotations

from typing import Annotated, ClassVar

from pydantic import Field

from hoap3.remote_controller.constraints.constraint import Constraint, Guarantee, Level
from hoap3.remote_controller.constraints.joints.limits import least_limits
from hoap3.remote_controller.model.kinematics import Kinematics


class JointTorque(Constraint):
    """|τ_i| ≤ τ_max,i [N m or N]: bounds of torques, for controllers that know the dynamics."""

    class Parameters(Constraint.Parameters):
        """Limits; none is above the robot's effort."""

        limit_nm: float | None = Field(
            None, gt=0, description="of every joint; none: the robot's effort [N m or N]"
        )
        joints_nm: dict[str, Annotated[float, Field(gt=0)]] = Field(
            {}, description="other limits of single joints [N m or N]"
        )

    levels: ClassVar[tuple[Level, ...]] = ("acceleration",)
    guarantee: ClassVar[Guarantee] = "at the tick"

    def prepare(self, parameters: Parameters, kinematics: Kinematics) -> None:
        """Size the buffers."""
        given = parameters.limit_nm, parameters.joints_nm
        self.torque_max = least_limits(self, self.description.effort, *given, "joints_nm")
