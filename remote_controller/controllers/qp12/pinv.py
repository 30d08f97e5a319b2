"""The pseudo-inverse of the task Jacobian as a controller: the paper's peer PINV."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from pydantic import Field

from hoap3.protocol.config.changeable import CHANGEABLE
from hoap3.protocol.description import RobotDescription
from hoap3.protocol.messages import FloatArray
from hoap3.remote_controller.controllers.qp12.lyapunov_descent import (
    DescentController,
    beta_per_m,
)
from hoap3.remote_controller.controllers.servo_rate import loop_rate


class PinvController(DescentController):
    """u along −J⁺e: scaled to the V̇ that QP12 has, or plainly u = −k·J⁺e."""

    class Parameters(DescentController.Parameters):
        """How fast."""

        law: Literal["lyapunov", "plain"] = Field(
            "lyapunov", description="lyapunov: V̇ = −Ψ, a fair comparison; plain: u = −k·J⁺e"
        )
        gain_per_s: float = Field(
            10.0, gt=0, description="k of the plain law [1/s]", json_schema_extra=CHANGEABLE
        )

    def __init__(self, description: RobotDescription, parameters: Parameters) -> None:
        from hoap3.remote_controller.controllers.qp12.lyapunov_descent_kernels import pinv_descent
        from hoap3.remote_controller.solvers.qp12.pinv_kernels import work_shape

        super().__init__(description, parameters)
        self._kernel = pinv_descent
        self._work = np.zeros(work_shape(3, description.n))

    def tune(self, parameters: Any) -> None:
        """Take k as well."""
        super().tune(parameters)
        self._gain = parameters.gain_per_s if parameters.law == "plain" else 0.0

    def fastest(self, parameters: Any, jacobian: FloatArray) -> float:
        """The rate of the plain law, or of the pseudo-inverse with V̇ = −Ψ [1/s]."""
        if parameters.law == "plain":
            return float(parameters.gain_per_s)
        scales = parameters.u_max_rad_s, beta_per_m(parameters)
        return loop_rate(parameters.psi_scale, scales, jacobian, pseudo_inverse=True)

    def descend(self, certificate: FloatArray) -> int:
        """Find u, and what it does to V."""
        task, u_max = self.task, self._u_max * self._ramp.share
        found = self._kernel(
            task.error,
            task.jacobian,
            u_max,
            *self._rate,
            self._gain * self._ramp.share,
            self._work,
            self.gradient,
            self.u,
            certificate,
        )
        certificate[4] += self._u_max - u_max  # the margin is that of u_max itself
        return int(found)
