"""What controllers of several tasks have in common: all but how they weigh them up."""

from __future__ import annotations

import math
from abc import abstractmethod
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.errors import ConfigError, located
from hoap3.protocol.messages import FloatArray, Setpoint, State
from hoap3.protocol.robot.description import RobotDescription
from hoap3.remote_controller.constraints.acceleration_stack import KERNELS
from hoap3.remote_controller.constraints.registry import (
    build_accelerations,
    read,
)
from hoap3.remote_controller.constraints.stack import EventConditions
from hoap3.remote_controller.controllers.acceleration.problem import (
    CONDITIONS,
    GAVE_UP,
    HALF_A_TURN,
    HELD,
    IDLE,
    LOADED,
    MOVING,
    NEAREST,
    NOT_FINITE,
    OVERFLOWN,
    OVERLOADED_MOTORS,
    SOLVED,
    STOPPED,
    STOPS,
    TOO_SMALL,
    TOUCHES,
    UNPROVED,
    WHY,
    Problem,
)
from hoap3.remote_controller.controllers.acceleration.settings import (
    HierarchyParameters,
    RegularisedParameters,
    bounds_of,
)
from hoap3.remote_controller.controllers.acceleration.soles.free_base import FreeBase
from hoap3.remote_controller.controllers.acceleration.soles.settings import (
    ContactSettings,
    check_base,
)
from hoap3.remote_controller.controllers.base import STATUS, VIOLATED, Controller
from hoap3.remote_controller.model.kinematics import Kinematics
from hoap3.remote_controller.scheduling.schedule import Schedule
from hoap3.remote_controller.solvers.base import status
from hoap3.remote_controller.solvers.tsid.tsid import Tsid
from hoap3.remote_controller.tasks.accelerations.acceleration_tasks import AccelerationTasks
from hoap3.remote_controller.tasks.accelerations.free_tasks import FreeTasks
from hoap3.remote_controller.tasks.accuracy import ABSENT, LOWER, TaskError, name_errors

CERTIFIED_RESIDUAL = 1e-9
CURVATURE = 1e-6  # of a margin of constraints: what one period of a curved one may overstep
MARGIN_ROUNDING = 1e-9  # relative to the greatest acceleration or torque
FALLBACKS = {
    status.OK: NEAREST,
    status.INFEASIBLE: OVERLOADED_MOTORS,
    status.UNSOLVED: GAVE_UP,
    status.INFEASIBLE_CONSTRAINTS: STOPPED,
}
BRAKE_PER_S = 10.0  # of −dq, where not even the bounds of accelerations have an answer
UNCERTIFIED, INFEASIBLE = STATUS["uncertified"], STATUS["infeasible"]


