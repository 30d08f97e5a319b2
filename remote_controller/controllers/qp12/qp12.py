"""Controllers that make V = |e|²/2 of one point decrease at a chosen rate (QP12, section V).

`qp12`: few joints or many, by one parameter; and its peers of the paper, `osqp` and `pinv`.
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import replace
from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import Field, ValidationInfo, field_validator
from pydantic_core import PydanticCustomError

from hoap3.protocol.config.changeable import CHANGEABLE
from hoap3.protocol.errors import ConfigError, SolverError
from hoap3.protocol.messages import FloatArray, State
from hoap3.protocol.robot.description import COM, RobotDescription
from hoap3.remote_controller.controllers.base import CERTIFIED_RESIDUAL, VelocityController
from hoap3.remote_controller.controllers.ramp import Ramp, RampTime
from hoap3.remote_controller.controllers.servo_rate import loop_rate, refuse_too_fast, too_fast
from hoap3.remote_controller.controllers.singularity import LeaveSingularity
from hoap3.remote_controller.default_task import default_goal
from hoap3.remote_controller.model.kinematics import Kinematics
from hoap3.remote_controller.solvers.base import status
from hoap3.remote_controller.solvers.lyapunov_qp import descent_rate
from hoap3.remote_controller.solvers.lyapunov_qp.descent_rate import FORMS, BoundedForm
from hoap3.remote_controller.tasks.accuracy import TOLERANCE_M, TaskError
from hoap3.remote_controller.tasks.com import ComTask
from hoap3.remote_controller.tasks.frames.frame_position import FramePositionTask
from hoap3.remote_controller.tasks.registry import AXES, FollowedTask

ROUNDING = 1e-12  # of a speed relative to u_max


class DescentController(VelocityController):
    """Brings the centre of mass, or a frame, to a target; subclasses choose how the joints move.

    Raises:
        FrameNotFoundError: the robot does not have a frame of the task.
        ConfigError: the task is not named in full, and the robot has no default task.
    """

    class Parameters(VelocityController.Parameters):
        """Task, rate of decrease, and what is fed back."""

        point: str | None = Field(
            None,
            description="what is brought to the target: com, or a frame; null: that of the "
            "robot's default task",
        )
        reference_frame: str | None = Field(
            None,
            description="frame that the point is seen from; needs a point. null: that of the "
            "default task",
        )
        target_m: tuple[float, float, float] | None = Field(
            None, description="target position in that frame [m]; null: that of the default task"
        )
        tolerance_m: float = Field(
            TOLERANCE_M,
            gt=0,
            description="|e| at the end that counts as reached [m]",
            json_schema_extra=CHANGEABLE,
        )
        u_max_rad_s: float = Field(
            0.6, gt=0, description="joint speed that Ψ is scaled by", json_schema_extra=CHANGEABLE
        )
        beta: float = Field(
            46.0, gt=0, description="β of (41) [1/error_unit]", json_schema_extra=CHANGEABLE
        )
        error_unit: descent_rate.ErrorUnit = Field(
            "m",
            description="unit of e in (16), (41) and the adaptive γ; V, V̇ and tolerances stay in m",
        )
        psi_scale: BoundedForm = Field(
            "inverse_sqrt_n",
            description="Ψ = u_max·|∇V|₂·R/√n as (16) has it, without 1/√n, or u_max·|∇V|∞·R",
        )
        ramp_s: RampTime = 0.0
        kinematics_from: Literal["measured", "reference"] = Field(
            "measured", description="joint positions that kinematics are computed from"
        )
        leave_singularity: LeaveSingularity = False

        @field_validator("reference_frame")
        @classmethod
        def _check_point(cls, frame: str | None, info: ValidationInfo) -> str | None:
            if frame is not None and info.data.get("point", "") is None:
                problem = "is a frame of observation without a point"
                remedy = (
                    f"Add what moves: `point: com`, or `point: {frame}` with another frame here"
                )
                raise PydanticCustomError(
                    "point", "{problem}", {"problem": problem, "remedy": remedy}
                )
            return frame

    def __init__(self, description: RobotDescription, parameters: Parameters) -> None:
        parameters = _complete(parameters, description)
        super().__init__(description, parameters)
        self.kinematics = Kinematics(description)
        self.task = _task(self.kinematics, parameters)
        self._point = parameters.point or "task"
        self._ramp = Ramp(parameters.ramp_s, description.period_s)
        self._form = FORMS.index(parameters.psi_scale)
        self.apply(parameters)
        self.u, self.gradient = np.zeros((2, description.n))
        self._at_start: FloatArray | None = None  # the task's Jacobian
        if description.servo_rate_1_s is not None:
            self.kinematics.update(description.initial_position)
            self.task.update(self.kinematics)
            self._at_start = self.task.jacobian.copy()
            rate = self.fastest(parameters, self._at_start)
            self.heed_servos(too_fast(description, rate, parameters.kinematics_from))
        directions = tuple(f"{axis} of {parameters.reference_frame}" for axis in AXES)
        followed = FollowedTask(self._point, directions, slice(0, len(AXES)), self._accuracy)
        unbounded = np.full(description.n, np.inf)
        self._find = self.watch_progress([followed], (-unbounded, unbounded), ends=self._ends).find
        self.leave_singularities(parameters)

    def apply(self, parameters: Any) -> None:
        """Read u_max, β and the tolerance."""
        self.task.tolerance_m = parameters.tolerance_m
        self._u_max = parameters.u_max_rad_s
        self._rate = beta_per_m(parameters), self._form
        self._least_margin = -ROUNDING * self._u_max

    def validate(self, parameters: Any) -> None:
        """Refuse a law that becomes too fast for the robot's servos."""
        super().validate(parameters)
        if self._at_start is not None:
            rate = self.fastest(parameters, self._at_start)
            refuse_too_fast(self, rate, parameters.kinematics_from)

    def reset(self, state: State, last_command: FloatArray | None) -> None:
        """Begin again from rest."""
        super().reset(state, last_command)
        self._ramp.restart()

    def velocity(self, state: State) -> FloatArray:
        """Joint velocities that decrease V, and their certificate."""
        self._ramp.advance(state)
        self.kinematics.update(state.reference if self._from_reference else state.q)
        self.task.update(self.kinematics)
        command = self.command
        command.stamp_kinematics = self.now()
        found = self.descend(command.certificate)
        optimal = command.kkt_residual <= CERTIFIED_RESIDUAL
        errors = self.task.error, self.task.jacobian, 1.0
        self.present = self._find(state.tick, errors, self.u, reference=state.reference)
        within = 2.0 * command.v <= self.task.tolerance_m**2
        self.judge(
            solved=found == status.OK,
            at_target=within and command.v_rate_required == command.v_rate_predicted == 0.0,
            proven=optimal and not self.is_stationary and command.margin >= self._least_margin,
        )
        return self.u

    def gradient_at(self, q: FloatArray, _: float) -> FloatArray:
        """Evaluate the task at joint positions; return Jᵀe."""
        self.kinematics.update(q)
        self.task.update(self.kinematics)
        return self.task.jacobian.T @ self.task.error

    def task_errors(self) -> list[TaskError]:
        """|e|."""
        errors = [replace(error, task=self._point) for error in self._accuracy()]
        return [self.explained(error, self._point) for error in errors]

    def _accuracy(self) -> list[TaskError]:
        return self.task.accuracy(np.ones(len(self.task.error), np.bool_))

    def fastest(self, parameters: Any, jacobian: FloatArray) -> float:
        """The largest rate at which it corrects joints, for a Jacobian of the task [1/s]."""
        scales = parameters.u_max_rad_s, beta_per_m(parameters)
        return loop_rate(parameters.psi_scale, scales, jacobian)

    @abstractmethod
    def descend(self, certificate: FloatArray) -> int:
        """Write u into `self.u` and (V, required V̇, predicted V̇, ρ, margin, residual).

        Ψ is that of u_max times `self._ramp.share`.

        Returns:
            Status of the solver, one of `solvers.base.status`.
        """


