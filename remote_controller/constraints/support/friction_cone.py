"""The force from the ground within the cone of friction."""

from __future__ import annotations

import math

import numpy as np
from pydantic import Field

from hoap3.protocol.errors import ConfigError, one_of
from hoap3.protocol.messages import FloatArray
from hoap3.remote_controller.constraints.support.com_motion import ComMotion
from hoap3.remote_controller.model.kinematics import Kinematics


class FrictionCone(ComMotion):
    """|f_xy| ≤ μ·f_z of the force f = m(c̈ + g·ẑ) under a sole that stands, in its frame, z up.

    Within the cone stands a pyramid of k faces, d_j·f_xy ≤ μ·cos(π/k)·f_z for d_j at angles 2πj/k:
    with μ' = μ·cos(π/k), d_j·c̈_xy − μ'·c̈_z ≤ μ'·g, linear in c̈ as `ComMotion` has it. It implies
    f_z ≥ 0. The margin is that of the force which the last period really had, a mass [m/s²].

    For a robot whose whole force the one sole carries: its base frame is a sole, and nothing else
    touches anything.
    """

    margin_unit = "m/s²"

    class Parameters(ComMotion.Parameters):
        """Friction and pyramid."""

        mu: float = Field(0.5, gt=0, le=10, description="μ, coefficient of friction")
        faces: int = Field(8, ge=4, le=64, description="k of the pyramid inside the cone")
        sole: str | None = Field(None, description="that stands; none: the base frame's")

    def prepare(self, parameters: Parameters, kinematics: Kinematics) -> None:
        """Size the buffers."""
        super().prepare(parameters, kinematics)
        robot, k = self.description, parameters.faces
        soles = [sole.frame for sole in robot.soles]
        name = parameters.sole or robot.base_frame
        if name not in soles:
            remedy = one_of(name, soles, "Soles") if soles else "Leave this constraint out"
            raise ConfigError("", "sole", name, f"is no sole of robot {robot.name!r}", remedy)
        self._share = parameters.mu * math.cos(math.pi / k)
        angles = 2.0 * np.pi * np.arange(k) / k
        self._faces = np.stack((np.cos(angles), np.sin(angles), np.full(k, -self._share)), axis=1)
        self.name_rows(tuple(f"face {face}" for face in range(k)), kinematics.frame_id(name))

    def judge(self, com: FloatArray, change: FloatArray) -> None:
        """Write μ'(g + c̈_z) − d_j·c̈_xy."""
        np.dot(self._faces, change, out=self.margins)
        self.margins /= -self.period_s
        self.margins += self._share * self._gravity

    def limit(self, A_out: FloatArray, b_out: FloatArray, T: float) -> bool:
        """Write (d_j, −μ')·J ≤ μ'gT."""
        np.dot(self._faces, self.jacobian, out=A_out)
        b_out[:] = self._share * self._gravity * T
        return True

    def of(self, motion: FloatArray) -> FloatArray:
        """d_j·c̈_xy − μ'·c̈_z."""
        found: FloatArray = self._faces @ motion
        return found
