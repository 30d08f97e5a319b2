"""Joints within their range, by equation (25)."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from protocol.description import RobotDescription
from protocol.errors import ConfigError
from protocol.messages import FloatArray, State
from remote_controller.constraints.constraint import (
    Constraint,
    PositionSource,
    check_rate,
    positions,
)
from remote_controller.constraints.intervals import narrow
from remote_controller.kinematics import Kinematics


class JointPosition(Constraint):
    """−η(q − q_min) ≤ u ≤ η(q_max − q): bounds without rows; margins in rad (m if prismatic).

    Exact under Euler steps of length T for ηT ≤ 1, which is enforced. A joint outside its range
    returns at rate η, no faster than the return speed. q_min and q_max are the usable range of
    the description, less a margin.
    """

    class Parameters(Constraint.Parameters):
        """Range, and how fast its ends may be approached."""

        eta_per_s: float = Field(10.0, gt=0, description="η of (25), at most 1/period [1/s]")
        margin_rad: float = Field(
            0.0, ge=0, description="taken off both ends of the usable range [rad or m]"
        )
        return_speed_rad_s: float = Field(
            0.1, gt=0, description="fastest return from outside [rad/s or m/s]"
        )
        joints: tuple[str, ...] | None = Field(None, description="by name; none: all of them")
        positions_from: PositionSource = Field(
            "reference", description="joint positions that are kept in range"
        )

    def __init__(
        self,
        parameters: Parameters,
        description: RobotDescription,
        kinematics: Kinematics,
        period_s: float,
    ) -> None:
        super().__init__(parameters, description, kinematics, period_s)
        check_rate(parameters.eta_per_s, period_s)
        named = description.joint_names if parameters.joints is None else parameters.joints
        kept = self.joint_indices("joints", named)
        self._least, self._greatest = np.full(self.n, -np.inf), np.full(self.n, np.inf)
        self._least[kept] = description.lower[kept] + parameters.margin_rad
        self._greatest[kept] = description.upper[kept] - parameters.margin_rad
        for joint in kept:
            if self._least[joint] > self._greatest[joint]:
                width = float(description.upper[joint] - description.lower[joint])
                raise ConfigError(
                    "",
                    "margin_rad",
                    parameters.margin_rad,
                    f"leaves nothing of the range of joint {description.joint_names[joint]!r}",
                    f"At most {width / 2}",
                )
        self._eta = parameters.eta_per_s
        self._return_speed = parameters.return_speed_rad_s
        self._source = parameters.positions_from
        self.margins = np.full(2 * self.n, np.inf)
        self.margin_names = tuple(
            f"{name} {end}" for end in ("lower", "upper") for name in description.joint_names
        )
        self._lower, self._upper = np.zeros(self.n), np.zeros(self.n)

    def bounds(self, state: State, lower_out: FloatArray, upper_out: FloatArray) -> None:
        """Narrow by (25)."""
        q = positions(state, self._source)
        above, below = self.margins[: self.n], self.margins[self.n :]
        np.subtract(q, self._least, out=above)
        np.subtract(self._greatest, q, out=below)
        np.multiply(above, -self._eta, out=self._lower)
        np.multiply(below, self._eta, out=self._upper)
        np.minimum(self._lower, self._return_speed, out=self._lower)
        np.maximum(self._upper, -self._return_speed, out=self._upper)
        narrow(lower_out, upper_out, self._lower, self._upper)
        self.watch()
