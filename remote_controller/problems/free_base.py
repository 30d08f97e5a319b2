"""Robots with a free base that stand on their soles: `tsid`, `ghc`, `weighted` and `hqp`.

The base's motion v̇, the joints' torques τ and the soles' wrenches w keep the equations of motion
and of contact, which leave n unknowns y (`soles.Reduced`). The controllers' problems are those of a
fixed base in y: J Z_v y → b − J v̇₀, within rows of y for the joints' accelerations, torques,
friction cones and normal forces.

`Setpoint.fallback` selects the branch. 0: the optimum. 1: the optimum without the bounds of
accelerations. 2: limits are violated as little as possible, torques are clipped. 3: joints brake.
`Setpoint.decision` has v̇ (base and joints), τ and w.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from functools import partial
from typing import Any, ClassVar, NamedTuple

import numpy as np

from hoap3.protocol.messages import COMMANDS
from hoap3.protocol.robot.description import RobotDescription
from hoap3.remote_controller.controllers.certificate import STATIONARY
from hoap3.remote_controller.problems import soles
from hoap3.remote_controller.problems.acceleration import (
    CERTIFIED,
    CLIPPED,
    NO_PROOF,
    OPTIMAL,
    OVERLOADED,
    SOLVED,
    UNCERTIFIED,
    AccelerationProblems,
    Settings,
)
from hoap3.remote_controller.problems.acceleration_claims import (
    INFEASIBLE,
    RELATIVE,
    Cycle,
    lyapunov_claims,
    worst,
)
from hoap3.remote_controller.problems.oracles.free_robot_oracle import BASE, QUATERNION, FreeRobot
from hoap3.remote_controller.problems.oracles.parameters import (
    NOT_READ,
    complete,
    reason_of,
)
from hoap3.remote_controller.problems.oracles.robot_oracle import RigidBody, Robot
from hoap3.remote_controller.problems.oracles.tasks.acceleration_oracle import (
    ROUNDING,
    AccelerationTask,
    stack_rows,
)
from hoap3.remote_controller.problems.oracles.tasks.free_tasks_oracle import ComTask, free_task_of
from hoap3.remote_controller.problems.statement import (
    Array,
    Claim,
    Flags,
    Problem,
    Program,
    Rows,
    Statement,
)

EXACT = 1e-9  # relative: what an answer may be off its equations and cones
OF_LENGTH_1 = 1e-3  # of a quaternion's square
UNLOADED_SHARE = 0.02  # of the weight: what a sole in the air may press with
BRAKE_PER_S = 10.0  # of M_jj·q̇_j, where nothing carries
BRANCHES = ("optimum", "without bounds", "softened", "braking")
NO_DECISION = "the log has no accelerations, torques and wrenches of a free base"
SOFTENED = "the least violation of limits of a free base is not recomputed"
NO_OPTIMUM = "the optimum of strict levels with a free base is not recomputed"


class Ground(NamedTuple):
    """A State's dynamics with viscous friction, and its contacts.

    Attributes:
        M, h: (n + 6, n + 6) and (n + 6,).
        contact: of all soles.
        reduced: the unknowns; None where soles hold each other.
    """

    M: Array
    h: Array
    contact: soles.Contact
    reduced: soles.Reduced | None


class Answer(NamedTuple):
    """v̇ (n + 6,), τ (n,) and w (6s,) of an answer."""

    motion: Array
    tau: Array
    wrench: Array


class Task(NamedTuple):
    """What tasks desire of y: J y → b; J is (m, n), b and its rounding error (m,)."""

    J: Array
    b: Array
    b_error: Array


class Unknowns(NamedTuple):
    """What y is, that of the answer, (n,), and the residual that the answer may have."""

    reduced: soles.Reduced
    y: Array
    residual: float


class FreeBaseProblems(AccelerationProblems):
    """The problems of one controller with a free base; arguments as of every `ProblemBuilder`."""

    free: ClassVar[bool] = True
    stated: ClassVar[bool] = True
    """Whether `program` states the optimum."""

    @abstractmethod
    def program(
        self, cycle: Cycle, unknowns: Unknowns, tasks: Task, rows: Rows
    ) -> tuple[Program, float]:
        """State the tasks' problem in y, and how exactly its residual is known.

        Args:
            cycle: of the answer.
            unknowns: what y is, and that of the answer.
            tasks: what they desire of it.
            rows: that y keeps.
        """

    def optimum(self, cycle: Cycle) -> Any:
        """Not used: there is no problem in q̈."""
        raise NotImplementedError

    wish = optimum

    def _build(
        self, description: RobotDescription, parameters: Settings, session: Settings
    ) -> None:
        self.history.accepts = _has_base
        self._contacts = complete(
            parameters.get("contacts"), soles.DEFAULTS, "contacts", strict=False
        )
        robot = FreeRobot(description, self.history.messages)
        self._placed, self._soles = robot, soles.Soles(robot, self._contacts, description)
        self._unloaded_s, self._unread = np.zeros(len(description.soles)), ""
        self._viscous = RigidBody(robot.fixed).damping * float(
            parameters.get("compensate_friction", True)
        )
        kinds = [kind for kind in description.command_kinds if kind != "position"]
        self._torques = kinds[:1] == ["torque"]
        given = (parameters.get("bounds") or {}).get("torque_max") or (np.inf,)
        self.torque_max = np.minimum(description.effort, given)
        self._columns = {name: place for place, name in enumerate(session.get("extra") or ())}
        try:
            super()._build(description, parameters, session)
        except NOT_READ as error:  # mechanics do not depend on the tasks
            self._unread = reason_of(error)
        self.history.needed = "q", "dq", "base", "contact"

    def _robot_of(self, description: RobotDescription) -> Robot:
        del description
        return self._placed

    def _task_of(self, entry: Settings) -> AccelerationTask:
        return free_task_of(entry, self._placed)

    def derivative_claims(self) -> list[Claim]:
        """Claims of the derivatives of users' tasks."""
        return [] if self._unread else super().derivative_claims()

    def adopt(self, parameters: Settings) -> None:
        """Take other parameters from the newest State on."""
        if not self._unread:
            super().adopt(parameters)

    def begin(self) -> None:
        """Start all tasks from the first State that is finite."""
        if not self._unread:
            super().begin()

    def restart(self) -> None:
        """Restart the schedule with a reset; all soles carry."""
        self._unloaded_s[:] = 0.0
        if not self._unread:
            super().restart()

    def observe(self) -> None:
        """Evaluate what has memory: contacts, the schedule, and tolerances."""
        contact = self.history.state["contact"]
        if contact.size:
            light = contact[self._soles.normals] < (
                self._contacts["loaded_share"] * self._soles.weight
            )
            period_s = self.history.description.period_s
            self._unloaded_s = np.where(light, self._unloaded_s + period_s, 0.0)
        if not self._unread:
            super().observe()

    def _move(self, state: Any) -> None:
        self._placed.base[:] = state["base"]
        self._placed.place(state["q"])
        self._placed.move(state["dq"])

    def state_problem(self, setpoint: Any) -> Statement:
        """The problem of an answer to the newest State."""
        n, count = self.history.description.n, soles.WRENCH * len(self._soles.soles)
        decision, zero = np.array(setpoint["decision"], float), np.zeros(n)
        if decision.size != BASE + 2 * n + count:
            return Statement("free base", (), zero, zero, (), (("certificate", NO_DECISION),))
        answer = Answer(*np.split(decision, [BASE + n, BASE + 2 * n]))
        self._move(self.history.state)
        ground, fallback = self._ground(), int(setpoint["fallback"])
        claims = self._mechanics_claims(setpoint, answer, ground, fallback)
        branch = BRANCHES[min(fallback, CLIPPED)]
        if self._unread:
            reason = (("tasks and optimum", self._unread),)
            return Statement(branch, (), zero, zero, tuple(claims), reason)
        cycle = self._free_cycle(answer, ground)
        tops = np.repeat(self.tops(cycle.importance), np.diff(self.edges))
        claims += lyapunov_claims(setpoint, cycle, tops, self.history.description.period_s)
        claims += self._column_claims(setpoint, cycle)
        claims += self._margin_claims(setpoint, cycle, answer, fallback)
        problems, exact, unverified = self._problems(setpoint, cycle, ground, answer)
        claims += self._status_claims(setpoint, ground, answer, exact, has_tops=bool(tops.any()))
        y, error = zero, zero
        if ground.reduced is not None:
            y = ground.reduced.y_of(answer.motion, answer.wrench)
            error = np.full(n, ROUNDING * self._size(answer, ground.reduced))
        return Statement(branch, problems, y, error, tuple(claims), unverified)

    def _ground(self) -> Ground:
        """Evaluate dynamics and contacts at the newest State."""
        robot, T = self._placed, self.history.description.period_s
        M, h = robot.dynamics()
        friction = np.concatenate([np.zeros(BASE), self._viscous])
        M, h = M + T * np.diag(friction), h + friction * robot.v
        contact = self._soles.contact()
        return Ground(M, h, contact, self._soles.reduced(M, h, contact))

    def _size(self, answer: Answer, reduced: soles.Reduced) -> float:
        """Return the largest number of an answer and of y = 0, wrenches in their units."""
        wrenches = np.concatenate([answer.wrench, reduced.wrench_start])
        motion = np.concatenate([answer.motion, reduced.motion_start])
        pressed = np.abs(wrenches / np.tile(reduced.units, 2))
        return float(max(np.abs(motion).max(), pressed.max()))

    def _off(self, answer: Answer, ground: Ground, *, base_only: bool) -> tuple[float, float]:
        """Return how far an answer is from its equations of motion and of contact, relative."""
        motion, contact = answer.motion, ground.contact
        force = ground.M @ motion + ground.h - contact.J.T @ answer.wrench
        force[BASE:] -= answer.tau
        force = force[:BASE] if base_only else force
        slip = contact.J @ motion + contact.rate + self._soles.damping * contact.twist
        size = 1.0 + float(np.abs(motion).max())
        return float(np.abs(force).max()) / self._soles.weight, float(np.abs(slip).max()) / size

    def _mechanics_claims(
        self, setpoint: Any, answer: Answer, ground: Ground, fallback: int
    ) -> list[Claim]:
        """Whether an answer is a motion that ground and motors allow."""
        tau, most = answer.tau, self.torque_max
        share = float((np.abs(tau) / most).max())
        sent = tau if self._torques else answer.motion[BASE:]
        kind = COMMANDS["torque" if self._torques else "acceleration"]
        stated = float(setpoint["extra"][self._columns["largest_torque_share"]])
        claims = [
            Claim("command", float(setpoint["command"]), float(kind), 0.0),
            worst("setpoint", setpoint["values"], sent, ROUNDING * np.abs(sent)),
            Claim("torques", share, 1.0, EXACT, "at_most"),
            Claim("largest torque share", stated, share, RELATIVE * share),
        ]
        if fallback < CLIPPED:
            clipped = fallback == OVERLOADED
            force, slip = self._off(answer, ground, base_only=clipped)
            claims.append(Claim("equations of motion", force, 0.0, EXACT, "at_most"))
            claims.append(Claim("soles at rest", slip, 0.0, EXACT, "at_most"))
        else:
            claims += self._braking_claims(answer, ground)
        if fallback < OVERLOADED:
            outside = self._soles.outside_cones(answer.wrench)
            claims.append(Claim("friction cones", outside, 0.0, EXACT, "at_most"))
        if int(setpoint["solver_status"]) == CERTIFIED:
            claims.append(Claim("certified: solved", float(fallback == SOLVED), 1.0, 0.0))
            lost = not all(option.all() for option in self._loaded()[:1])
            claims.append(Claim("certified: soles carry", float(lost), 0.0, 0.0))
        return claims

    def _braking_claims(self, answer: Answer, ground: Ground) -> list[Claim]:
        """Torques −10/s·M_jj·q̇_j within their limits, and nothing else."""
        own, most = ground.M.diagonal()[BASE:], self.torque_max
        tau = np.clip(-BRAKE_PER_S * own * self._placed.v[BASE:], -most, most)
        exact = RELATIVE * np.abs(tau)
        motion = np.concatenate([np.zeros(BASE), tau / own])
        return [
            worst("braking", answer.tau, tau, exact),
            worst("braking", answer.motion, motion, RELATIVE * np.abs(motion)),
            worst("braking", answer.wrench, 0.0, 0.0),
        ]

    def _loaded(self) -> list[Flags]:
        """Return which soles carry; several where that depends on rounding, the most first."""
        lost_after_s = float(self._contacts["lost_after_s"])
        exact_s = EXACT + ROUNDING * float(self._unloaded_s.max(initial=0.0))
        return list(soles.loaded_options(self._unloaded_s, lost_after_s, exact_s))

    def _free_cycle(self, answer: Answer, ground: Ground) -> Cycle:
        """Evaluate tasks and bounds at the newest State."""
        state, time_s, robot = self.history.state, self.history.time_s, self._placed
        T, seen, desired, errors = self.history.description.period_s, [], [], []
        for task, (kp, kd) in zip(self.tasks, self.gains, strict=True):
            rows = task.at(robot, robot.v, time_s, T)
            wanted = kp * rows.error - kd * rows.motion - rows.rate
            size = kp * np.abs(rows.error) + kd * np.abs(rows.motion) + np.abs(wanted)
            seen.append(rows)
            desired.append(wanted)
            errors.append(np.array([kp, kd, 1.0]) @ rows.exact + ROUNDING * size)
        q, dq = np.array(state["q"]), np.array(state["dq"])
        least, most = self.bounds.begun(self._start).at(q, dq)
        found = robot.v, stack_rows(seen), np.concatenate(desired), np.concatenate(errors)
        none, still = np.zeros(len(q)), np.zeros(robot.width)
        given = ground.M, ground.h, none, least, most, self._schedule.values
        return Cycle(*found, *given, answer.motion, answer.tau, still, none)

    def _margin_claims(
        self, setpoint: Any, cycle: Cycle, answer: Answer, fallback: int
    ) -> list[Claim]:
        """The least distance from bounds of joints, torques and cones."""
        ddq, largest = answer.motion[BASE:], self.bounds.scale
        share = float((np.abs(answer.tau) / self.torque_max).max())
        room = float((np.minimum(ddq - cycle.lower, cycle.upper - ddq) / largest).min())
        cones = 0.0 if fallback >= CLIPPED else self._soles.cone_margin(answer.wrench)
        margin = min(1.0, room, 1.0 - share, cones)
        off = RELATIVE * max(1.0, float((np.abs(ddq) / largest).max()))
        return [Claim("margin", float(setpoint["margin"]), margin, off)]

    def _status_claims(
        self, setpoint: Any, ground: Ground, answer: Answer, exact: float, *, has_tops: bool
    ) -> list[Claim]:
        """ρ, the residual, and the status that follows from it."""
        status, fallback = int(setpoint["solver_status"]), int(setpoint["fallback"])
        solved, residual = fallback == SOLVED, float(setpoint["kkt_residual"])
        claims = [
            Claim("rho", float(setpoint["rho"]), 1.0, RELATIVE),
            Claim(
                "residual", residual, 0.0, max(exact, OPTIMAL) if solved and self.proves else 0.0
            ),
            Claim("solver path", float(setpoint["solver_path"]), fallback, 0.0),
        ]
        brakes = ground.reduced is None or not any(each.any() for each in self._loaded())
        claims.append(Claim("fallback", fallback, CLIPPED, 0.0, "equal" if brakes else "at_most"))
        stationary = any(each.startswith(STATIONARY) for each in self.history.conditions)
        expected = UNCERTIFIED if solved else INFEASIBLE
        if solved and self.proves and self.bounds.kind == "viability" and has_tops:
            off = max(
                *self._off(answer, ground, base_only=False), -self._soles.cone_margin(answer.wrench)
            )
            kept = off <= EXACT and residual <= OPTIMAL
            carry = {bool(option.all()) for option in self._loaded()}
            either = len(carry) == 2 and status == UNCERTIFIED
            if kept and True in carry and not (either or self._schedule.moves or stationary):
                expected = CERTIFIED
        return [*claims, Claim("status", status, expected, 0.0)]

    def _problems(
        self, setpoint: Any, cycle: Cycle, ground: Ground, answer: Answer
    ) -> tuple[tuple[Callable[[], Problem], ...], float, tuple[tuple[str, str], ...]]:
        """Return the problems that an answer may solve, how exactly, and what is unverified."""
        fallback, reduced = int(setpoint["fallback"]), ground.reduced
        no_answer = (("fallback: no answer", NO_PROOF),)
        if fallback == OVERLOADED:
            return (), 0.0, (*no_answer, ("fallback: least violation", SOFTENED))
        if fallback >= CLIPPED or reduced is None:
            return (), 0.0, no_answer if any(each.any() for each in self._loaded()) else ()
        unverified = () if fallback == SOLVED else no_answer
        if not self.stated:
            return (), 0.0, (*unverified, ("optimum", NO_OPTIMUM))
        states = fallback == SOLVED and self.proves
        residual = min(float(setpoint["kkt_residual"]), OPTIMAL) if states else OPTIMAL
        unknowns = Unknowns(reduced, reduced.y_of(answer.motion, answer.wrench), residual)
        problems: list[Callable[[], Problem]] = []
        exact = 0.0
        for loaded in self._loaded():
            if loaded.any():
                rows = self._rows(cycle, answer, reduced, loaded, bounded=fallback == SOLVED)
                tasks = self._desired(cycle, ground, reduced, loaded)
                program, near = self.program(cycle, unknowns, tasks, rows)
                problems.append(partial(_same, program))
                exact = max(exact, near)
        return tuple(problems), exact, unverified

    def braking(self, cycle: Cycle, reduced: soles.Reduced) -> Task:
        """Return q̈ = −d·q̇ of the joints, d at most 1/T, as a task of y."""
        T = self.history.description.period_s
        d, dq = min(float(self.settings["null_damping_per_s"]), 1.0 / T), cycle.dq[BASE:]
        start = reduced.motion_start
        error = ROUNDING * (np.abs(d * dq) + reduced.condition * float(np.abs(start).max()))
        return Task(reduced.motion[BASE:], -d * dq - start[BASE:], error)

    def _desired(self, cycle: Cycle, ground: Ground, reduced: soles.Reduced, loaded: Flags) -> Task:
        """Return what tasks desire of y, with the centre of mass held within the loaded soles."""
        J, desired, error = cycle.rows.jacobian, cycle.desired.copy(), cycle.desired_error.copy()
        for task, first in zip(self.tasks, self.edges, strict=False):
            if isinstance(task, ComTask) and self._contacts["within_support"]:
                com, _, _, rate = self._placed.com_motion()
                rows = slice(first, first + 3)
                wanted = desired[rows] + rate
                given, off = self._soles.supported(wanted, com, ground.contact, loaded)
                desired[rows] = np.append(given, wanted[2]) - rate
                error[rows] += off
        start = float(np.abs(reduced.motion_start).max())
        error = error + ROUNDING * reduced.condition * np.abs(J).sum(1) * start
        return Task(J @ reduced.motion, desired - J @ reduced.motion_start, error)

    def _rows(
        self,
        cycle: Cycle,
        answer: Answer,
        reduced: soles.Reduced,
        loaded: Flags,
        *,
        bounded: bool,
    ) -> Rows:
        """State the limits as rows of y; `bounded`: those of the joints' accelerations as well."""
        ground, ddq, most = self._soles, answer.motion[BASE:], self.torque_max
        start, normals = reduced.wrench_start, ground.normals
        parts = [
            shifted_rows(
                reduced.torque, reduced.torque_start, -most, most, RELATIVE * (1.0 + np.abs(most))
            ),
            shifted_rows(
                ground.facets @ reduced.wrench,
                ground.facets @ start,
                np.full(len(ground.facets), -np.inf),
                np.zeros(len(ground.facets)),
                EXACT * ground.weight,
            ),
            shifted_rows(
                reduced.wrench[normals],
                start[normals],
                np.where(loaded, self._contacts["least_share"] * ground.weight, 0.0),
                np.where(loaded, np.inf, UNLOADED_SHARE * ground.weight),
                EXACT * ground.weight,
            ),
        ]
        if bounded:
            error = RELATIVE * (1.0 + np.abs(ddq))
            given = reduced.motion_start[BASE:], cycle.lower, cycle.upper, error
            parts.append(shifted_rows(reduced.motion[BASE:], *given))
        return Rows.stacked(parts)


def _same(program: Program) -> Program:
    return program


def shifted_rows(A: Array, a: Array, lower: Array, upper: Array, error: Array | float) -> Rows:
    """Return lower ≤ A y + a ≤ upper as rows without an offset."""
    return Rows.of(A, lower - a, upper - a, error=error)


def _has_base(state: Any) -> bool:
    """Return whether the quaternion of a State's base is of length 1."""
    turn = state["base"][QUATERNION]
    return bool(abs(float(turn @ turn) - 1.0) <= OF_LENGTH_1)
