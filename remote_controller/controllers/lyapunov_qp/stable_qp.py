"""The general controller, stable by design: any task, Φ, Ψ and constraints (QP12, problem (3))."""

from __future__ import annotations

import math
from typing import Any, ClassVar, Self, cast, get_args

import numpy as np

from hoap3.protocol.errors import ConfigError, located
from hoap3.protocol.messages import FloatArray, State
from hoap3.protocol.robot.description import RobotDescription
from hoap3.remote_controller.constraints import registry as constraints
from hoap3.remote_controller.controllers.base import (
    CERTIFIED_RESIDUAL,
    VIOLATED,
    VelocityController,
)
from hoap3.remote_controller.controllers.lyapunov_qp import settings
from hoap3.remote_controller.controllers.lyapunov_qp.diagnostics import Diagnostics
from hoap3.remote_controller.controllers.lyapunov_qp.objective import check_objective, solver_of
from hoap3.remote_controller.controllers.ramp import Ramp
from hoap3.remote_controller.controllers.servo_rate import loop_rate, refuse_too_fast, too_fast
from hoap3.remote_controller.default_task import default_goal
from hoap3.remote_controller.model.kinematics import Kinematics
from hoap3.remote_controller.scheduling.changes import part_of
from hoap3.remote_controller.solvers.base import status
from hoap3.remote_controller.solvers.lyapunov_qp.descent_rate import FORMS, BoundedForm
from hoap3.remote_controller.solvers.lyapunov_qp.max_descent_lp import MaxDescentLp
from hoap3.remote_controller.solvers.lyapunov_qp.stable_qp import STILL
from hoap3.remote_controller.tasks import registry as tasks
from hoap3.remote_controller.tasks.accuracy import TaskError, name_errors
from hoap3.remote_controller.tasks.curve_following.curve_following import PersistentMotion
from hoap3.remote_controller.tasks.lyapunov import LyapunovFunction
from hoap3.remote_controller.tasks.task_function import TaskFunction

PROVEN = (status.OK, status.STATIONARY)
ANSWERED = (*PROVEN, status.CANNOT_DESCEND, status.DESCENDS_FASTER)
HELD = (*ANSWERED, status.ZERO_GRADIENT)  # what the solver gives is followed; else the robot brakes
NO_CHOICE = {status.INFEASIBLE_CONSTRAINTS, status.CANNOT_DESCEND, status.DESCENDS_FASTER}
ROUNDING = 1e-9  # of V̇ relative to what is required, and of a speed [rad/s or m/s]
SPARED = 0.1  # of the speeds along a curve that constraints leave, where ζ is none of them
CURVATURE = 1e-6  # of a margin: what one Euler step of a curved constraint may overstep


