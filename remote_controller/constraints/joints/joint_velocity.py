"""Joints no faster than a limit (QP12, section III-E, first case)."""

from __future__ import annotations

from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field

from hoap3.protocol.config.changeable import CHANGEABLE, GREATEST_SPEED
from hoap3.protocol.errors import ConfigError
from hoap3.protocol.messages import FloatArray, State
from hoap3.remote_controller.constraints.constraint import Constraint, Guarantee, Level
from hoap3.remote_controller.constraints.joints.limits import least_limits
from hoap3.remote_controller.model.kinematics import Kinematics


class JointVelocity(Constraint):
    """|u_i| ≤ ω_i [rad/s or m/s]: bounds without rows, and without a margin of the position.

    For accelerations: |q̇ + T·q̈| ≤ ω; a joint that is faster brakes with what it can.
    """

    class Parameters(Constraint.Parameters):
        """Limits; none is above what the robot can do."""

        limit_rad_s: Annotated[float | None, GREATEST_SPEED] = Field(
            None,
            gt=0,
            description="ω of every joint; none: the robot's own [rad/s or m/s]",
            json_schema_extra=CHANGEABLE,
        )
        joints_rad_s: dict[str, float] = Field(
            {}, description="other limits of single joints, 0 and above [rad/s or m/s]"
        )

    levels: ClassVar[tuple[Level, ...]] = ("velocity", "acceleration")
    guarantee: ClassVar[Guarantee] = "invariant"

    def prepare(self, parameters: Parameters, kinematics: Kinematics) -> None:
        """Size the buffers."""
        from hoap3.remote_controller.constraints import limit_kernels as kernels

        self._intersect_box, self._change_within = kernels.intersect_box, kernels.change_within
        self._first = np.full(self.n, np.inf)  # what limits must not exceed
        self._lower, self._upper = np.zeros((2, self.n))
        self.speed_max = self._upper
        self.apply(parameters)

    def apply(self, parameters: Parameters) -> None:
        """Read ω; limits above those to which η of rows of accelerations was fitted are refused."""
        limits = self._limits(parameters)
        above = limits > self._first
        if above.any():
            joint = int(np.argmax(above))
            problem = "is above the limit that other constraints reckon with"
            remedy = f"At most {self._first[joint]}, that of the config"
            raise ConfigError("", "limit_rad_s", parameters.limit_rad_s, problem, remedy)
        self._upper[:] = limits
        np.negative(self._upper, out=self._lower)

    def _limits(self, parameters: Parameters) -> FloatArray:
        own, all_of_them = parameters.joints_rad_s, parameters.limit_rad_s
        return least_limits(self, self.description.velocity, all_of_them, own, "joints_rad_s")

    def bounds(self, state: State, lower_out: FloatArray, upper_out: FloatArray) -> None:
        """Narrow to [−ω, ω]."""
        self._intersect_box(self._lower, self._upper, lower_out, upper_out)

    def prepare_accelerations(self, speed: FloatArray, deceleration: FloatArray) -> None:
        """Keep what joints brake with."""
        self._brake, self._first = deceleration, self._upper.copy()

    def bound_accelerations(
        self, state: State, lower_out: FloatArray, upper_out: FloatArray
    ) -> None:
        """Narrow to [(−ω − q̇)/T, (ω − q̇)/T]."""
        self._change_within(state.dq, self._upper, self._brake, self.period_s, lower_out, upper_out)
