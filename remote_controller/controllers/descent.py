"""Controllers that make V = |e|²/2 of one task decrease at a chosen rate (QP12, section V)."""

from __future__ import annotations

from abc import abstractmethod
from typing import Literal

import numpy as np
from pydantic import Field

from protocol.description import RobotDescription
from protocol.messages import FloatArray, State
from remote_controller.controllers.controller import STATUS, VelocityController
from remote_controller.kinematics import Kinematics
from remote_controller.solvers import status
from remote_controller.tasks.com import ComTask

PSI_SCALES = {"inverse_sqrt_n": 0, "one": 1, "max_norm": 2}
CERTIFIED_RESIDUAL = 1e-9
ROUNDING = 1e-12  # of a speed relative to u_max


class DescentController(VelocityController):
    """Brings the centre of mass to a target; subclasses choose among the velocities that do.

    Raises:
        FrameNotFoundError: the robot does not have the task's frame.
    """

    class Parameters(VelocityController.Parameters):
        """Task, rate of decrease, and what is fed back."""

        frame: str = Field("r_sole", description="frame fixed to the ground")
        target_m: tuple[float, float, float] = Field(
            (0.01, 0.025, 0.2869), description="where the CoM shall be, in that frame [m]"
        )
        u_max_rad_s: float = Field(0.6, gt=0, description="joint speed that Ψ is scaled by")
        beta: float = Field(46.0, gt=0, description="β of R(q), (41) [1/m]")
        psi_scale: Literal["inverse_sqrt_n", "one", "max_norm"] = Field(
            "inverse_sqrt_n",
            description="Ψ = u_max·|∇V|₂·R/√n as (16) has it, without 1/√n, or u_max·|∇V|∞·R",
        )
        kinematics_from: Literal["measured", "reference"] = Field(
            "measured", description="joint positions that kinematics are computed from"
        )

    def __init__(self, description: RobotDescription, parameters: Parameters) -> None:
        super().__init__(description, parameters)
        self.kinematics = Kinematics(description)
        self.task = ComTask(self.kinematics, parameters.frame, np.array(parameters.target_m))
        self._from_reference = parameters.kinematics_from == "reference"
        self._least_margin = -ROUNDING * parameters.u_max_rad_s
        self.u = np.zeros(description.n)

    def velocity(self, state: State) -> FloatArray:
        """Joint velocities that decrease V, and their certificate."""
        self.kinematics.update(state.reference if self._from_reference else state.q)
        self.task.update(self.kinematics)
        command = self.command
        command.stamp_kinematics = self.now()
        command.solver_status = self._verdict(self.descend(command.certificate))
        return self.u

    @abstractmethod
    def descend(self, certificate: FloatArray) -> int:
        """Write u into `self.u` and (V, required V̇, predicted V̇, ρ, margin, residual).

        Returns:
            Status of the solver, one of `solvers.status`.
        """

    def _verdict(self, answer: int) -> int:
        """One of `STATUS`: what the certificate in `self.command` proves."""
        command = self.command
        if answer != status.OK:
            return STATUS["infeasible"]
        if command.v_rate_required == command.v_rate_predicted == 0.0:
            return STATUS["at_target"]
        optimal = command.kkt_residual <= CERTIFIED_RESIDUAL
        slow_enough = command.margin >= self._least_margin
        return STATUS["certified"] if optimal and slow_enough else STATUS["uncertified"]
