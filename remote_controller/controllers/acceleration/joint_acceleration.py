"""Joint-space acceleration control within bounds that keep the limits (Del Prete, RA-L 2018)."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from hoap3.protocol.config.changeable import CHANGEABLE, CRITICAL_DAMPING
from hoap3.protocol.messages import FloatArray, Setpoint, State
from hoap3.protocol.robot.description import RobotDescription
from hoap3.remote_controller.controllers.acceleration.joint_bounds import (
    BoundSettings,
    JointBounds,
)
from hoap3.remote_controller.controllers.base import STATUS, Controller
from hoap3.remote_controller.references.postures import PostureValues, posture_of
from hoap3.remote_controller.tasks.accuracy import (
    TOLERANCE_DEG,
    TOLERANCE_M,
    JointToleranceDeg,
    JointToleranceM,
    TaskError,
    joint_errors,
    prismatic_joints,
)

MARGIN_ROUNDING = 1e-9  # relative to the greatest acceleration
HELD = 1  # solver_path: some joint is held by a bound; 0: none


class JointAccelerationController(Controller):
    """min |ddq_d − ddq|² within bounds, ddq_d = kp·(q_r − q) − kd·dq: (31) and (32).

    The bounds couple no joints, so the answer is ddq_d cut to them. A robot that takes positions
    gets the motion that it leads to, q + T·dq + T²/2·ddq, where (q, dq) is the commanded state, not
    the measured one: it starts with the robot's applied reference, and does so again whenever the
    robot applied something else than what was sent.

    Certificate: V = ½|q − q_r|². `v_rate_predicted` is e·Δq/T of this step. `v_rate_required` is 0
    where V does not rise in it, and by how fast it does where it was moving away: then no more is
    claimed than that. `certified` says that, and that the acceleration is the optimum, and within
    bounds that leave each joint able to stop; with `naive` and `none` they do not, so it is
    `uncertified`. `margin` is the least distance from a bound, relative to the
    greatest acceleration; 0 where a joint is at one.

    Raises:
        ConfigError: a posture that the robot does not have, or bounds that do not fit it.
    """

    class Parameters(PostureValues, Controller.Parameters):
        """Where to, how fast, and within what."""

        posture: str | None = Field(
            None, description="q_r, one of the robot's description; null: where it starts"
        )
        posture_rad: tuple[float, ...] = Field((), description="q_r itself instead [rad or m]")
        tolerance_deg: JointToleranceDeg = TOLERANCE_DEG
        tolerance_m: JointToleranceM = TOLERANCE_M
        kp: float = Field(
            100.0, gt=0, description="of q_r − q [1/s²]", json_schema_extra=CHANGEABLE
        )
        kd: Annotated[float | None, CRITICAL_DAMPING] = Field(
            None, ge=0, description="of dq [1/s]; null: 2√kp", json_schema_extra=CHANGEABLE
        )
        bounds: BoundSettings = Field(BoundSettings(), description="of the accelerations")

    commands = ("acceleration", "position")
    kernels = (
        "hoap3.protocol.limits.viability_bounds_kernels",
        "hoap3.remote_controller.controllers.acceleration.joint_acceleration_kernels",
    )

    def __init__(self, description: RobotDescription, parameters: Parameters) -> None:
        from hoap3.remote_controller.controllers.acceleration import (
            joint_acceleration_kernels as kernels,
        )

        self.arrays = {"decision": description.n}
        super().__init__(description, parameters)
        self._follow_reference = kernels.follow_reference
        self._accelerate_to = kernels.accelerate_to
        wanted = parameters.posture, parameters.posture_rad
        self._target = posture_of(description, *wanted, "posture")
        self._bounds = JointBounds(description, parameters.bounds)
        self._viable = parameters.bounds.kind == "viability"
        self._prismatic = prismatic_joints(description)
        self.apply(parameters)
        self.certifies, self.margin_tolerance = self._viable, MARGIN_ROUNDING
        self._positions = self.kind == "position"
        self._dt, n = description.period_s, description.n
        self._q, self._dq, self._before, self._next, self._ddq = np.zeros((5, n))
        self._sent = np.full(n, np.nan)
        self._tick = -1
        self.conditions = ("state not finite", "held by bounds of joints")

    def apply(self, parameters: Any) -> None:
        """Read gains, tolerances and the greatest speed."""
        kd = 2.0 * math.sqrt(parameters.kp) if parameters.kd is None else parameters.kd
        self._gains = parameters.kp, kd
        self._tolerances = parameters.tolerance_m, parameters.tolerance_deg
        self._bounds.apply(parameters.bounds)

    def validate(self, parameters: Any) -> None:
        """Refuse bounds that do not fit the robot."""
        super().validate(parameters)
        self._bounds.validate(parameters.bounds)

    def margin_of(self) -> tuple[str, str]:
        """The bounds."""
        return "bounds of joints", "of the greatest acceleration"

    def task_errors(self) -> list[TaskError]:
        """The greatest error of any joint."""
        error = self._target - self._q
        found = joint_errors(error, self._prismatic, *self._tolerances)
        return [replace(each, task="posture") for each in found]

    def reset(self, state: State, last_command: FloatArray | None) -> None:
        """Begin with the motion that the robot has: its reference, as fast as its joints move."""
        del last_command
        self.forget_changes()
        self._bounds.begin(state.reference)
        self._sent[:], self._tick = np.nan, -1

    def step(self, state: State) -> Setpoint:
        """Accelerate for one period."""
        self.advance(state)
        command = self.command
        if self._positions:
            elapsed = (state.tick - self._tick) * self._dt
            if self._tick < 0:
                self._dq[:], elapsed = state.dq, 0.0
            finite = self._follow_reference(
                state.reference, self._before, self._sent, self._q, elapsed, self._dq
            )
            self._tick = state.tick
        else:
            self._q[:], self._dq[:] = state.q, state.dq
            finite = math.isfinite(self._q @ self._dq)
        command.stamp_kinematics = self.now()
        if not finite:
            self._tick, self._sent[:] = -1, np.nan  # the next State begins anew
            return self.refuse(1)
        bounds = self._bounds
        bounds.update(self._q, self._dq)
        V, rate, growth, active, margin, resting = self._accelerate_to(
            self._q,
            self._dq,
            self._target,
            *self._gains,
            bounds.lower,
            bounds.upper,
            bounds.greatest,
            self._dt,
            self._ddq,
            self._next,
            self._dq,
        )
        if self._positions:
            self._sent[:] = self._next
        command.values[:] = self._next if self._positions else self._ddq
        command.decision[:] = self._ddq
        command.v, command.v_rate_predicted = V, rate
        command.v_rate_required = 0.0 if resting else max(growth, 0.0)
        command.rho, command.kkt_residual, command.margin = 1.0, 0.0, margin
        held = margin <= 0.0
        command.active_joints, command.solver_path = active, HELD if held else 0
        self.present = 2 if held else 0
        proven = "at_target" if resting else "certified"
        command.solver_status = STATUS[proven if self._viable else "uncertified"]
        return command
