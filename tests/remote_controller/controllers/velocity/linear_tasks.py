"""A task that is linear in the first joints, and may be no number for a while."""

from __future__ import annotations

import math

import numpy as np
from pydantic import Field

from hoap3.protocol.config.settings import Settings
from hoap3.remote_controller.tasks.lyapunov import LyapunovFunction


class Linear(LyapunovFunction):
    """e = J (q − q₀) − d, q₀ where it began."""

    class Parameters(Settings):
        rows: tuple[tuple[float, ...], ...] = Field(description="J, of the first joints")
        target: tuple[float, ...] = Field(description="d")
        clouded_s: tuple[float, float] = Field((1e9, 1e9), description="when it is no number")

    def __init__(self, description, kinematics, parameters):
        rows, self.target = np.array(parameters.rows), np.array(parameters.target)
        super().__init__(description.n, len(rows))
        self.jacobian[:, : rows.shape[1]] = rows
        self.start, self.q = np.zeros((2, description.n))
        self.clouded = parameters.clouded_s

    def reset(self, kinematics, time_s):
        kinematics.joints(self.start)

    def update(self, kinematics, time_s):
        kinematics.joints(self.q)
        self.error[:] = self.jacobian @ (self.q - self.start) - self.target
        if self.clouded[0] <= time_s < self.clouded[1]:
            self.error[0] = math.nan
        self.value = 0.5 * float(self.error @ self.error)
        np.matmul(self.error, self.jacobian, out=self.gradient)
