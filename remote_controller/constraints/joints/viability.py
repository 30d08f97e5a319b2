"""Range, speed and braking of joints together."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from pydantic import Field

from hoap3.protocol.errors import BadProblemError, ConfigError
from hoap3.protocol.limits.viability_bounds import AccelerationBounds
from hoap3.protocol.messages import FloatArray, State
from hoap3.remote_controller.constraints.constraint import Constraint, Guarantee, Level
from hoap3.remote_controller.constraints.joints.joint_range import JointRange
from hoap3.remote_controller.constraints.joints.reference_velocity import ReferenceVelocity
from hoap3.remote_controller.model.kinematics import Kinematics

ROUNDING = 1e-13
"""Kept from the ends of a range by velocities, so that q + u·T is not beyond it [rad or m]."""


class Viability(Constraint):
    """A joint always is able to stop before the end of its range; margins in rad (m if prismatic).

    For accelerations these are the bounds of Del Prete 2018 (`AccelerationBounds`), of the measured
    state. For velocities u may differ by A·T from what the reference did over the last period, may
    not exceed the speed, and must let the joint come to rest in steps of A·T before the end.
    """

    class Parameters(Constraint.Parameters):
        """Limits; none is above what the robot can do."""

        limit_rad_s: float | None = Field(
            None, gt=0, description="greatest speed; none: the robot's own [rad/s or m/s]"
        )
        limit_rad_s2: float | None = Field(
            None,
            gt=0,
            description="A; none: what the robot brakes with, no more than its "
            "setpoint_acceleration_max [rad/s² or m/s²]",
        )
        margin_rad: float = Field(
            0.0, ge=0, description="taken off both ends of the usable range [rad or m]"
        )
        horizon_periods: float = Field(
            2.0,
            ge=1,
            description="periods that an acceleration may be held; at a wall 1 chatters, 2 rests",
        )

    levels: ClassVar[tuple[Level, ...]] = ("velocity", "acceleration")
    guarantee: ClassVar[Guarantee] = "invariant"

    def prepare(self, parameters: Parameters, kinematics: Kinematics) -> None:
        """Size the buffers."""
        from hoap3.remote_controller.constraints import limit_kernels as kernels
        from hoap3.remote_controller.constraints.joints.viability_kernels import velocity_bounds

        self._intersect_box, self._velocity_bounds = kernels.intersect_box, velocity_bounds
        robot, most = self.description, np.inf
        self._range = JointRange(self, parameters.margin_rad, robot.joint_names)
        speed = np.minimum(robot.velocity, parameters.limit_rad_s or most)
        brake = np.minimum(robot.brake_acceleration, robot.setpoint_acceleration_max)
        brake = np.minimum(brake, parameters.limit_rad_s2 or most)
        self._limits = np.array([self._range.least, self._range.greatest, speed, brake])
        self.speed_max, self.acceleration_max = self._limits[2], self._limits[3]
        self._inside = self._limits.copy()
        self._inside[0] += ROUNDING
        self._inside[1] -= ROUNDING
        self._before = ReferenceVelocity(self.n, self.period_s)
        self._lower, self._upper = np.zeros((2, self.n))
        self._horizon_s = parameters.horizon_periods * self.period_s

    def reset(self) -> None:
        """Forget how the reference moved."""
        super().reset()
        self._before.reset()

    def bounds(self, state: State, lower_out: FloatArray, upper_out: FloatArray) -> None:
        """Narrow to what lets each joint stop in time."""
        q, before = state.reference, self._before.update(state)
        limits = self._inside, self.period_s
        self._velocity_bounds(q, before, *limits, self._lower, self._upper)
        self._intersect_box(self._lower, self._upper, lower_out, upper_out)
        self.watch(self._range.measure(q))

    def prepare_accelerations(self, speed: FloatArray, deceleration: FloatArray) -> None:
        """Build the bounds."""
        least, greatest, most, _ = self._limits
        self._bounds = acceleration_bounds(
            self, least, greatest, most, deceleration, self._horizon_s
        )

    def bound_accelerations(
        self, state: State, lower_out: FloatArray, upper_out: FloatArray
    ) -> None:
        """Narrow to what lets each joint stop in time."""
        self._bounds.solve(state.q, state.dq, self._lower, self._upper)
        self._intersect_box(self._lower, self._upper, lower_out, upper_out)
        self.watch(self._range.measure(state.q))


def acceleration_bounds(
    constraint: Constraint,
    least: FloatArray,
    greatest: FloatArray,
    speed: FloatArray,
    brake: FloatArray,
    horizon_s: float,
) -> AccelerationBounds:
    """Bounds of Del Prete 2018 for a range (n,), speeds and accelerations that may be had.

    Raises:
        ConfigError: they violate condition (11).
    """
    try:
        return AccelerationBounds(
            least,
            greatest,
            speed,
            brake,
            constraint.period_s,
            horizon_s=horizon_s,
            names=constraint.description.joint_names,
        )
    except BadProblemError as error:
        problem = str(error).rstrip(".")
        remedy = "Limit accelerations by joint_acceleration, or speeds less"
        raise ConfigError("", "", None, problem, remedy) from error
