"""Generalized hierarchical control with torques as the tasks' variables (its paper, section 8)."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from pydantic import Field

from hoap3.protocol.config.changeable import CHANGEABLE
from hoap3.protocol.messages import FloatArray
from hoap3.protocol.robot.description import RobotDescription
from hoap3.remote_controller.controllers.acceleration.ghc import (
    ProjectedParameters,
    RankedController,
)
from hoap3.remote_controller.solvers.base import status
from hoap3.remote_controller.solvers.ghc.ghc import Ghc


class GhcTorqueController(RankedController):
    """Every task has torques of its own, kept out of what would accelerate others.

        min Σ |J_i M⁻¹ τ_i′ − b_i|² + ω_r Σ |τ_i′|²
        such that τ = h + Σ P_i τ_i′, M ddq = τ − h, lower ≤ ddq ≤ upper, |τ| ≤ torque_max

    P_i is the generalized projector of the rows J_j M⁻¹: torques of a task that another stands
    strictly above do not accelerate that other. It is the problem of `ghc` with J M⁻¹ for J, τ − h
    for ddq and M⁻¹ for M, and is solved as such. Without mass, ω_r compares torques with
    accelerations: the heavier the robot, the smaller it has to be.
    """

    class Parameters(ProjectedParameters):
        """And what ω_r weighs."""

        w_r: float = Field(
            1e-4,
            ge=1e-8,
            le=1e3,
            description="ω_r: weight of the tasks' torques; less is more exact, but livelier",
            json_schema_extra=CHANGEABLE,
        )

    proves = True
    stands_free = False
    kernels: ClassVar[tuple[str, ...]] = (
        *RankedController.kernels,
        "hoap3.remote_controller.controllers.acceleration.torque_rows_kernels",
        "hoap3.remote_controller.solvers.ghc.ghc_kernels",
    )

    def __init__(
        self, description: RobotDescription, parameters: Any, file: str = "config"
    ) -> None:
        from hoap3.remote_controller.controllers.acceleration.torque_rows_kernels import torque_rows

        super().__init__(description, parameters, file)
        n, sizes = description.n, [*self.tasks.sizes, description.n]
        self.solver = Ghc(
            sizes,
            n,
            regularise="none",
            smoothing=parameters.smoothing,
            rows=len(self.stack.rows),
        )
        self._torque_rows, self._factor = torque_rows, np.zeros((n, n))
        self._rows, self._no_bias = np.zeros((sum(sizes), n)), np.zeros(n)
        self._inverse = self._rows[-n:]  # of what brakes J is I: there J M⁻¹ is M⁻¹

    def solve(self, torque_max: FloatArray) -> bool:
        """One compiled call, in which torques and accelerations have changed places."""
        solver, tasks = self.solver, self.tasks
        jacobian, wanted = tasks.with_rest
        mass, bias = tasks.dynamics.mass, tasks.dynamics.bias
        if not self._torque_rows(jacobian, mass, self._factor, self._rows):
            return False
        np.subtract(torque_max, bias, out=solver.qdd_upper)
        np.add(torque_max, bias, out=solver.qdd_lower)
        np.negative(solver.qdd_lower, out=solver.qdd_lower)
        solver.tau_lower[:], solver.tau_upper[:] = self.lower, self.upper
        if self._keeps:
            stack = self.stack
            np.matmul(stack.rows, self._inverse, out=solver.rows)  # of τ − h, as ddq = M⁻¹(τ − h)
            solver.rows_lower[:], solver.rows_upper[:] = stack.rows_lower, stack.rows_upper
        found = solver.solve(self._rows, wanted, self.alpha, self._inverse, self._no_bias, self.w_r)
        np.add(solver.qdd, bias, out=self.tau)
        self.ddq[:], self.residual = solver.tau, solver.kkt_residual
        return found == status.OK
