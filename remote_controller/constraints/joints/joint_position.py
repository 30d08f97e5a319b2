"""Joints within their range, by equation (25)."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from pydantic import Field

from hoap3.protocol.config.changeable import CHANGEABLE
from hoap3.protocol.messages import FloatArray, State
from hoap3.remote_controller.constraints.constraint import (
    Constraint,
    Guarantee,
    Level,
    PositionSource,
    positions,
)
from hoap3.remote_controller.constraints.joints.joint_range import JointRange
from hoap3.remote_controller.constraints.joints.viability import acceleration_bounds
from hoap3.remote_controller.model.kinematics import Kinematics

HORIZON_PERIODS = 2.0  # for which an acceleration may be held: at a wall 1 chatters, 2 rests


class JointPosition(Constraint):
    """−η(q − q_min) ≤ u ≤ η(q_max − q): bounds without rows; margins in rad (m if prismatic).

    Exact under Euler steps of length T for ηT ≤ 1, which is enforced. A joint outside its range
    returns at rate η, no faster than the return speed. q_min and q_max are the usable range of
    the description, less a margin.

    For accelerations, of the measured state: those of Del Prete 2018 that can be held for two
    periods and leave the joint able to stop within its range, by what it brakes with; η and the
    return speed have no part in it.
    """

    class Parameters(Constraint.Parameters):
        """Range, and how fast its ends may be approached."""

        eta_per_s: float = Field(
            10.0,
            gt=0,
            description="η of (25), at most 1/period [1/s]",
            json_schema_extra=CHANGEABLE,
        )
        margin_rad: float = Field(
            0.0, ge=0, description="taken off both ends of the usable range [rad or m]"
        )
        return_speed_rad_s: float = Field(
            0.1,
            gt=0,
            description="fastest return from outside [rad/s or m/s]",
            json_schema_extra=CHANGEABLE,
        )
        joints: tuple[str, ...] | None = Field(None, description="by name; none: all of them")
        positions_from: PositionSource = Field(
            "reference", description="joint positions that are kept in range"
        )

    levels: ClassVar[tuple[Level, ...]] = ("velocity", "acceleration")
    guarantee: ClassVar[Guarantee] = "invariant"

    def prepare(self, parameters: Parameters, kinematics: Kinematics) -> None:
        """Size the buffers."""
        from hoap3.remote_controller.constraints import limit_kernels as kernels

        self._narrow_to_range, self._intersect_box = kernels.narrow_to_range, kernels.intersect_box
        names = self.description.joint_names if parameters.joints is None else parameters.joints
        self._range = JointRange(self, parameters.margin_rad, names)
        self._least, self._greatest = self._range.least, self._range.greatest
        self.apply(parameters)
        self._source = parameters.positions_from

    def apply(self, parameters: Parameters) -> None:
        """Read η and the speed of the return."""
        self._eta = self.rate_of(parameters)
        self._return_speed = parameters.return_speed_rad_s

    def bounds(self, state: State, lower_out: FloatArray, upper_out: FloatArray) -> None:
        """Narrow by (25)."""
        least = self._narrow_to_range(
            positions(state, self._source),
            self._least,
            self._greatest,
            self._eta,
            self._return_speed,
            self.margins,
            lower_out,
            upper_out,
        )
        self.watch(least)

    def prepare_accelerations(self, speed: FloatArray, deceleration: FloatArray) -> None:
        """Build the bounds."""
        anything, horizon_s = np.full(self.n, np.inf), HORIZON_PERIODS * self.period_s
        given = self._least, self._greatest, anything, deceleration, horizon_s
        self._bounds = acceleration_bounds(self, *given)
        self._lower, self._upper = np.zeros((2, self.n))

    def bound_accelerations(
        self, state: State, lower_out: FloatArray, upper_out: FloatArray
    ) -> None:
        """Narrow to what lets each joint stop in time."""
        self._bounds.solve(state.q, state.dq, self._lower, self._upper)
        self._intersect_box(self._lower, self._upper, lower_out, upper_out)
        self.watch(self._range.measure(state.q))
