"""The canonical QP12 as a controller: few joints or many, by one parameter (QP12, section V)."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from hoap3.protocol.description import RobotDescription
from hoap3.protocol.messages import FloatArray
from hoap3.remote_controller.controllers.qp12.lyapunov_descent import PSI_SCALES, DescentController


class Qp12Controller(DescentController):
    """min γ|u|₁ + (1−γ)/2·|u|₂² such that V̇ = −Ψ, each tick anew (40)."""

    class Parameters(DescentController.Parameters):
        """γ, and whether it falls near the target."""

        gamma: float = Field(0.5, ge=0, le=1, description="0: all joints; towards 1: few")
        adaptive_gamma: bool = Field(
            False, description="γ·(2/π)·atan(100·|∇V|) instead of γ: no chattering at the target"
        )

    def __init__(self, description: RobotDescription, parameters: Parameters) -> None:
        from hoap3.remote_controller.controllers.qp12.lyapunov_descent_kernels import (
            qp12_descent,
        )

        super().__init__(description, parameters)
        self._kernel = qp12_descent
        self._u_max = parameters.u_max_rad_s
        self._settings = (
            parameters.beta,
            PSI_SCALES[parameters.psi_scale],
            parameters.gamma,
            parameters.adaptive_gamma,
        )
        self.gradient = np.zeros(description.n)

    def descend(self, certificate: FloatArray) -> int:
        """Solve (40)."""
        task, u_max = self.task, self._u_max * self._ramp.share
        found = self._kernel(
            task.error, task.jacobian, u_max, *self._settings, self.gradient, self.u, certificate
        )
        certificate[4] += self._u_max - u_max  # the margin is that of u_max itself
        return int(found)