class StableQpController(VelocityController):
    """min Φ(u) such that V̇ = −ρΨ within the constraints; ρ ≤ 1 is what they leave of Ψ.

    With `rho: largest` ρ is (6); `damped`, the default, asks for no more of it than is worth its
    speed (`solvers.lyapunov_qp.stable_qp`), so that the robot comes to rest where V can fall no
    further.

    On a curve (`joint_curve`, `task_curve`) the motion along it is one more equation, (23). Where
    the constraints leave less than ζ, as at rest, it gathers speed with most of what they do.

    A cycle is certified if V̇ is what is required, −ρΨ with 0 ≤ ρ ≤ 1, the answer is optimal to
    10⁻⁹ and no constraint is violated. What stands in the way of it is one of `conditions`: the
    solver's statuses, the task's, and those of each constraint.

    Where there is no answer, as no u keeps the constraints or a part of them is NaN, the robot
    does not jump to rest: all joints brake together, in a straight line, at the braking limit of
    one, and only then is an answer followed again.

    Raises:
        ConfigError: a task, a constraint or an objective that does not fit the robot.
    """

    Parameters: ClassVar[Any] = settings.Parameters
    extra_names = ("psi", "drift", "solver_status")
    kernels = (
        "hoap3.remote_controller.controllers.progress_kernels",
        "hoap3.remote_controller.solvers.lyapunov_qp.lyapunov_qp_kernels",
        "hoap3.remote_controller.solvers.lyapunov_qp.dual_newton_kernels",
        "hoap3.remote_controller.solvers.lyapunov_qp.kkt_residual_kernels",
        "hoap3.remote_controller.solvers.lyapunov_qp.descent_rate_kernels",
        "hoap3.remote_controller.solvers.lyapunov_qp.lp_norm_kernels",
        "hoap3.remote_controller.solvers.lyapunov_qp.row_projection_kernels",
        "hoap3.remote_controller.constraints.limit_kernels",
        "hoap3.remote_controller.constraints.joints.viability_kernels",
        "hoap3.remote_controller.constraints.collision.distance_kernels",
        "hoap3.remote_controller.constraints.frames.fixed_frame_kernels",
        "hoap3.remote_controller.references.approach_kernels",
        "hoap3.remote_controller.tasks.lyapunov_kernels",
        "hoap3.remote_controller.tasks.se3_kernels",
        "hoap3.remote_controller.tasks.curve_following.curve_kernels",
    )

    def __init__(
        self, description: RobotDescription, parameters: settings.Parameters, file: str = "config"
    ) -> None:
        from hoap3.remote_controller.solvers.lyapunov_qp.descent_rate_kernels import rate_kernel

        self._default = None if parameters.task else default_goal(description, "task")
        task = (
            self._default.settings if self._default else cast(tasks.TaskSettings, parameters.task)
        )
        super().__init__(description, parameters)
        self.kinematics = Kinematics(description)
        self.function = tasks.build(task, description, self.kinematics, file, "parameters.task")
        self.stack = constraints.build(
            parameters.constraints, description, self.kinematics, description.period_s, file
        )
        curve = self.function if isinstance(self.function, PersistentMotion) else None
        self._curve = curve
        m, k, n = len(self.stack.b), len(self.stack.c), description.n
        self._along = MaxDescentLp(n, m, k)
        self._C = np.zeros((k + (curve is not None), n))
        self._c = np.zeros(len(self._C))
        self._solver = solver_of(parameters, description, m, len(self._C))
        self.u = self._solver.u
        self._adaptive = getattr(parameters.objective, "adaptive_gamma", False)
        self._M, self._y = self._squares(parameters)
        self._equality = parameters.lyapunov == "equality"
        self._rate_kernel, psi = rate_kernel, parameters.psi
        self.apply(parameters)
        self._ramp = Ramp(psi.ramp_s, description.period_s)
        self._watch = Diagnostics(self.stack)
        self.conditions = self._watch.names
        self._violation = 1 << len(self.conditions)
        if self.function.watched:
            self.conditions = (*self.conditions, VIOLATED)
        self.margin_tolerance = CURVATURE if parameters.constraints else None
        self._task_name, self._file = task.task, file
        task_parts = part_of(self.function, ("task",), ("task",)) if parameters.task else []
        self.parts = [*task_parts, *self.stack.parts()]
        self._begun = False
        self._brake_step = description.brake_acceleration * self._dt
        self._last, self._stopping = np.zeros(n), status.OK
        self._earlier_last, self._earlier_stopping = np.zeros(n), status.OK
        self._answered = -1
        self._goal = task
        self._at_start: FloatArray | None = None  # the task's Jacobian, without weights
        if description.servo_rate_1_s is not None:
            self.kinematics.update(description.initial_position)
            self.function.reset(self.kinematics, 0.0)
            self.function.update(self.kinematics, 0.0)
            self._at_start = _jacobian_of(self.function)
            fastest = self._fastest_rate(parameters)
            self.heed_servos(too_fast(description, fastest, parameters.kinematics_from))
        bounds = self.stack.lower, self.stack.upper
        followed = self._followed_tasks(task)
        self._find = self.watch_progress(followed, bounds, self.stack.labels, self._ends).find
        self.leave_singularities(parameters)

    def _followed_tasks(self, task: tasks.TaskSettings) -> list[tasks.FollowedTask]:
        """Return the task, if it has an error."""
        rows, base = slice(0, len(self.function.error)), self.description.base_frame
        return [tasks.followed_task(task.task, task, rows, self.function.accuracy, base)][
            : rows.stop
        ]

    def notes(self) -> list[str]:
        """Add what the robot's default task moves, how far, and how fast."""
        found, goal = super().notes(), self._default
        if goal is not None:
            self.kinematics.update(self.description.initial_position)
            self.function.reset(self.kinematics, 0.0)
            self.function.update(self.kinematics, 0.0)
            away = float(np.linalg.norm(self.function.error))
            found.append(f"default task: {goal.point!r} moves {away:.3g} m in {goal.reference!r}")
        return found

    def apply(self, parameters: Any) -> None:
        """Read γ, the gain, and Ψ."""
        self._gamma = getattr(parameters.objective, "gamma", 0.0)
        self._slope = getattr(parameters.objective, "gamma_slope", 0.0)
        self._gain = getattr(parameters.objective, "gain_per_s", 0.0)
        if isinstance(parameters.objective, settings.Qp12Objective) and not self._adaptive:
            self._solver.gamma = self._gamma
        self._psi = FORMS.index(parameters.psi.form), *_scales_of(parameters.psi)

    def validate(self, parameters: Any) -> None:
        """Refuse a law that becomes too fast for the robot's servos, by Ψ or the task's weights."""
        super().validate(parameters)
        refuse_too_fast(self, self._fastest_rate(parameters), parameters.kinematics_from)

    def _fastest_rate(self, parameters: Any) -> float:
        jacobian = self._at_start
        if jacobian is None:
            return math.inf
        if isinstance(self.function, TaskFunction):
            given = tasks.check_parameters(parameters.task or self._goal)
            with located("", "task.parameters"):
                jacobian = self.function.weighted(jacobian, given)
        return loop_rate(parameters.psi.form, _scales_of(parameters.psi), jacobian)

    @classmethod
    def configured(cls, description: RobotDescription, parameters: Any, file: str) -> Self:
        """One for a robot."""
        return cls(description, parameters, file)

    @classmethod
    def check(cls, parameters: Any, file: str) -> None:
        """Refuse parts that are wrong for any robot."""
        if parameters.task is not None:
            tasks.check_parameters(parameters.task, file, "parameters.task")
        constraints.read(parameters.constraints, file)
        with located(file, "parameters"):
            check_objective(parameters)

    def margin_of(self) -> tuple[str, str]:
        """The nearest constraint; where none has a margin, bounds or limits of speed."""
        if self.stack.margin() < math.inf:
            return self.stack.tightest_with_unit()
        if len(self.stack.b):
            return "bounds of joints, or rows", ""
        return "speeds of joints", "rad/s or m/s"

    def task_errors(self) -> list[TaskError]:
        """Errors of the task."""
        errors = name_errors(self.function.accuracy(), self._task_name)
        return [self.explained(error, self._task_name) for error in errors]

    def reset(self, state: State, last_command: FloatArray | None) -> None:
        """Begin anew at the next State that is finite."""
        super().reset(state, last_command)
        self._begun = False
        self._last[:], self._stopping = 0.0, status.OK
        self._answered = -1

    def _begin(self, state: State) -> None:
        """Have the task start where the robot is, and ρ at 1; `kinematics` is up to date."""
        self.function.reset(self.kinematics, state.tick * self._dt)
        self.stack.reset()
        self._ramp.restart()
        self._solver.forget()
        self._begun = True

    def velocity(self, state: State) -> FloatArray:
        """Joint velocities, and their certificate."""
        function, stack, solver, command = self.function, self.stack, self._solver, self.command
        if not np.isfinite(state.q @ state.reference):
            return self._refuse()
        self._recall(state.tick)
        self.kinematics.update(state.reference if self._from_reference else state.q)
        if not self._begun:
            self._begin(state)
        violated = function.watched and state.mode == State.ACTIVE and self._violated(state)
        function.update(self.kinematics, state.tick * self._dt)
        stack.update(self.kinematics, state)
        command.stamp_kinematics = self.now()
        V, gradient, drift = function.value, function.gradient, function.rate
        error = math.sqrt(2.0 * V) if V >= 0.0 else math.nan
        self._ramp.advance(state)
        psi = self._rate_kernel(*self._psi, V, gradient, error) * self._ramp.share
        if self._adaptive:
            slope = self._slope * math.sqrt(gradient @ gradient)
            solver.gamma = 2.0 * self._gamma / math.pi * math.atan(slope)
        rejected = stack.reject(gradient)
        self._equations()
        if self._y is not None and self._curve is None:
            np.multiply(function.error, -self._gain, out=self._y)
        problem = (
            gradient,
            psi,
            drift,
            stack.A,
            stack.b,
            stack.lower,
            stack.upper,
            self._C,
            self._c,
            self._M,
            self._y,
        )
        found, slower = solver.solve(*problem), False
        if self._curve is not None and found in NO_CHOICE and not self._stopping:
            slower = self._slow_down(self._curve)
            found = solver.solve(*problem) if slower else found
        if found not in HELD or self._stopping:
            found = self._brake(found)
        self._last[:] = self.u
        share = solver.rho if self._equality else 1.0  # V̇ ≤ 0 asks for no share of Ψ
        present = self._watch.look(found, share, function.status, gradient, self.u)
        errors, rows = (function.error, function.jacobian, 1.0), self._watch.constraints_of(present)
        self.present = present | self._find(
            state.tick, errors, self.u, reference=state.reference, rows=rows
        )
        self._certify(V, psi, drift, found, bool(rejected))
        if slower and self._curve is not None and self._c[-1] < self._curve.speed:
            self.present |= self._watch.held_along(self._curve.motion_row, self._along.v)
        if violated:
            self.present |= self._violation
        return self.u

    def gradient_at(self, q: FloatArray, time_s: float) -> FloatArray:
        """Evaluate the task at joint positions; return ∇V."""
        self.kinematics.update(q)
        self.function.update(self.kinematics, time_s)
        return self.function.gradient

    def leave_singularities(self, parameters: Any) -> None:
        """Leave stationary points if the parameters ask for it.

        Raises:
            ConfigError: constraints have rows, which the motion would not keep.
        """
        if parameters.leave_singularity and (len(self.stack.b) or len(self._C)):
            problem = "is not available with constraints other than bounds of joints, nor on curves"
            key, remedy = "parameters.leave_singularity", "Remove this key, or those constraints"
            raise ConfigError(self._file, key, True, problem, remedy)
        super().leave_singularities(parameters)

    def _recall(self, tick: int) -> None:
        """Know what was known before a State, also where it comes once more."""
        if tick == self._answered:
            self._last[:], self._stopping = self._earlier_last, self._earlier_stopping
        else:
            self._earlier_last[:], self._earlier_stopping = self._last, self._stopping
        self._answered = tick

    def _violated(self, state: State) -> bool:
        """Whether a tolerance of the task is, or was, violated by the robot as it was measured."""
        kinematics = self.kinematics
        if self._from_reference:
            kinematics.update(state.q)
        violated = self.function.watch(kinematics, state.tick, state.tick * self._dt)
        if self._from_reference:
            kinematics.update(state.reference)
        return violated

    def _brake(self, found: int) -> int:
        """Come nearer to rest, as far as the bounds allow, and go on until there; why."""
        why = self._stopping or found
        periods = float(np.max(np.abs(self._last) / self._brake_step))
        share = 1.0 - 1.0 / periods if periods > 1.0 else 0.0
        self._stopping = why if share else status.OK
        np.multiply(self._last, share, out=self.u)
        np.fmax(self.u, self.stack.lower, out=self.u)  # a bound that is NaN is none
        np.fmin(self.u, self.stack.upper, out=self.u)
        return why

    def _refuse(self) -> FloatArray:
        """Nothing to follow for a State that is not finite."""
        command, u = self.command, self.refuse_velocity(0)
        command.solver_path, command.extra[2] = STILL, status.BAD_INPUT
        self.present = self._watch.look(status.BAD_INPUT, 1.0, 0, u, u)
        return u

    def _equations(self) -> None:
        """C u = c of the constraints, and of the motion along a curve."""
        k, curve = len(self.stack.c), self._curve
        if k:
            self._C[:k], self._c[:k] = self.stack.C, self.stack.c
        if curve is not None:
            self._C[k], self._c[k] = curve.motion_row, curve.speed

    def _slow_down(self, curve: PersistentMotion) -> bool:
        """Take the speed next to ζ of those that constraints leave, if any; but for some at an end.

        At the very end u has no choice left, and V may rise.
        """
        stack, along = self.stack, self._along
        along.fill(curve.motion_row, stack.A, stack.b, stack.C, stack.c, stack.lower, stack.upper)
        (one, fallen), (other, most) = along.fall(1.0), along.fall(-1.0)  # v stays that of the most
        if not {one, other} <= {status.OK, status.UNBOUNDED}:
            return False
        least, most = -fallen * along.top, most * along.top
        room = min(most - least, 2.0 * most, 2.0 * max(abs(least), curve.speed))
        spared = SPARED * max(room, 0.0)
        self._c[-1] = min(max(curve.speed, least + spared), most - spared)
        return bool(self._c[-1] != curve.speed)

    def _squares(
        self, parameters: settings.Parameters
    ) -> tuple[FloatArray | None, FloatArray | None]:
        """M and y of ½|M u − y|², or none."""
        if not isinstance(parameters.objective, settings.LeastSquares):
            return None, None
        if self._curve is not None:
            return self._curve.objective_rows, np.zeros(len(self._curve.objective_rows))
        if not self.function.error.size:
            problem = "needs a task with an error e, and this one gives V only"
            remedy = "Choose qp12 or lp, or give the task an error and its Jacobian"
            raise ConfigError("", "objective.kind", "least_squares", problem, remedy)
        return self.function.jacobian, np.zeros(self.function.error.size)

    def _certify(self, V: float, psi: float, drift: float, found: int, rejected: bool) -> None:
        """Write what is proved of u."""
        solver, command = self._solver, self.command
        share = min(solver.rho, 1.0)
        command.v, command.rho = V, share
        required = -share * psi if self._equality else 0.0
        command.v_rate_required, command.v_rate_predicted = required, solver.rate
        command.margin = margin = self._least_margin()
        command.kkt_residual = solver.kkt_residual
        command.solver_path = solver.path
        command.extra[:] = psi, drift, found
        answered = found in ANSWERED
        if not answered:
            command.rho = command.v_rate_required = command.v_rate_predicted = 0.0
            command.kkt_residual = 0.0
        proven = (
            found in PROVEN
            and not rejected
            and share >= 0.0
            and self._falls(solver.rate, required)
            and solver.kkt_residual <= CERTIFIED_RESIDUAL
            and solver.margin >= -ROUNDING
            and margin >= -CURVATURE
            and not self.is_stationary
        )
        arrived = psi == drift == 0.0 and solver.path == STILL and found == status.OK
        arrived = arrived and not self.is_stationary
        arrived = arrived and all(error.within for error in self.function.accuracy())
        self.judge(solved=answered, at_target=arrived, proven=proven)

    def _falls(self, rate: float, required: float) -> bool:
        """Whether V̇ is −ρΨ, or with Remark 1 not above 0."""
        short = rate - required
        return (abs(short) if self._equality else short) <= ROUNDING * abs(required)

    def _least_margin(self) -> float:
        """Of the constraints, else of the bounds on u, else of the robot's speed limits."""
        margin = min(self.stack.margin(), math.inf)
        if margin == math.inf:
            margin = self._solver.margin
        if margin == math.inf:
            margin = float((self._fastest - np.abs(self.u)).min())
        return margin if math.isfinite(margin) else 0.0


def _scales_of(psi: settings.RateSettings) -> tuple[float, float]:
    """u_max and β of (16), or η and κ of the other forms."""
    bounded = psi.form in get_args(BoundedForm)
    return (psi.u_max_rad_s, psi.beta) if bounded else (psi.eta_per_s, psi.kappa)


def _jacobian_of(function: LyapunovFunction) -> FloatArray | None:
    """∂e/∂q where it is now, without weights, (m, n); None of a V that is none of |e|²/2."""
    source = function.task if isinstance(function, TaskFunction) else function
    jacobian = getattr(source, "jacobian", None)
    return None if jacobian is None or not jacobian.size else jacobian.copy()