class HierarchyController(Controller):
    """Tasks, each of which asks for accelerations of its own, by torques or accelerations.

    The command is the torque τ = M·ddq + h, less g(q) where the robot adds that; or ddq, for a
    robot that takes accelerations. h counts what wrench sensors of force tasks measure.

    What no task speaks of would coast: accelerations of 0 keep a velocity. A task of all joints
    that asks for −d·dq, d = `null_damping_per_s`, stands below those that take part; where they
    span the robot, as a posture does, it changes nothing.

    How much each task counts moves with the time of the robot's ticks since the reset. It is
    settled one tick ahead, so that a certificate knows of it.

    Where the tasks have no answer within the bounds of accelerations and torques, they are asked
    without the torques, or the robot brakes with −10/s·dq if that fails, too; the ddq nearest to
    it that the bounds and the torques allow is `fallback` 1. Where there is none, the bounds are
    kept, the torques violated as little as possible, and `fallback` is 2; or 3 where the solver
    gave up, and ddq is only cut to the bounds.

    Constraints are rows lower ≤ G·ddq ≤ upper beside the bounds, and the same is proved of them.
    Where bounds and rows have no common answer, or where the robot could not stop in time from the
    end of this period, all joints brake together instead, in a straight line: `fallback` is 4. That
    the motors have the torques for it is not looked at before: where one is at its end, the robot
    brakes as nearly so as they can, and `torques too small` says it.

    Certificate: V = ½ Σ |e|² of those tasks above which nothing stands [m², rad²], in a cycle
    without one of all that take part; of nobody else's error is anything said. `v_rate_predicted`
    is V̇ half a period on, and `v_rate_required` is 0 where V does not rise in this period, else how
    fast it may. `certified` says that the condensed problem was solved, by a residual ≤ 10⁻⁹,
    that its bounds leave each joint able to stop, that every joint can hold its load, that nothing
    touches, that some task takes part, that no constraint is violated, and that priorities are the
    same in the next tick. `margin` is the least distance from a bound, relative to the greatest
    acceleration or torque, or the least margin of a constraint, in its unit, if that is less.
    `solver_path` says what became of the tasks' problem, also where the robot stops.

    With `base: free` the robot stands on its soles and may fall. The problem is that of
    `soles.free_base.FreeBase`: contact and the equations of the base, which no motor moves, hold
    exactly in every answer; limits of joints, torques and cones are rows. What has no answer is
    solved without the bounds of the joints' accelerations (`fallback` 1); or, where torques and
    cones have none either, violates all as little as possible, torques cut to their limits (2).
    Where no sole carries, or nothing is found, joints brake by torques −10/s·M_jj·dq (3).
    `certified` says besides that v̇, τ and the wrenches w satisfy the equations to 10⁻⁹, that w is
    inside the cones and every sole carries; not that every joint can hold its load. `decision` has
    v̇ (base and joints), τ and w. `margin` counts the distance from the cones, by the weight.

    Raises:
        ConfigError: tasks, priorities or bounds that do not fit the robot, or each other.
    """

    Parameters: ClassVar[Any] = HierarchyParameters
    commands = ("torque", "acceleration")
    importance: Schedule
    proves: ClassVar[bool] = False
    """Whether `residual` is found without the solver's word."""
    stands_free: ClassVar[bool] = True
    """Whether its problem can be that of a free base on soles."""
    kernels: ClassVar[tuple[str, ...]] = (
        "hoap3.remote_controller.controllers.progress_kernels",
        "hoap3.protocol.limits.viability_bounds_kernels",
        "hoap3.remote_controller.model.frame_dynamics_kernels",
        "hoap3.remote_controller.references.approach_kernels",
        "hoap3.remote_controller.solvers.tsid.tsid_kernels",
        "hoap3.remote_controller.solvers.qp.active_set_kernels",
        *KERNELS,
        "hoap3.remote_controller.tasks.lyapunov_kernels",
        "hoap3.remote_controller.tasks.curve_following.curve_kernels",
        "hoap3.remote_controller.tasks.se3_kernels",
        "hoap3.remote_controller.tasks.accelerations.se3_pd_kernels",
        "hoap3.remote_controller.tasks.accelerations.wrench_kernels",
        "hoap3.remote_controller.tasks.accelerations.task_acceleration_kernels",
    )

    def __init__(
        self, description: RobotDescription, parameters: Any, file: str = "config"
    ) -> None:
        from hoap3.remote_controller.tasks.accelerations import se3_pd_kernels
        from hoap3.remote_controller.tasks.accelerations import (
            task_acceleration_kernels as kernels,
        )

        n, free = description.n, parameters.base == "free"
        with located(file, "parameters"):
            check_base(description, parameters, able=self.stands_free)
        self.importance = self.importance_of(parameters)
        self.bounds, self.torque_max = bounds_of(description, parameters.bounds)
        self.tasks: AccelerationTasks = (FreeTasks if free else AccelerationTasks)(
            description,
            parameters.tasks,
            file,
            self.torque_max,
            compensate_friction=parameters.compensate_friction,
        )
        self.stack = build_accelerations(
            parameters.constraints,
            description,
            Kinematics(description) if parameters.constraints else self.tasks.kinematics,
            description.period_s,
            file,
            brake=self.bounds.greatest,
            ranges=(self.bounds.least, self.bounds.most),
        )
        np.minimum(self.torque_max, self.stack.torque_max, out=self.torque_max)
        names = self.tasks.names
        self.extra_names = (
            "largest_torque_share",
            *(f"error_{name}" for name in names),
            *(c for i, each in self.tasks.presses.items() for c in each.columns(names[i])),
            *self.columns(names),
        )
        self._free = self._on_soles(description, parameters.contacts, file)
        self.arrays = {"decision": 2 * n if self._free is None else self._free.decided}
        super().__init__(description, parameters)
        self.parts = [*self.tasks.parts(), *self.stack.parts()]
        self._brakes = getattr(parameters, "null_damping_per_s", 0.0) > 0.0
        self._check_finite = se3_pd_kernels.check_finite  # 0 where both arrays are finite
        self._predict_lyapunov, self._distances = kernels.predict_lyapunov, kernels.distances
        self._give = kernels.give
        self._viable = parameters.bounds.kind == "viability"
        self._wish, self._scratch = np.zeros((2, n))
        self.tops, self.absent = np.zeros(len(names), np.bool_), np.zeros(len(names))
        self.residual, self._idle = math.inf, False
        stack = self.stack
        self._keeps = bool(stack.constraints)
        self.lower, self.upper = self.bounds.lower, self.bounds.upper
        if self._keeps:
            self.lower, self.upper = stack.lower, stack.upper
        self.problem = self._problem() if self._free is None else self._free.problem
        self._nearest, self._stopping = (
            Tsid(self.torque_max, len(stack.rows)),
            Tsid(self.torque_max),
        )
        self._next_q, self._next_dq = np.zeros((2, n))
        self._no_rows, self._no_wish = np.zeros((0, n)), np.zeros(0)
        self._less = self.tasks.dynamics.weight if self.kind == "torque" else np.zeros(n)
        self._answered, self._unbounded = np.zeros((2, n)), np.full(n, np.inf)
        self.answer_in(np.zeros(n), np.zeros(n))
        self._errors, self._wrenches, self._counts = self._columns_of_extra()
        self._present_counts = np.zeros(self._counts.size)
        self._dt, self._begun = description.period_s, False
        self._first = self._settled = 0
        self._events = EventConditions(stack)
        held = tuple(f"held by {label}" for label in stack.labels) + self._events.names
        self.conditions = CONDITIONS + held + (self._free.conditions if self._free else ())
        self._violated, self._violation = False, 1 << len(self.conditions)
        if self.tasks.watched:
            self.conditions = (*self.conditions, VIOLATED)
        self._watch_progress(parameters)
        self.margin_tolerance = CURVATURE if self._keeps else MARGIN_ROUNDING
        self.certifies = self.proves and self._viable
        self.not_certified_in = MOVING | IDLE

    def _watch_progress(self, parameters: Any) -> None:
        unbounded = np.full(self.tasks.jacobian.shape[1], np.inf)
        bounds = (self.lower, self.upper) if self._free is None else (-unbounded, unbounded)
        tasks = self.tasks.followed(parameters.tasks, self.absent, self.judged)
        self._find = self.watch_progress(tasks, bounds, self.stack.labels).find

    @classmethod
    def configured(cls, description: RobotDescription, parameters: Any, file: str) -> Any:
        """One for a robot."""
        return cls(description, parameters, file)

    @classmethod
    def check(cls, parameters: Any, file: str) -> None:
        """Refuse constraints that are wrong for any robot, and priorities that fit no tasks.

        Raises:
            ConfigError: naming the key and the value.
        """
        read(parameters.constraints, file)
        with located(file, "parameters"):
            cls.importance_of(parameters)

    @classmethod
    @abstractmethod
    def importance_of(cls, parameters: Any) -> Schedule:
        """What weighs the tasks up.

        Raises:
            ConfigError: it does not fit them.
        """

    @classmethod
    @abstractmethod
    def columns(cls, names: tuple[str, ...]) -> tuple[str, ...]:
        """Names of what `count` writes."""

    @abstractmethod
    def count(self, out: FloatArray) -> None:
        """Take what the importance is now.

        Write it into `out`, which tasks are `tops`, and how far each is `absent`, from 0 to 1.
        """

    def judged(self) -> NDArray[np.bool_]:
        """Which tasks must reach their target, (k,): those that nothing stands above."""
        return self.tops

    def task_errors(self) -> list[TaskError]:
        """Errors of all tasks; those of lower priority, and those left out, are not judged."""
        judged = self.judged()
        notes = [
            ABSENT if self.absent[i] >= 1.0 else "" if judged[i] else LOWER
            for i in range(len(judged))
        ]
        return [
            self.explained(error, name)
            for i, name in enumerate(self.tasks.names)
            for error in name_errors(self.tasks.errors_of(i), name, notes[i])
        ]

    def margin_of(self) -> tuple[str, str]:
        """The nearest constraint, or the bounds where these are nearer."""
        if self._keeps and not self.stack.margin() > self.command.margin:
            return self.stack.tightest_with_unit()
        return "bounds of joints", "of the greatest acceleration or torque"

    def answer_in(self, found: FloatArray, effort: FloatArray) -> None:
        """Have these arrays, (n,), be those that `solve` writes: x, and M·x + h of the problem."""
        self.found, self.effort = found, effort
        self.ddq, self.tau = (found, effort) if self._free is None else self._answered
        self._given = self.tau if self.kind == "torque" else self.ddq

    def _columns_of_extra(
        self,
    ) -> tuple[FloatArray, list[tuple[FloatArray, FloatArray]], FloatArray]:
        """Where errors, measured wrenches, and what `count` writes stand in the command."""
        extra, end = self.command.extra, 1 + len(self.tasks.names)
        errors, wrenches = extra[1:end], []
        for press in self.tasks.presses.values():
            start, end = end, end + press.measured.size
            wrenches.append((extra[start:end], press.measured))
        return errors, wrenches, extra[end:]

    def _on_soles(
        self, description: RobotDescription, contacts: ContactSettings, file: str
    ) -> FreeBase | None:
        """What a free base adds; None with one that stands."""
        if not isinstance(self.tasks, FreeTasks):
            return None
        with located(file, "parameters"):
            limits = self.torque_max, self.bounds.greatest
            return FreeBase(description, contacts, self.tasks, *limits)

    def _problem(self) -> Problem:
        """That of a base that stands, in the joints' accelerations."""
        tasks, stack = self.tasks, self.stack
        dynamics, rest = tasks.dynamics, tasks.with_rest[1][len(tasks.wanted) :]
        rows = stack.rows, stack.rows_lower, stack.rows_upper
        matrices = rest, dynamics.mass, dynamics.bias
        return Problem(
            tasks.jacobian, tasks.wanted, tasks.with_rest, *matrices, self.lower, self.upper, *rows
        )

    @abstractmethod
    def solve(self, torque_max: FloatArray) -> bool:
        """Solve `problem` with |effort| ≤ torque_max, (n,); whether it has an answer.

        Writes `found` and `effort`, (n,), and the `residual`.
        """

    def apply(self, parameters: Any) -> None:
        """Read the tasks' gains, the greatest speed, and ω_r and d where there are such."""
        if isinstance(parameters, RegularisedParameters):
            d, brakes = parameters.null_damping_per_s, self._brakes
            if (d > 0.0) != brakes:  # that is another problem
                problem = "switches the braking off" if brakes else "switches the braking on"
                remedy = "Take more than 0" if brakes else "Write it in the config, and restart"
                raise ConfigError("", "null_damping_per_s", d, problem, remedy)
            self.w_r = parameters.w_r
            self.tasks.brake(d)
        self.tasks.gain(parameters.tasks)
        self.bounds.apply(parameters.bounds)

    def validate(self, parameters: Any) -> None:
        """Refuse bounds that do not fit the robot."""
        super().validate(parameters)
        self.bounds.validate(parameters.bounds)

    def reset(self, state: State, last_command: FloatArray | None) -> None:
        """Begin where the robot is; a joint that is outside its bounds here may stay there."""
        del last_command
        self.forget_changes()
        self.bounds.begin(state.q)
        self.stack.reset()
        if self._free is not None:
            self._free.reset()
        self._begun, self._first, self._settled = False, state.tick, 0
        self.restart_progress()
        self.importance.reset()
        self.importance.update(0.0)
        self._count()

    def step(self, state: State) -> Setpoint:
        """Torques, or accelerations, for one period."""
        self.advance(state)
        command, tasks, q, dq = self.command, self.tasks, state.q, state.dq
        check_finite = self._check_finite
        free = self._free
        if (
            check_finite(q, dq)
            or (tasks.presses and check_finite(state.wrench, state.wrench))
            or (free is not None and not free.knows(state))
        ):
            command.stamp_kinematics = self.now()
            return self.refuse(NOT_FINITE)
        if isinstance(tasks, FreeTasks):
            tasks.take(state)
        time, then = state.tick * self._dt, (state.tick + 1) * self._dt
        if not self._begun:
            tasks.begin(q, dq, time, then)
            self._begun = True
        follows = state.mode == State.ACTIVE
        self._violated = tasks.watched and follows and tasks.watch(q, state.tick, time)
        self._settle(state.tick - self._first)  # already done, unless States were missed
        tasks.update(q, dq, state.wrench, time, then, self.absent)
        self.bounds.update(q, dq)
        if self._keeps:
            self.stack.update(q, dq, state, self.bounds.lower, self.bounds.upper)
        stands = free is None or free.update(self.lower, self.upper, state.contact)
        command.stamp_kinematics = self.now()
        if free is not None:
            fallback = self._solve_on_soles(free, dq, stands=stands)
        else:
            fallback = SOLVED if self.solve(self.torque_max) else self.fall_back(dq)
        first = fallback
        if self._keeps and (fallback == STOPPED or not self._can_stop(q, dq)):
            fallback = self._stop(dq)
        if not self._give(self._given, self._less, self.ddq, command.values):
            return self.refuse(OVERFLOWN)
        n = len(command.values)
        if free is None:
            command.decision[:n], command.decision[n:] = self.ddq, self.tau
        else:
            free.write(self.tau, command.decision)
        for column, measured in self._wrenches:
            column[:] = measured
        self._counts[:] = self._present_counts
        sound = self._certify(first, fallback, dq)
        moved = self._settle(state.tick - self._first + 1)
        if sound and not moved:
            command.solver_status = STATUS["certified"]
        return command

    def _settle(self, tick: int) -> bool:
        """Move the importance to a tick since the reset; whether it is another than before."""
        if tick <= self._settled:
            return False
        self._settled = tick
        moved: bool = self.importance.update(tick * self._dt)
        if moved:
            self._count()
        return moved

    def _count(self) -> None:
        self.count(self._present_counts)
        self._idle = not self.tops.any()

    def fall_back(self, dq: FloatArray) -> int:
        """The nearest that there is to what tasks would do with strong motors."""
        np.multiply(dq, -BRAKE_PER_S, out=self._wish)
        if self.solve(self._unbounded):
            self._wish[:] = self.ddq
        nearest, stack = self._nearest, self.stack
        nearest.rows[:] = stack.rows
        nearest.rows_lower[:], nearest.rows_upper[:] = stack.rows_lower, stack.rows_upper
        return FALLBACKS[self._come_near(nearest)]

    def _solve_on_soles(self, free: FreeBase, dq: FloatArray, *, stands: bool) -> int:
        """Find ddq and τ of a free base; which `fallback` it is."""
        if stands and self.solve(self._unbounded):
            free.answer(self.found, self.ddq, self.tau)
            return SOLVED
        if stands:
            free.let_joints_go()
            found = self.solve(self._unbounded)
            self.residual = math.inf
            if found:
                free.answer(self.found, self.ddq, self.tau)
                return NEAREST
            if free.soften(self.ddq, self.tau):
                return OVERLOADED_MOTORS
        self.residual = math.inf
        free.brake(dq, BRAKE_PER_S, self.ddq, self.tau)
        return GAVE_UP

    def _can_stop(self, q: FloatArray, dq: FloatArray) -> bool:
        """Whether from the end of this period the robot can stop without violating constraints."""
        period, q_next, dq_next = self._dt, self._next_q, self._next_dq
        np.multiply(self.ddq, period, out=dq_next)
        np.multiply(dq_next, 0.5, out=q_next)
        np.add(q_next, dq, out=q_next)
        np.multiply(q_next, period, out=q_next)
        np.add(q_next, q, out=q_next)
        np.add(dq_next, dq, out=dq_next)
        return self.stack.stop_is_safe(q_next, dq_next)

    def _stop(self, dq: FloatArray) -> int:
        """Brake all joints together, as far as bounds and torques allow; STOPPED."""
        self.stack.stop(dq, self._wish)
        if math.isfinite(float(self._wish.sum())):
            self._come_near(self._stopping)
        else:
            self.ddq[:] = np.nan
        return STOPPED

    def _come_near(self, solver: Tsid) -> int:
        """Find what is nearest to the wish within what a solver keeps; one of `solvers.status`."""
        dynamics = self.tasks.dynamics
        found = solver.solve(
            self._no_rows,
            self._no_wish,
            1.0,
            self._wish,
            dynamics.mass,
            dynamics.bias,
            self.lower,
            self.upper,
        )
        self.ddq[:], self.tau[:], self.residual = solver.ddq, solver.tau, math.inf
        return found

    def _certify(self, first: int, fallback: int, dq: FloatArray) -> bool:
        """Write what is known of the answer; whether it is proved for the present importance.

        Args:
            first: what became of the tasks' problem, before a stop for a constraint.
            fallback: of the answer.
            dq: (n,).
        """
        command, tasks, free = self.command, self.tasks, self._free
        v, a = (dq, self.ddq) if free is None else (free.velocity, free.motion)
        V, rate, growth, active = self._predict_lyapunov(
            tasks.tasks,
            self.tops,
            tasks.jacobian,
            tasks.error,
            tasks.motion,
            tasks.rate,
            tasks.slope,
            v,
            a,
            self._dt,
            self._errors,
        )
        command.active_joints = active if free is None else free.moving(self._dt)
        command.margin, command.extra[0], held = self._distances(
            self.ddq,
            self.tau,
            self.lower,
            self.upper,
            self.bounds.greatest,
            self.torque_max,
            self._scratch,
        )
        command.v, command.v_rate_predicted = V, rate
        command.v_rate_required, command.rho = max(growth, 0.0), 1.0
        command.solver_path, command.fallback = first, fallback
        touches = bool(tasks.presses) and any(each.touches for each in tasks.presses.values())
        loaded, idle = tasks.load > 1.0, self._idle
        solved = fallback == SOLVED
        command.kkt_residual = self.residual if solved and self.proves else 0.0
        command.solver_status = UNCERTIFIED if solved else INFEASIBLE
        present = WHY[first] if self.proves else WHY[first] | UNPROVED
        if fallback == STOPPED and command.extra[0] >= 1.0 - MARGIN_ROUNDING:
            present |= TOO_SMALL
        if held:
            present |= HELD
        if tasks.opposite:
            present |= HALF_A_TURN
        if loaded:
            present |= LOADED
        if self.importance.moving:
            present |= MOVING
        if touches:
            present |= TOUCHES
        if idle:
            present |= IDLE
        self.present = present | (self._violation if self._violated else 0)
        kept = not self._keeps or self._judge_constraints(fallback)
        if free is not None:
            self.present |= free.present << len(CONDITIONS)
            command.margin = min(command.margin, free.cone_margin)
            kept = free.is_sound(CERTIFIED_RESIDUAL)
        errors, tick = (tasks.slope, tasks.jacobian, 1.0), self._first + self._settled
        rows = self.stack.held(self.ddq) if self._keeps else 0
        self.present |= self._find(tick, errors, v, a, rows=rows)
        kept = kept and not self.is_stationary
        proved = solved and self.proves and self.residual <= CERTIFIED_RESIDUAL
        return proved and kept and self._viable and not (touches or loaded or idle)

    def _judge_constraints(self, fallback: int) -> bool:
        """Have margin and conditions say what is known of the constraints; whether all are kept."""
        stack, command, margin = self.stack, self.command, self.stack.margin()
        command.margin = min(margin, command.margin)  # nan, if there is one, stays
        self.present |= STOPS if fallback == STOPPED else 0
        events = self._events.look() << len(stack.labels)
        self.present |= (stack.held(self.ddq) | events) << len(CONDITIONS)
        return margin >= -CURVATURE
