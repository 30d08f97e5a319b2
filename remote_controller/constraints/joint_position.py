"""Joints within their range, by equation (25)."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from hoap3.protocol.errors import ConfigError
from hoap3.protocol.messages import FloatArray, State
from hoap3.remote_controller.constraints.constraint import Constraint, PositionSource, positions
from hoap3.remote_controller.model.kinematics import Kinematics


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

    def prepare(self, parameters: Parameters, kinematics: Kinematics) -> None:
        """Size the buffers."""
        from hoap3.remote_controller.constraints.limit_kernels import narrow_to_range

        self._narrow_to_range = narrow_to_range
        self.check_rate(parameters.eta_per_s)
        names = self.description.joint_names
        kept = self.joint_indices(
            "joints", names if parameters.joints is None else parameters.joints
        )
        self._least, self._greatest = np.full(self.n, -np.inf), np.full(self.n, np.inf)
        self._least[kept] = self.description.lower[kept] + parameters.margin_rad
        self._greatest[kept] = self.description.upper[kept] - parameters.margin_rad
        for joint in kept:
            if self._least[joint] > self._greatest[joint]:
                width = float(self.description.upper[joint] - self.description.lower[joint])
                problem = f"leaves nothing of the range of joint {names[joint]!r}"
                remedy = f"At most {width / 2}"
                raise ConfigError("", "margin_rad", parameters.margin_rad, problem, remedy)
        self._eta = parameters.eta_per_s
        self._return_speed = parameters.return_speed_rad_s
        self._source = parameters.positions_from
        self.margins = np.full(2 * self.n, np.inf)
        self.margin_names = tuple(
            f"{name} {end}" for end in ("lower", "upper") for name in self.description.joint_names
        )

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
