"""Joints no faster than a limit (QP12, section III-E, first case)."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from hoap3.protocol.errors import ConfigError
from hoap3.protocol.messages import FloatArray, State
from hoap3.remote_controller.constraints.constraint import Constraint
from hoap3.remote_controller.model.kinematics import Kinematics


class JointVelocity(Constraint):
    """|u_i| ≤ ω_i [rad/s or m/s]: bounds without rows, and without a margin of the position."""

    class Parameters(Constraint.Parameters):
        """Limits; none is above what the robot can do."""

        limit_rad_s: float | None = Field(
            None, gt=0, description="ω of every joint; none: the robot's own [rad/s or m/s]"
        )
        joints_rad_s: dict[str, float] = Field(
            {}, description="other limits of single joints, 0 and above [rad/s or m/s]"
        )

    def prepare(self, parameters: Parameters, kinematics: Kinematics) -> None:
        """Size the buffers."""
        from hoap3.remote_controller.constraints.limit_kernels import intersect_box

        self._intersect_box = intersect_box
        own = parameters.joints_rad_s
        wanted = np.full(self.n, parameters.limit_rad_s or np.inf)
        for name, joint in zip(own, self.joint_indices("joints_rad_s", own), strict=True):
            if own[name] < 0.0:
                key, remedy = f"joints_rad_s.{name}", "Write 0 or more"
                raise ConfigError("", key, own[name], "is negative", remedy)
            wanted[joint] = own[name]
        self._upper = np.minimum(wanted, self.description.velocity)
        self._lower = -self._upper

    def bounds(self, state: State, lower_out: FloatArray, upper_out: FloatArray) -> None:
        """Narrow to [−ω, ω]."""
        self._intersect_box(self._lower, self._upper, lower_out, upper_out)
