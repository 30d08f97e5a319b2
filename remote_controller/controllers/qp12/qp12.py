"""The canonical QP12 as a controller: few joints or many, by one parameter (QP12, section V)."""

from __future__ import annotations

from typing import Any, ClassVar

from hoap3.protocol.description import RobotDescription
from hoap3.protocol.messages import FloatArray
from hoap3.remote_controller.controllers.qp12.lyapunov_descent import (
    DescentController,
    GammaParameters,
    gamma_slope,
)


class Qp12Controller(DescentController):
    """min γ|u|₁ + (1−γ)/2·|u|₂² such that V̇ = −Ψ, each tick anew (40)."""

    Parameters: ClassVar[Any] = GammaParameters

    def __init__(self, description: RobotDescription, parameters: GammaParameters) -> None:
        from hoap3.remote_controller.controllers.qp12.lyapunov_descent_kernels import qp12_descent

        super().__init__(description, parameters)
        self._kernel = qp12_descent

    def tune(self, parameters: Any) -> None:
        """Take γ as well."""
        super().tune(parameters)
        self._settings = *self._rate, parameters.gamma, gamma_slope(parameters)

    def descend(self, certificate: FloatArray) -> int:
        """Solve (40)."""
        task, u_max = self.task, self._u_max * self._ramp.share
        found = self._kernel(
            task.error, task.jacobian, u_max, *self._settings, self.gradient, self.u, certificate
        )
        certificate[4] += self._u_max - u_max  # the margin is that of u_max itself
        return int(found)
