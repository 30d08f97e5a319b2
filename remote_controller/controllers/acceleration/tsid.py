"""Task-space inverse dynamics for torque-controlled robots (Del Prete, IEEE RA-L 2018)."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, ClassVar

import numpy as np

from hoap3.protocol.description import RobotDescription
from hoap3.protocol.messages import FloatArray, Setpoint, State
from hoap3.remote_controller.controllers.acceleration_tasks import tsid_settings as settings
from hoap3.remote_controller.controllers.acceleration_tasks.frame_goals import default_pose, pose_of
from hoap3.remote_controller.controllers.acceleration_tasks.joint_bounds import JointBounds
from hoap3.remote_controller.controllers.base import STATUS, Controller
from hoap3.remote_controller.default_task import default_goal
from hoap3.remote_controller.model.frame_dynamics import FrameDynamics
from hoap3.remote_controller.references.postures import posture_of
from hoap3.remote_controller.solvers.base import status
from hoap3.remote_controller.solvers.tsid.tsid import Tsid
from hoap3.remote_controller.tasks.accuracy import TaskError, angle_error, length_error

CERTIFIED_RESIDUAL = 1e-9
MARGIN_ROUNDING = 1e-9  # relative to the greatest acceleration or the effort
FALLBACKS = {status.OK: 0, status.INFEASIBLE: 1, status.UNSOLVED: 2}
NOT_FINITE, TOO_SMALL, UNSOLVED, HELD, HALF_A_TURN, OVERLOADED = (1 << bit for bit in range(6))


class TsidController(Controller):
    """A frame to a pose in SE(3), a posture in its null space, within bounds: (33) and (34).

        min |ν̇_d − J·ddq − J̇·dq|² + w·|ddq_p − ddq|²
        such that lower ≤ ddq ≤ upper, |M·ddq + h| ≤ effort

    with ν̇_d = kp·log(H⁻¹H_d) − kd·ν, in the frame's axes, and ddq_p = kp·(q_r − q) − kd·dq. The
    command is the torque τ = M·ddq + h, less g(q) where the robot adds that; or ddq, for a robot
    that takes accelerations.

    Where the efforts are too small for the bounds, these are kept, the efforts violated as little
    as possible, and `fallback` is 1; 2 where the solver gave up, and ddq is that of the posture,
    cut to the bounds.

    Certificate: V = ½|log(H⁻¹H_d)|² [m², rad²]. A QP of accelerations does not prescribe how fast V
    falls: `v_rate_predicted` is V̇ half a period on, and `v_rate_required` is 0 where V does not
    rise in this period, else how fast it may. `certified` says that the QP was solved, by a
    residual ≤ 10⁻⁹ (`tsid_kernels.prove`), and that its bounds leave each joint able to stop: with
    `naive` and `none`, and where a joint cannot even hold its load, |h| > effort, it is
    `uncertified`. `margin` is the least distance from a bound, relative to
    the greatest acceleration or the effort: 0 where one is reached.

    Raises:
        ConfigError: a goal, a posture or bounds that do not fit the robot.
        FrameNotFoundError: the robot has no such frame.
    """

    Parameters: ClassVar[Any] = settings.Parameters
    extra_names = ("largest_torque_share",)
    commands = ("torque", "acceleration")
    kernels = (
        "hoap3.protocol.robot.viability_bounds_kernels",
        "hoap3.remote_controller.model.frame_dynamics_kernels",
        "hoap3.remote_controller.solvers.tsid.tsid_kernels",
        "hoap3.remote_controller.tasks.se3_kernels",
        "hoap3.remote_controller.controllers.acceleration_tasks.se3_pd_kernels",
    )

    def __init__(self, description: RobotDescription, parameters: settings.Parameters) -> None:
        from hoap3.remote_controller.controllers.acceleration_tasks import se3_pd_kernels as kernels

        super().__init__(description, parameters)
        n = description.n
        self._check_finite, self._se3_pd = kernels.check_finite, kernels.se3_pd
        self._prepare, self._finish = kernels.prepare, kernels.finish
        self._not_finite, self._half_a_turn = kernels.NOT_FINITE, kernels.AT_HALF_A_TURN
        self.dynamics, self.goal = _target(description, parameters)
        self.bounds = JointBounds(description, parameters.bounds)
        self.solver = Tsid(np.array(description.effort), self.bounds.greatest)
        rest = parameters.posture
        wanted = rest.posture, rest.posture_rad
        self._posture = posture_of(description, *wanted, "posture.posture")
        self._task_gains, self._posture_gains = parameters.task.both, rest.both
        self._weight = rest.weight
        self._viable = parameters.bounds.kind == "viability"
        self._damping = self.dynamics.damping * float(parameters.compensate_friction)
        torque = self.kind == "torque"
        self._given = self.solver.tau if torque else self.solver.ddq
        self._less = self.dynamics.weight if torque else np.zeros(n)
        self._dt = description.period_s
        self._turn = np.zeros((3, 3))
        self.error, self._wanted, self._slope = np.zeros((3, 6))
        self._joint_wanted, self._load = np.zeros(n), np.zeros(n)
        self._effort = np.array(description.effort)
        self._tolerances = parameters.tolerance_m, parameters.tolerance_deg
        self.certifies, self.margin_tolerance = self._viable, MARGIN_ROUNDING
        self.conditions = (
            "state not finite",
            "torques too small",
            "QP not solved",
            "held by bounds of joints",
            "half a turn from the goal",
            "cannot hold its load",
        )

    def task_errors(self) -> list[TaskError]:
        """Distance of the frame to its goal, and angle."""
        length_m, angle_deg = self._tolerances
        found = length_error(self.error[:3], length_m) + angle_error(self.error[3:], angle_deg)
        return [replace(each, task=self.dynamics.frame) for each in found]

    def reset(self, state: State, last_command: FloatArray | None) -> None:
        """Nothing to remember; a joint that is outside its bounds here may stay there."""
        del last_command
        self.bounds.begin(state.q)

    def step(self, state: State) -> Setpoint:
        """Torques, or accelerations, for one period."""
        command, dynamics, bounds, solver = self.command, self.dynamics, self.bounds, self.solver
        q, dq = state.q, state.dq
        if self._check_finite(q, dq) == self._not_finite:
            command.stamp_kinematics = self.now()
            return self.refuse(NOT_FINITE)
        dynamics.update(q, dq)
        bounds.update(q, dq)
        V, where = self._se3_pd(
            dynamics.origin,
            dynamics.rotation,
            *self.goal,
            dynamics.twist,
            dynamics.drift,
            *self._task_gains,
            self._turn,
            self.error,
            self._wanted,
            self._slope,
        )
        self._prepare(
            q,
            dq,
            self._posture,
            *self._posture_gains,
            self._damping,
            self._dt,
            dynamics.mass,
            dynamics.bias,
            self._joint_wanted,
        )
        command.stamp_kinematics = self.now()
        found = solver.solve(
            dynamics.jacobian,
            self._wanted,
            self._weight,
            self._joint_wanted,
            dynamics.mass,
            dynamics.bias,
            bounds.lower,
            bounds.upper,
        )
        np.abs(dynamics.bias, out=self._load)
        overloaded = bool((self._load > self._effort).any())
        rate, growth, command.active_joints = self._finish(
            self._slope,
            dynamics.jacobian,
            dynamics.twist,
            dynamics.drift,
            dq,
            solver.ddq,
            self._given,
            self._less,
            self._dt,
            command.values,
        )
        self.present = (
            (TOO_SMALL if found == status.INFEASIBLE else 0)
            | (UNSOLVED if found == status.UNSOLVED else 0)
            | (HELD if solver.held else 0)
            | (HALF_A_TURN if where == self._half_a_turn else 0)
            | (OVERLOADED if overloaded else 0)
        )
        self._certify(V, rate, growth, found, overloaded)
        return command

    def _certify(self, V: float, rate: float, growth: float, found: int, overloaded: bool) -> None:
        """Write what is proved of the answer."""
        command, solver = self.command, self.solver
        command.v, command.v_rate_predicted = V, rate
        command.v_rate_required, command.rho = max(growth, 0.0), 1.0
        command.margin = min(solver.margin, 1.0)
        command.solver_path = command.fallback = FALLBACKS[found]
        command.extra[0] = 1.0 - solver.torque_margin
        if found != status.OK:
            command.kkt_residual = 0.0
            command.solver_status = STATUS["infeasible"]
            return
        command.kkt_residual = solver.kkt_residual
        proven = solver.kkt_residual <= CERTIFIED_RESIDUAL and self._viable and not overloaded
        command.solver_status = STATUS["certified" if proven else "uncertified"]


def _target(
    description: RobotDescription, parameters: settings.Parameters
) -> tuple[FrameDynamics, tuple[FloatArray, FloatArray]]:
    """Dynamics of the frame of a config, or of the robot's default task, and H_d."""
    frame, goal, key = parameters.frame, parameters.goal, "goal"
    if goal is None:
        default = default_goal(description, key, frame)
        pose = default_pose(description, default, key)
        return FrameDynamics(description, default.point), pose
    dynamics = FrameDynamics(description, str(frame))
    return dynamics, pose_of(description, dynamics, str(frame), goal, key)
