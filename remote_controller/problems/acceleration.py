"""What the problems of all controllers of accelerations and torques share.

Tasks desire J·q̈ = kp·e − kd·ν − ν̇₀ (Del Prete, IEEE RA-L 2018, (34)); τ = M·q̈ + h; bounds of q̈ and
|τ| ≤ τ_max hold. A builder adds how tasks are weighed up, and of which problem q̈ is the optimum.

`Setpoint.fallback` selects the branch. 0: the optimum of the tasks. 1: the q̈ that is nearest to a
wish within bounds and torques. 2: no q̈ is within both, and the bounds are kept while torques are
exceeded as little as possible. 3: the wish, clipped to the bounds. 4: constraints stop the robot:
the q̈ that is nearest to all joints' braking together, within bounds and torques.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Mapping
from functools import partial
from itertools import pairwise
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.messages import COMMANDS, State, schema
from hoap3.protocol.robot.description import RobotDescription
from hoap3.remote_controller.controllers.certificate import STATIONARY
from hoap3.remote_controller.problems.acceleration_claims import (
    INFEASIBLE,
    RELATIVE,
    Cycle,
    lyapunov_claims,
    refused,
    rounding_of,
    worst,
)
from hoap3.remote_controller.problems.acceleration_constraints import (
    CURVATURE,
    Constraints,
    tightened,
)
from hoap3.remote_controller.problems.check import infeasibility
from hoap3.remote_controller.problems.history import ProblemBuilder
from hoap3.remote_controller.problems.oracles import acceleration_bounds_oracle as bounds
from hoap3.remote_controller.problems.oracles.parameters import (
    NOT_READ,
    UnverifiableError,
    check_least,
    complete,
    reason_of,
)
from hoap3.remote_controller.problems.oracles.robot_oracle import RigidBody, Robot
from hoap3.remote_controller.problems.oracles.tasks.acceleration_oracle import (
    ROUNDING,
    AccelerationTask,
    acceleration_task_of,
    gains_of,
    stack_rows,
)
from hoap3.remote_controller.problems.oracles.tasks.wrench_oracle import WrenchTask, columns_of
from hoap3.remote_controller.problems.schedule import Schedule, TickSchedule
from hoap3.remote_controller.problems.statement import (
    Array,
    Cascade,
    Claim,
    ClosedForm,
    Flags,
    Problem,
    Program,
    Rows,
    Statement,
)

Settings = Mapping[str, Any]

STATUS = schema("Setpoint").constants
CERTIFIED, UNCERTIFIED = STATUS["STATUS_CERTIFIED"], STATUS["STATUS_UNCERTIFIED"]
SOLVED, NEAREST, OVERLOADED, CLIPPED, STOPPED = range(5)  # Setpoint.fallback
BRANCHES = ("optimum", "nearest", "overloaded", "clipped", "stopped")

OPTIMAL = 1e-9  # greatest relative residual of a certified answer
TINY = 1e-9  # rad/s²: accelerations below it count as that much
FAR = 10.0  # of the largest acceleration: the greatest q̈ that rounding of the margin counts
VIOLATION_WEIGHTS = 1e4, 1e2, 1.0  # P; the next one where the solver gives up
FREE_BASE_ONLY = {"base", "contacts"}
FREE_BASE = "problems of a free base are not stated"
NO_PROOF = "that a solver finds no answer, though there may be one, is not recomputed"
NEED = "that the robot has to stop for a constraint is not recomputed"
SEVERAL = "which of several nearest points of bodies have rows is not recomputed"


class Optimum(NamedTuple):
    """The tasks' problem, and which part of an answer solves it.

    Attributes:
        problem: its `error` is what a certified answer may be off.
        answer, answer_error: (p,).
        exact: how exactly the residual of the certificate is known.
    """

    problem: Program | Cascade
    answer: Array
    answer_error: Array
    exact: float


class Wish(NamedTuple):
    """What an answer without the tasks' optimum is close to: min ½|R q̈ − r|².

    Attributes:
        R, r: (s, n) and (s,).
        ddq: its optimum without limits, (n,).
        error: of it, relative to the largest acceleration.
        gain: by how much an error of the constraints' rows moves it.
    """

    R: Array
    r: Array
    ddq: Array
    error: float = 0.0
    gain: float = 0.0


class AccelerationProblems(ProblemBuilder):
    """The problems of one controller; arguments as of every `ProblemBuilder`.

    Attributes:
        settings: the parameters in force, complete.
        names, tasks, gains: of each task.
        edges: first row of each task, and the number of all rows.
        bounds: of accelerations.
        torque_max: (n,) [N m or N].
    """

    defaults: ClassVar[Settings]
    proves: ClassVar[bool] = True
    """Whether the controller states the residual, and certifies by it."""
    free: ClassVar[bool] = False
    """Whether the base is free."""
    in_rows: ClassVar[bool] = True
    """Whether `optimum` is a program, in which rows may be optional."""
    least_w_r: ClassVar[float] = 1e-6
    """The least ω_r that a config may have, of controllers with one."""

    def __init__(
        self,
        description: RobotDescription,
        parameters: Settings,
        session: Settings,
        controller: str,
    ) -> None:
        super().__init__(description, parameters, session, controller)
        if (parameters.get("base") == "free") != self.free:
            raise UnverifiableError(FREE_BASE)
        try:
            self._build(description, parameters, session)
        except NOT_READ as error:
            raise UnverifiableError(reason_of(error)) from error

    def entries(self, settings: Settings) -> list[Settings]:
        """Return the tasks, as a config has them."""
        return list(settings["tasks"])

    def derivative_claims(self) -> list[Claim]:
        """Claims of the derivatives of users' tasks and constraints."""
        found = [claim for task in self.tasks for claim in task.derivative_claims(self._robot)]
        return found + self.constraints.derivative_claims()

    @abstractmethod
    def schedule(self, settings: Settings) -> Schedule:
        """Return weights or priorities, at their start."""

    @abstractmethod
    def tops(self, importance: Array) -> Flags:
        """Return which tasks V covers, (k,)."""

    @abstractmethod
    def optimum(self, cycle: Cycle) -> Optimum:
        """State the problem of the tasks."""

    @abstractmethod
    def wish(self, cycle: Cycle) -> Wish:
        """Return what an answer is close to where the tasks' problem has none."""

    def _build(
        self, description: RobotDescription, parameters: Settings, session: Settings
    ) -> None:
        if not {"torque", "acceleration"} & {*description.command_kinds}:
            raise UnverifiableError("the robot takes neither torques nor accelerations")
        if description.delay_ticks:
            raise UnverifiableError("answers are delayed, and this controller takes no delay")
        kinds = description.command_kinds
        self._torques = next(kind for kind in kinds if kind != "position") == "torque"
        self.settings = self._complete(parameters)
        self._robot = robot = self._robot_of(description)
        entries = self.entries(self.settings)
        self.names = [str(e.get("name") or e.get("task") or e["kind"]) for e in entries]
        self.tasks = [self._task_of(entry) for entry in entries]
        self._wrench_tasks = {
            place: task for place, task in enumerate(self.tasks) if isinstance(task, WrenchTask)
        }
        if self._wrench_tasks:
            self.history.needed = "q", "dq", "wrench"
        else:
            self.history.needed = "q", "dq"
        sensors = list(description.wrench_sensors)
        self._sensors = {
            task.sensor: slice(6 * place, 6 * place + 6)
            for task in self._wrench_tasks.values()
            for place in [sensors.index(task.sensor)]
        }
        self._body = RigidBody(robot)
        self._friction = self._body.damping * float(self.settings["compensate_friction"])
        self._columns = {name: place for place, name in enumerate(session.get("extra") or ())}
        self._schedule = TickSchedule(self.schedule(self.settings), description.period_s)
        self._first_tick = 0
        largest = bounds.Bounds.of(description, self.settings["bounds"]).scale
        self.constraints = Constraints(self.settings["constraints"] or (), robot, largest)
        self._apply(self.settings)
        self._start = np.full(description.n, np.nan)
        robot.place(description.initial_position)
        robot.move(np.zeros(description.n))
        for task in self.tasks:
            task.begin(robot, 0.0)
        still = np.zeros(robot.width)
        sizes = [len(task.at(robot, still, 0.0, description.period_s).error) for task in self.tasks]
        self.edges = np.cumsum([0, *sizes]).tolist()

    def _robot_of(self, description: RobotDescription) -> Robot:
        return Robot(description, self.history.messages)

    def _task_of(self, entry: Settings) -> AccelerationTask:
        if entry["task"] == "wrench":
            return WrenchTask(entry["parameters"], self._robot)
        return acceleration_task_of(entry, self._robot)

    def _complete(self, parameters: Settings) -> dict[str, Any]:
        given = {key: each for key, each in parameters.items() if key not in FREE_BASE_ONLY}
        settings = complete(given, self.defaults, "parameters", strict=False)
        if "w_r" in self.defaults:
            check_least(settings, "w_r", self.least_w_r)
        bounds.check_settings(settings["bounds"], self.history.description.n)
        return settings

    def _apply(self, settings: Settings) -> None:
        """Read gains and limits."""
        description = self.history.description
        self.gains = [gains_of(entry) for entry in self.entries(settings)]
        self.bounds = bounds.Bounds.of(description, settings["bounds"])
        given = settings["bounds"]["torque_max"] or (np.inf,)
        self.torque_max = np.minimum(description.effort, given)
        self.torque_max = np.minimum(self.torque_max, self.constraints.torque_max)

    def adopt(self, parameters: Settings) -> None:
        """Take other parameters from the newest State on; all that is remembered stays."""
        settings, before = self._complete(parameters), self.settings
        pairs = zip(self.entries(settings), self.entries(before), strict=True)
        for place, (entry, old) in enumerate(pairs):
            task = self.tasks[place]
            if task.by_differences and entry["parameters"] != old["parameters"]:
                self.tasks[place] = self._task_of(entry)
                self.tasks[place].take_over(task)
        self.constraints.adopt(settings["constraints"] or (), self.history.first)
        self.settings = settings
        self._apply(settings)

    def begin(self) -> None:
        """Start all tasks and constraints from the first State that is finite."""
        self._move(self.history.state)
        for task in self.tasks:
            task.begin(self._robot, self.history.time_s)
        if self.constraints:
            self.constraints.begin(self.history.state)

    def _move(self, state: Any) -> None:
        self._robot.place(state["q"])
        self._robot.move(state["dq"])

    def restart(self) -> None:
        """Restart the schedule with a reset."""
        history = self.history
        period_s = history.description.period_s
        self._schedule = TickSchedule(self.schedule(self.settings), period_s)
        self._first_tick = int(history.state["tick"])
        history.requests.clear()
        self._start = np.array(history.state["q"])

    def observe(self) -> None:
        """Evaluate what has memory: the schedule, tolerances, contacts, and constraints."""
        history, schedule = self.history, self._schedule
        state, time_s, period_s = history.state, history.time_s, history.description.period_s
        for request in history.requests:
            schedule.change(request)
        history.requests.clear()
        schedule.advance(int(state["tick"]) - self._first_tick)
        watched = [task for task in self.tasks if task.watched]
        if watched or self._wrench_tasks:
            self._move(state)
        if int(state["mode"]) == State.ACTIVE:
            for each in watched:
                each.watch(self._robot, time_s)
        absent = _absence(schedule.values)
        for place, task in self._wrench_tasks.items():
            wrench = state["wrench"][self._sensors[task.sensor]]
            task.feel(self._robot, wrench, float(absent[place]), time_s, period_s)
        self.constraints.follow(state)

    def problem(self) -> Statement | None:
        """The problem of the newest answer; None where the log lacks what it depends on."""
        self._close(asked=True)
        history = self.history
        if history.known and not history.finite and history.answer is not None:
            return refused(history.answer)
        return super().problem()

    def state_problem(self, setpoint: Any) -> Statement:
        """The problem of an answer to the newest State."""
        cycle = self._cycle(setpoint)
        tops = np.repeat(self.tops(cycle.importance), np.diff(self.edges))
        claims = [
            *lyapunov_claims(setpoint, cycle, tops, self.history.description.period_s),
            *self._column_claims(setpoint, cycle),
        ]
        claims += self._motion_claims(setpoint, cycle)
        fallback, given = int(setpoint["fallback"]), (cycle.ddq, cycle.ddq_error)
        unknown = self.constraints.unknown
        several = any(rows.optional.any() for rows in cycle.kept) and fallback != STOPPED
        if unknown or (several and (fallback != SOLVED or not self.in_rows)):
            claims += self._proof_claims(setpoint, cycle, bool(tops.any()), np.inf)
            reasons = [(f"constraint {name}", why) for name, why in unknown.items()]
            reasons += [] if unknown else [("optimum", SEVERAL)]
            branch = BRANCHES[min(fallback, STOPPED)]
            return Statement(branch, (), *given, tuple(claims), tuple(reasons))
        if fallback != STOPPED:
            q = np.array(self.history.state["q"])
            claims += self.constraints.stop_claims(q, cycle.dq, cycle.ddq)
        if fallback == SOLVED:
            best = self.optimum(cycle)
            claims += self._proof_claims(setpoint, cycle, bool(tops.any()), best.exact)
            problems = (lambda: best.problem,)
            given = best.answer, best.answer_error
            return Statement(BRANCHES[SOLVED], problems, *given, tuple(claims))
        claims += self._proof_claims(setpoint, cycle, False, 0.0)
        return self._instead(cycle, setpoint, claims)

    def _cycle(self, setpoint: Any) -> Cycle:
        """Evaluate tasks, dynamics, bounds and the answer's motion at the newest State."""
        state, T, time_s = (
            self.history.state,
            self.history.description.period_s,
            self.history.time_s,
        )
        q, dq, robot = np.array(state["q"]), np.array(state["dq"]), self._robot
        self._move(state)
        M, h, added = self._body.at(q, dq)
        M, h = M + T * np.diag(self._friction), h + self._friction * dq
        for sensor, part in self._sensors.items():
            J, _, _ = robot.frame_motion(sensor, own_axes=True)
            h = h - J.T @ state["wrench"][part]
        seen, desired, errors = [], [], []
        for task, (kp, kd) in zip(self.tasks, self.gains, strict=True):
            rows = task.at(robot, dq, time_s, T)
            wanted = kp * rows.error - kd * rows.motion - rows.rate
            if isinstance(task, WrenchTask) and task.touches:
                rows, wanted = task.press(rows, wanted, M)
            size = kp * np.abs(rows.error) + kd * np.abs(rows.motion) + np.abs(wanted)
            seen.append(rows)
            desired.append(wanted)
            errors.append(np.array([kp, kd, 1.0]) @ rows.exact + ROUNDING * size)
        least, most = self.bounds.begun(self._start).at(q, dq)
        least, most = self.constraints.narrow(q, dq, least, most)
        found = dq, stack_rows(seen), np.concatenate(desired), np.concatenate(errors)
        motion = self._motion(setpoint, M, h, added, dq)
        kept = self.constraints.rows(dq, motion[0], motion[2])
        return Cycle(*found, M, h, added, least, most, self._schedule.values, *motion, kept)

    def _motion(
        self, setpoint: Any, M: Array, h: Array, added: Array, dq: Array
    ) -> tuple[Array, Array, Array, Array]:
        """Return q̈ and τ of an answer, and their rounding errors, (n,)."""
        values, exact = np.array(setpoint["values"], float), np.zeros(len(h))
        if _has_decision(setpoint):
            ddq, tau = np.split(np.array(setpoint["decision"], float), 2)
            return ddq, tau, exact, exact
        if not self._torques:
            return values, M @ values + h, exact, exact + rounding_of(M, h, dq, values)
        tau, inverse = values + added, np.linalg.inv(M)
        ddq = np.asarray(inverse @ (tau - h))
        exact = ROUNDING * (np.abs(values) + np.abs(added)) + rounding_of(M, h, dq, ddq)
        return ddq, tau, np.abs(inverse) @ exact, exact

    def _column_claims(self, setpoint: Any, cycle: Cycle) -> list[Claim]:
        """Errors of all tasks, their wrenches, and weights or priorities, in `extra`."""
        extra, claims = setpoint["extra"], []
        for name, edge in zip(self.names, pairwise(self.edges), strict=True):
            error = float(np.linalg.norm(cycle.rows.error[slice(*edge)]))
            off = RELATIVE * error + float(np.linalg.norm(cycle.rows.exact[0, slice(*edge)]))
            claims.append(Claim("error", float(extra[self._columns[f"error_{name}"]]), error, off))
        for place, task in self._wrench_tasks.items():
            columns = [self._columns[label] for label in columns_of(task, self.names[place])]
            exact = RELATIVE * (1.0 + np.abs(task.measured))
            claims.append(worst("wrench", extra[columns], task.measured, exact))
        kind, labels = "weight", [f"weight_{name}" for name in self.names]
        if cycle.importance.ndim == 2:
            kind, labels = "alpha", [f"alpha_{a}_{b}" for a in self.names for b in self.names]
        if all(label in self._columns for label in labels):  # not logged of many tasks
            columns, found = [self._columns[label] for label in labels], cycle.importance.ravel()
            size = np.abs(found)
            exact = RELATIVE * size + ROUNDING * max(1.0, float(size.max()))
            claims.append(worst(kind, extra[columns], found, exact))
        return claims

    def _motion_claims(self, setpoint: Any, cycle: Cycle) -> list[Claim]:
        """τ = M·q̈ + h, the command, the largest share of a torque, and the margin."""
        kind = COMMANDS["torque" if self._torques else "acceleration"]
        claims = [Claim("command", float(setpoint["command"]), float(kind), 0.0)]
        if _has_decision(setpoint):
            exact = rounding_of(cycle.M, cycle.h, cycle.dq, cycle.ddq)
            claims.append(worst("torques", cycle.tau, cycle.M @ cycle.ddq + cycle.h, exact))
            sent, size = cycle.ddq, np.abs(cycle.ddq)
            if self._torques:
                sent, size = cycle.tau - cycle.added, np.abs(cycle.tau) + np.abs(cycle.added)
            claims.append(worst("setpoint", setpoint["values"], sent, ROUNDING * size))
        most, largest = self.torque_max, self.bounds.scale
        share = float((np.abs(cycle.tau) / most).max())
        off = RELATIVE * share + float((cycle.tau_error / most).max())
        stated = float(setpoint["extra"][self._columns["largest_torque_share"]])
        if self.constraints.unknown:  # which may leave less of torques and accelerations
            return [*claims, Claim("largest torque share", stated, share, off, "at_least")]
        claims.append(Claim("largest torque share", stated, share, off))
        room = np.minimum(cycle.ddq - cycle.lower, cycle.upper - cycle.ddq) / largest
        greatest = float((np.minimum(np.abs(cycle.ddq), FAR * largest) / largest).max())
        off += float((cycle.ddq_error / largest).max()) + RELATIVE * max(1.0, greatest)
        margin = min(1.0, float(room.min()), 1.0 - share, self.constraints.margin)
        off += self.constraints.margin_error
        return [*claims, Claim("margin", float(setpoint["margin"]), margin, off)]

    def _proof_claims(
        self, setpoint: Any, cycle: Cycle, has_tops: bool, exact: float
    ) -> list[Claim]:
        """ρ, the residual, and the status that follows from it.

        Args:
            setpoint, cycle: of the answer.
            has_tops: whether some task takes part.
            exact: how exactly the residual of the tasks' optimum is known.
        """
        status, fallback = int(setpoint["solver_status"]), int(setpoint["fallback"])
        solved, residual = fallback == SOLVED, float(setpoint["kkt_residual"])
        off = max(exact, OPTIMAL) if solved and self.proves else 0.0
        claims = [
            Claim("rho", float(setpoint["rho"]), 1.0, RELATIVE),
            Claim("residual", residual, 0.0, off),
        ]
        path = float(setpoint["solver_path"])  # of a stop, what came before it
        claims.append(
            Claim("solver path", path, min(path, STOPPED) if fallback == STOPPED else fallback, 0.0)
        )
        load = float((np.abs(cycle.h) / self.torque_max).max())
        stationary = any(each.startswith(STATIONARY) for each in self.history.conditions)
        touches = any(task.touches for task in self._wrench_tasks.values())
        expected = UNCERTIFIED if solved else INFEASIBLE
        if solved and self.proves and self.bounds.kind == "viability" and has_tops:
            at_limit = abs(load - 1.0) <= ROUNDING * max(load, 1.0)  # either is right
            holds = load <= 1.0 or (at_limit and status == CERTIFIED)
            rests = not (self._schedule.moves or touches or stationary)
            beyond, near = self.constraints.margin + CURVATURE, self.constraints.margin_error
            kept = beyond >= 0.0
            if self.constraints.unknown or abs(beyond) <= near:  # either is right
                kept = beyond >= -near and status == CERTIFIED
            if holds and kept and rests and residual <= OPTIMAL:
                expected = CERTIFIED
        return [*claims, Claim("status", status, expected, 0.0)]

    def _instead(self, cycle: Cycle, setpoint: Any, claims: list[Claim]) -> Statement:
        """State what an answer solves where the tasks' problem has no answer."""
        fallback = int(setpoint["fallback"])
        stops = fallback == STOPPED and bool(self.constraints)
        if stops:
            brake, one = self.constraints.stop(cycle.dq), np.eye(len(cycle.dq))
            wish, unverified = Wish(one, brake, brake), [("fallback: stop", NEED)]
        else:
            wish, unverified = self.wish(cycle), [("fallback: no answer", NO_PROOF)]
        span = max(TINY, float(np.abs(cycle.ddq).max()), float(np.abs(wish.ddq).max()))
        error = (RELATIVE + wish.error) * span + float(cycle.ddq_error.max())
        error += wish.gain * self.constraints.rows_error
        limits = self._limits(cycle, error, rows=not stops)
        problems: list[Callable[[], Problem]] = []
        if fallback == NEAREST or stops:
            problems += [partial(self._nearest, cycle, wish, limits, error)]
        if fallback == OVERLOADED:
            claims.append(self._infeasibility_claim(cycle))
            unverified = []
        if fallback == OVERLOADED or stops:
            problems += [
                partial(self._overloaded, cycle, wish, limits, error, P) for P in VIOLATION_WEIGHTS
            ]
        if stops and int(setpoint["solver_path"]) == STOPPED:
            claims.append(self._contradiction_claim(cycle))
            unverified = []
        if fallback == CLIPPED or stops:
            clipped = np.clip(wish.ddq, cycle.lower, cycle.upper)
            problems += [partial(ClosedForm, (clipped,), np.full(len(clipped), error))]
        if not problems:
            claims.append(Claim("fallback", fallback, CLIPPED, 0.0, "at_most"))
        branch = BRANCHES[min(fallback, STOPPED)]
        given = cycle.ddq, cycle.ddq_error, tuple(claims), tuple(unverified)
        return Statement(branch, tuple(problems), *given)

    def _limits(self, cycle: Cycle, error: Array | float, *, rows: bool = True) -> Rows:
        """Return bounds of q̈ and, unless `rows` is false, what constraints ask for."""
        own = Rows.of(np.eye(len(cycle.dq)), cycle.lower, cycle.upper, error=error)
        return Rows.stacked([own, *(cycle.kept if rows else ())])

    def _torque_rows(self, cycle: Cycle) -> Rows:
        error = RELATIVE * (1.0 + np.abs(cycle.tau)) + cycle.tau_error
        return Rows.of(cycle.M, -self.torque_max - cycle.h, self.torque_max - cycle.h, error=error)

    def _nearest(self, cycle: Cycle, wish: Wish, limits: Rows, error: float) -> Program:
        """State min ½|R q̈ − r|² within bounds and torques."""
        rows = Rows.stacked([limits, self._torque_rows(cycle)])
        return Program.of(wish.R, wish.r, rows, error)

    def _overloaded(
        self, cycle: Cycle, wish: Wish, limits: Rows, error: float, P: float
    ) -> Program:
        """State min ½|R q̈ − r|² + ½ P·max (RᵀR)_ii Σ v² within bounds, v_i the excess of a torque.

        v_i = max(0, |τ_i| − τ_max)/τ_max. At the answer, this cost has the gradient of the one in
        which the torques that exceed their limits there have v_i = ±τ_i/τ_max − 1, and others 0.
        """
        over = np.abs(cycle.tau) > self.torque_max
        weight = np.sqrt(P * (wish.R**2).sum(0).max())
        most, sign = self.torque_max[over], np.sign(cycle.tau[over])
        R = weight * cycle.M[over] / most[:, None]
        r = weight * (sign - cycle.h[over] / most)
        return Program.of(np.vstack([wish.R, R]), np.concatenate([wish.r, r]), limits, error)

    def _contradiction_claim(self, cycle: Cycle) -> Claim:
        """Each q̈ within its bounds violates some row of the constraints."""
        kept = tightened(Rows.stacked([Rows.of(cycle.M[:0], 0.0, 0.0), *cycle.kept]))
        size = 1.0 + np.where(np.isfinite(kept.upper), np.abs(kept.upper), 0.0).max(initial=0.0)
        excess = infeasibility(kept, self._limits(cycle, 0.0, rows=False))
        return Claim("fallback: none keeps the rows", excess, 0.0, RELATIVE * size, "at_least")

    def _infeasibility_claim(self, cycle: Cycle) -> Claim:
        """The least t such that some q̈ within its bounds has |τ| ≤ (1 + t)·τ_max is positive."""
        most, limits = self.torque_max, tightened(self._limits(cycle, 0.0))
        rows = Rows.of(cycle.M / most[:, None], -1.0 - cycle.h / most, 1.0 - cycle.h / most)
        excess = infeasibility(rows, limits)
        return Claim("fallback: none is within all", excess, 0.0, RELATIVE, "at_least")


def _absence(importance: Array) -> NDArray[np.float64]:
    """Return how far each task is out, (k,) from 0 to 1, by priorities (k, k) or weights (k,)."""
    if importance.ndim == 2:
        return importance.diagonal()
    return (importance <= 0.0).astype(float)


def _has_decision(setpoint: Any) -> bool:
    """Return whether a log has q̈ and τ themselves."""
    if "decision" not in setpoint.dtype.names:
        return False
    return bool(setpoint["decision"].size == 2 * setpoint["values"].size)
