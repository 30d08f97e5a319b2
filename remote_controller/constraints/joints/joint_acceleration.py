"""Joints that speed up and brake no harder than a limit."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from pydantic import Field

from hoap3.protocol.messages import FloatArray, State
from hoap3.remote_controller.constraints.constraint import Constraint, Guarantee, Level
from hoap3.remote_controller.constraints.joints.limits import least_limits
from hoap3.remote_controller.constraints.joints.reference_velocity import ReferenceVelocity
from hoap3.remote_controller.model.kinematics import Kinematics


class JointAcceleration(Constraint):
    """|q̈_i| ≤ A_i [rad/s² or m/s²]; for velocities |u − u_before| ≤ A·T.

    u_before is what the robot's reference really did over the last period.
    """

    class Parameters(Constraint.Parameters):
        """Limits; none is above what the robot can do."""

        limit_rad_s2: float | None = Field(
            None,
            gt=0,
            description="A of every joint; none: the robot's setpoint_acceleration_max "
            "[rad/s² or m/s²]",
        )
        joints_rad_s2: dict[str, float] = Field(
            {}, description="other limits of single joints, 0 and above [rad/s² or m/s²]"
        )

    levels: ClassVar[tuple[Level, ...]] = ("velocity", "acceleration")
    guarantee: ClassVar[Guarantee] = "at the tick"

    def prepare(self, parameters: Parameters, kinematics: Kinematics) -> None:
        """Size the buffers."""
        from hoap3.remote_controller.constraints.limit_kernels import intersect_box

        self._intersect_box = intersect_box
        self._most = self.acceleration_max = least_limits(
            self,
            self.description.setpoint_acceleration_max,
            parameters.limit_rad_s2,
            parameters.joints_rad_s2,
            "joints_rad_s2",
        )
        self._least, self._change = -self._most, self._most * self.period_s
        self._before = ReferenceVelocity(self.n, self.period_s)
        self._lower, self._upper = np.zeros((2, self.n))

    def reset(self) -> None:
        """Forget how the reference moved."""
        super().reset()
        self._before.reset()

    def bounds(self, state: State, lower_out: FloatArray, upper_out: FloatArray) -> None:
        """Narrow to [u_before − AT, u_before + AT]."""
        before = self._before.update(state)
        np.subtract(before, self._change, out=self._lower)
        np.add(before, self._change, out=self._upper)
        self._intersect_box(self._lower, self._upper, lower_out, upper_out)

    def bound_accelerations(
        self, state: State, lower_out: FloatArray, upper_out: FloatArray
    ) -> None:
        """Narrow to [−A, A]."""
        self._intersect_box(self._least, self._most, lower_out, upper_out)
