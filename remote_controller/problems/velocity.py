"""What the problems of velocity controllers with several tasks share.

The answer is a joint velocity u, and the setpoint is start + u·T. Its bounds are those of speed,
of acceleration, and of stopping before the end of the range in steps of A·T.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, ClassVar, Literal

import numpy as np

from hoap3.protocol.messages import State
from hoap3.protocol.robot.description import RobotDescription
from hoap3.remote_controller.problems.history import ProblemBuilder
from hoap3.remote_controller.problems.oracles.constraints.joints_oracle import stopping_speed
from hoap3.remote_controller.problems.oracles.parameters import (
    UnverifiableError,
    complete,
    is_number,
)
from hoap3.remote_controller.problems.oracles.robot_oracle import Robot
from hoap3.remote_controller.problems.oracles.tasks.config_oracle import default_entry, task_of
from hoap3.remote_controller.problems.oracles.tasks.task_oracle import AnyTask
from hoap3.remote_controller.problems.statement import Array, Claim, Statement
from hoap3.remote_controller.problems.velocity_answer import DELAYED, RELATIVE, VelocityAnswer

PLACE = 64.0 * float(np.finfo(float).eps)
"""How exactly a place of some metres is known from joint positions, or an angle [m or rad]: each
of up to ten joints rounds it by a few units of the last place."""
INSIDE = 1.0 - 1e-9  # of the robot's greatest acceleration: it uses rounded positions
MARGIN_RAD = 1e-9  # taken off both ends of the range
UNIT, RESERVES = 2.0**-52, 8.0  # of the last place, and how many each step of braking may take
DEFAULTS: dict[str, Any] = {
    "tasks": None,
    "bounds": {},
    "leave_singularity": (False, True),
    "kinematics_from": ("measured", "reference"),
    "integrate_from": ("reference", "measured"),
}
Relation = Literal["equal", "at_most", "at_least"]


def claim(
    name: str,
    stated: float,
    value: float,
    error: float | None = None,
    relation: Relation = "equal",
) -> Claim:
    """A claim of a number; without an error it may differ by `RELATIVE`."""
    stated, value = float(stated), float(value)
    error = RELATIVE * max(abs(stated), abs(value)) if error is None else float(error)
    return Claim(name, stated, value, error, relation)


def claim_each(
    name: str, stated: Array, value: Array, error: Array | float, relation: Relation = "equal"
) -> Claim:
    """The claim of that entry of arrays which is furthest off, relative to its error."""
    stated, value, error = np.broadcast_arrays(stated, value, error)
    with np.errstate(invalid="ignore", divide="ignore"):
        off = stated - value
        off = np.abs(off) if relation == "equal" else off if relation == "at_most" else -off
        share = np.where((stated == value) | (off <= 0.0), 0.0, off / error)
    at = int(np.argmax(np.where(np.isnan(share), np.inf, share)))
    return claim(name, stated[at], value[at], error[at], relation)


def settings_of(given: Mapping[str, Any], defaults: Mapping[str, Any]) -> dict[str, Any]:
    """The parameters of a controller, completed by `DEFAULTS` and its own `defaults`.

    Raises:
        UnverifiableError: a value that cannot be used.
    """
    settings = complete(given, {**DEFAULTS, **defaults}, "parameters", strict=False)
    bounds, tasks = settings["bounds"], settings["tasks"]
    if not all(value is None or is_number(value) for value in bounds.values()):
        raise UnverifiableError(f"parameter bounds is {bounds!r:.40}")
    if tasks is not None and not (
        isinstance(tasks, Sequence) and tasks and all(isinstance(task, Mapping) for task in tasks)
    ):
        raise UnverifiableError(f"parameter tasks is {tasks!r:.40}")
    return settings


def of_rows(
    entries: Sequence[Mapping[str, Any]], sizes: Sequence[int], key: str, usual: float
) -> Array:
    """A positive number of each task, for each of its rows, (m,).

    Raises:
        UnverifiableError: it is none.
    """
    numbers = [entry.get(key, usual) for entry in entries]
    if not all(is_number(number) and number > 0.0 for number in numbers):
        raise UnverifiableError(f"{key} of a task is none")
    return np.repeat(np.array(numbers, float), sizes)


def limits_of(robot: RobotDescription, given: Mapping[str, Any]) -> Array:
    """Ends of the range, greatest speed and acceleration, (4, n), none beyond the robot's.

    Args:
        robot: its description.
        given: `bounds` of the config.
    """
    aside = float(given.get("margin_rad", MARGIN_RAD))
    speed, acceleration = given.get("speed_rad_s"), given.get("acceleration_rad_s2")
    braking = robot.brake_acceleration if acceleration is None else float(acceleration)
    return np.array(
        [
            robot.lower + aside,
            robot.upper - aside,
            np.minimum(robot.velocity, np.inf if speed is None else float(speed)),
            np.minimum(INSIDE * robot.setpoint_acceleration_max, braking),
        ]
    )


def velocity_bounds(q: Array, v: Array, limits: Array, T: float) -> tuple[Array, Array]:
    """Least and greatest next velocity at positions q and velocities v, all (n,) or (N, n)."""
    lower, upper, speed, A = limits
    most, least = np.clip(v + A * T, -speed, speed), np.clip(v - A * T, -speed, speed)
    most = np.where(most > 0.0, _stoppable(most, upper - q, upper, limits, T), most)
    least = np.where(least < 0.0, -_stoppable(-least, q - lower, lower, limits, T), least)
    too_fast = least > most  # to stop in time as gently as that: brakes as it can
    one = np.where(v > 0.0, most, least)
    return np.where(too_fast, one, least), np.where(too_fast, one, most)


def _stoppable(wanted: Array, room: Array, end: Array, limits: Array, T: float) -> Array:
    """As much of a velocity towards an end of the range, `room` away, as can stop before it."""
    _, _, speed, A = limits
    steps = speed / (A * T) + 2.0
    far = np.minimum(0.5 * steps * speed * T, np.maximum(room, 0.0))
    ends = np.isfinite(end)
    left = room - np.where(ends, RESERVES * UNIT * steps * (np.abs(end) + far), 0.0)
    free = 0.5 * wanted * (wanted / A + T) + A * T * T / 8.0 <= left
    last = np.minimum(np.maximum(room, 0.0) / T, A * T)
    braking = np.maximum(last, stopping_speed(np.where(ends, left, 0.0), A, T))
    return np.where(free, wanted, np.minimum(wanted, braking))


@dataclass(frozen=True)
class Cycle:
    """All tasks below each other, m rows, in one cycle, and the velocity that was answered.

    Attributes:
        e: errors, (m,).
        J: ∂e/∂q, (m, n).
        rate: ∂e/∂t, (m,).
        along: e a period later if no joint moves, (m,).
        ahead: e a period later where u leads, (m,).
        place: how exactly each error is known, (m,).
        u, u_error: velocity, and how exactly it is known, (n,) [rad/s or m/s].
        lower, upper: its bounds, (n,).
    """

    e: Array
    J: Array
    rate: Array
    along: Array
    ahead: Array
    place: Array
    u: Array
    u_error: Array
    lower: Array
    upper: Array

    @property
    def moving(self) -> bool:
        """Whether a target moves."""
        return bool(self.rate.any())


class VelocityProblems(ProblemBuilder):
    """States problems of a controller that answers with the velocity for a stack of tasks."""

    controller: ClassVar[str]
    defaults: ClassVar[Mapping[str, Any]]
    """Registered name, and defaults of the controller's own parameters."""

    def __init__(
        self,
        description: RobotDescription,
        parameters: Mapping[str, Any],
        session: Mapping[str, Any],
        controller: str = "",
    ) -> None:
        super().__init__(description, parameters, session, controller or self.controller)
        self.robot = Robot(description, self.history.messages)
        self.T = description.period_s
        self.entries: list[Mapping[str, Any]] = []
        self.tasks: list[AnyTask] = []
        self.adopt(parameters)
        if list(session.get("extra", ())) != self.columns():
            raise UnverifiableError("the columns are not those of its tasks")
        if description.delay_ticks and self.settings["kinematics_from"] == "reference":
            raise UnverifiableError(DELAYED)

    @abstractmethod
    def figures(self) -> list[str]:
        """Names of the columns after the errors."""

    @abstractmethod
    def cycle_problem(self, setpoint: Any, cycle: Cycle, claims: list[Claim]) -> Statement:
        """The problem of an answer; `claims` has those that need no law of the controller."""

    def adopt(self, parameters: Mapping[str, Any]) -> None:
        """Take other parameters; targets go on as they are.

        Raises:
            UnverifiableError: a value that cannot be used.
        """
        self.settings = settings_of(parameters, self.defaults)
        given, before = self.settings["tasks"], self.entries
        self.entries = [default_entry(self.history.description)] if given is None else list(given)
        if self.tasks:
            changes = zip(self.entries, before, self.tasks, strict=True)
            self.tasks = [
                old if _same_task(entry, last) else _continued(task_of(entry, self.robot), old)
                for entry, last, old in changes
            ]
        else:
            self.tasks = [task_of(entry, self.robot) for entry in self.entries]
        self.sizes = [task.size for task in self.tasks]
        self.rows = [slice(*ends) for ends in pairwise(np.cumsum([0, *self.sizes]).tolist())]
        self.limits = limits_of(self.history.description, self.settings["bounds"])

    def derivative_claims(self) -> list[Claim]:
        """Claims of the derivatives of users' tasks."""
        return [claim for task in self.tasks for claim in task.derivative_claims(self.robot)]

    @property
    def labels(self) -> list[str]:
        """Names of the tasks."""
        return [str(entry.get("name") or entry.get("task")) for entry in self.entries]

    def columns(self) -> list[str]:
        """Names that `extra` has."""
        return [f"error_{label}" for label in self.labels] + self.figures()

    def begin(self) -> None:
        """Start the targets from where the robot is."""
        self.robot.place(self._base)
        for task in self.tasks:
            task.begin(self.robot, self.history.time_s)

    @property
    def has_memory(self) -> bool:
        """Whether a task remembers violated tolerances of its trajectory."""
        return any(task.watched for task in self.tasks)

    def observe(self) -> None:
        """Compare measured positions with the tolerances of trajectories."""
        state = self.history.state
        watched = [task for task in self.tasks if task.watched]
        if watched and state["mode"] == State.ACTIVE:  # else it follows no setpoint
            self.robot.place(state["q"])
            for task in watched:
                task.watch(self.robot, self.history.time_s)

    def state_problem(self, setpoint: Any) -> Statement:
        """The problem of an answer to the newest State."""
        cycle = self._cycle(setpoint)
        found = np.array([np.linalg.norm(cycle.e[rows]) for rows in self.rows])
        near = np.array([np.linalg.norm(cycle.place[rows]) for rows in self.rows])
        stated = setpoint["extra"][: len(found)]
        claims = [claim_each("error", stated, found, RELATIVE * found + near)]
        claims += self.logged_claims(setpoint)
        if self.history.description.delay_ticks:
            return self.unverifiable("delayed", setpoint, claims, [("u", DELAYED)])
        claims += [*self._answer(setpoint).claims(), _margin_claim(setpoint, cycle)]
        return self.cycle_problem(setpoint, cycle, claims)

    def logged_claims(self, setpoint: Any) -> list[Claim]:
        """Claims of numbers that do not depend on u."""
        del setpoint
        return []

    def unverifiable(
        self,
        branch: str,
        setpoint: Any,
        claims: Sequence[Claim],
        reasons: Sequence[tuple[str, str]],
    ) -> Statement:
        """A statement of claims alone."""
        answer = setpoint["values"]
        return Statement(branch, (), answer, 0.0 * answer, tuple(claims), tuple(reasons))

    @property
    def _base(self) -> Array:
        """Joint positions that kinematics are computed from, (n,)."""
        measured = self.settings["kinematics_from"] == "measured"
        base: Array = self.history.state["q" if measured else "reference"]
        return base

    def _answer(self, setpoint: Any) -> VelocityAnswer:
        return VelocityAnswer.of(self.history.state, setpoint, self.settings, self.T)

    def _reference_velocity(self) -> Array:
        """How the commanded position moved since the last period, (n,); first what is measured."""
        history = self.history
        state, before = history.state, history.before
        if before is None:
            return np.asarray(np.nan_to_num(state["dq"], posinf=0.0, neginf=0.0))
        periods = history.periods_between(before, state)
        return np.asarray((state["reference"] - before["reference"]) / (periods * self.T))

    def _cycle(self, setpoint: Any) -> Cycle:
        robot, now, base = self.robot, self.history.time_s, self._base
        answer = self._answer(setpoint)
        robot.place(base)
        parts = [task.at(robot, now) for task in self.tasks]
        e, J, rate = (np.concatenate([part[k] for part in parts]) for k in range(3))
        along = self._errors(now + self.T) if rate.any() else e
        robot.place_only(base + answer.u * self.T)
        ahead = self._errors(now + self.T)
        place = np.concatenate([PLACE * task.rounding * task.roots for task in self.tasks])
        reference = self.history.state["reference"]
        bounds = velocity_bounds(reference, self._reference_velocity(), self.limits, self.T)
        return Cycle(e, J, rate, along, ahead, place, answer.u, answer.error, *bounds)

    def _errors(self, time_s: float) -> Array:
        return np.concatenate([task.error_at(self.robot, time_s) for task in self.tasks])


def _same_task(entry: Mapping[str, Any], other: Mapping[str, Any]) -> bool:
    """Return whether two entries differ in nothing that the task itself has."""
    return all(entry.get(key) == other.get(key) for key in ("task", "parameters"))


def _continued(task: AnyTask, old: AnyTask) -> AnyTask:
    task.take_over(old)
    return task


def _margin_claim(setpoint: Any, cycle: Cycle) -> Claim:
    """The least distance of u from a bound."""
    margin = np.minimum(cycle.u - cycle.lower, cycle.upper - cycle.u).min()
    size = np.maximum(np.abs(cycle.lower), np.abs(cycle.upper))
    return claim("margin", setpoint["margin"], margin, (RELATIVE * size + cycle.u_error).max())
