"""The QP12 of `qp12` solved by OSQP: the paper's peer OSQP as a controller (Table I)."""

from __future__ import annotations

from typing import Any

from pydantic import Field

from hoap3.protocol.description import RobotDescription
from hoap3.protocol.errors import SolverError
from hoap3.protocol.messages import FloatArray, State
from hoap3.remote_controller.controllers.qp12.lyapunov_descent import (
    DescentController,
    GammaParameters,
    gamma_slope,
)
from hoap3.remote_controller.solvers.base import status


class OsqpController(DescentController):
    """min γ|u|₁ + (1−γ)/2·|u|₂² such that V̇ = −Ψ (40), each tick from the last answer.

    The certificate is computed from u, so where OSQP's answer is not the optimum to 10⁻⁹, as its
    tolerance allows, it is uncertified. Where it gives up, u = 0 and the cycle is infeasible.
    """

    class Parameters(GammaParameters):
        """γ as for `qp12`, and how hard OSQP tries."""

        tolerance: float = Field(
            1e-5,
            ge=1e-12,
            le=0.1,
            description="of OSQP, absolute and relative, on data scaled to about 1",
        )
        polish: bool = Field(
            True, description="solve once more for the joints that move: exact if they are right"
        )
        max_iterations: int = Field(
            1000, ge=1, le=100_000, description="after so many OSQP gives up, and u = 0"
        )

    extra_names = ("osqp_iterations",)

    def __init__(self, description: RobotDescription, parameters: Parameters) -> None:
        from hoap3.remote_controller.controllers.qp12.osqp_kernels import (
            osqp_certificate,
            osqp_problem,
        )
        from hoap3.remote_controller.solvers.qp12.osqp_qp12 import OsqpQp12

        super().__init__(description, parameters)
        self.certifies = parameters.polish  # without it OSQP is not exact to 1e-9
        self._problem, self._certify = osqp_problem, osqp_certificate
        self._solver = OsqpQp12(
            description.n,
            parameters.tolerance,
            polish=parameters.polish,
            max_iterations=parameters.max_iterations,
        )

    def tune(self, parameters: Any) -> None:
        """Take γ as well."""
        super().tune(parameters)
        self._settings = *self._rate, parameters.gamma, gamma_slope(parameters)

    def reset(self, state: State, last_command: FloatArray | None) -> None:
        """Forget earlier answers, that OSQP would start from."""
        super().reset(state, last_command)
        self._solver.forget()

    def descend(self, certificate: FloatArray) -> int:
        """Solve (40)."""
        task, solver, found = self.task, self._solver, status.OK
        u_max = self._u_max * self._ramp.share
        decrease, gamma = self._problem(
            task.error, task.jacobian, u_max, *self._settings, self.gradient, certificate
        )
        try:
            solver.solve(self.gradient, decrease, gamma, self.u)
        except SolverError:
            found = status.INFEASIBLE
        self._certify(self.gradient, decrease, gamma, self._u_max, self.u, certificate)
        self.command.extra[0] = solver.iterations
        return found