class GammaParameters(DescentController.Parameters):
    """γ of (40), and whether it falls near the target."""

    gamma: float = Field(
        0.5,
        ge=0,
        le=1,
        description="0: all joints; towards 1: few",
        json_schema_extra=CHANGEABLE,
    )
    adaptive_gamma: bool = Field(
        False, description="γ·(2/π)·atan(gamma_slope·|∇V|) instead of γ: no chattering at the end"
    )
    gamma_slope: float = Field(
        descent_rate.GAMMA_SLOPE,
        gt=0,
        le=1e12,
        description="of the adaptive γ over |∇V| [rad/error_unit²]",
    )


class Qp12Controller(DescentController):
    """min γ|u|₁ + (1−γ)/2·|u|₂² such that V̇ = −Ψ, each tick anew (40)."""

    Parameters: ClassVar[Any] = GammaParameters

    def __init__(self, description: RobotDescription, parameters: GammaParameters) -> None:
        from hoap3.remote_controller.controllers.qp12.lyapunov_descent_kernels import qp12_descent

        super().__init__(description, parameters)
        self._kernel = qp12_descent

    def apply(self, parameters: Any) -> None:
        """Read γ as well."""
        super().apply(parameters)
        self._settings = *self._rate, parameters.gamma, gamma_slope(parameters)

    def descend(self, certificate: FloatArray) -> int:
        """Solve (40)."""
        task, u_max = self.task, self._u_max * self._ramp.share
        found = self._kernel(
            task.error, task.jacobian, u_max, *self._settings, self.gradient, self.u, certificate
        )
        certificate[4] += self._u_max - u_max  # the margin is that of u_max itself
        return int(found)


class OsqpController(Qp12Controller):
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

    def apply(self, parameters: Any) -> None:
        """Read k as well."""
        super().apply(parameters)
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


def beta_per_m(parameters: DescentController.Parameters) -> float:
    """β for e in metres [1/m]."""
    return parameters.beta * descent_rate.UNITS_PER_M[parameters.error_unit]


def gamma_slope(parameters: GammaParameters) -> float:
    """Slope of the adaptive γ over |∇V| in SI units [rad/m²]; 0 where γ is constant."""
    scale = descent_rate.UNITS_PER_M[parameters.error_unit]
    return parameters.gamma_slope * scale**2 if parameters.adaptive_gamma else 0.0


def _complete(
    parameters: DescentController.Parameters, description: RobotDescription
) -> DescentController.Parameters:
    """The parameters with what they leave to the robot's default task."""
    point, reference, target = parameters.point, parameters.reference_frame, parameters.target_m
    if point is None or reference is None or target is None:
        key = "target_m" if target is None else "reference_frame"
        goal = default_goal(description, key, point, reference)
        point, reference, target = goal.point, goal.reference, target or goal.target_m
    if point == reference:
        problem, remedy = "is the point itself, which never moves in it", "Name another frame"
        raise ConfigError("", "reference_frame", reference, problem, remedy)
    update = {"point": point, "reference_frame": reference, "target_m": target}
    return parameters.model_copy(update=update)


def _task(
    kinematics: Kinematics, parameters: DescentController.Parameters
) -> ComTask | FramePositionTask:
    """The task of complete parameters."""
    point, reference = str(parameters.point), str(parameters.reference_frame)
    target = np.array(parameters.target_m)
    if point == COM:
        return ComTask(kinematics, reference, target)
    return FramePositionTask(kinematics, point, reference, target)
