"""Controllers of several tasks: tasks, bounds and dynamics of each cycle, its answer's motion."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.robot.description import RobotDescription
from hoap3.remote_controller.problems.oracles.acceleration_bounds_oracle import Bounds
from hoap3.remote_controller.problems.oracles.robot_oracle import RigidBody, Robot
from hoap3.remote_controller.problems.oracles.tasks.acceleration_oracle import (
    ROUNDING,
    AccelerationTask,
    TaskRows,
    acceleration_task_of,
    gains_of,
    stack_rows,
)
from hoap3.remote_controller.problems.oracles.tasks.live_oracle import Messages
from hoap3.remote_controller.problems.oracles.tasks.wrench_oracle import WrenchTask
from hoap3.remote_controller.problems.schedule import Schedule
from hoap3.tools.verify.controller_log import ControllerRun

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

CHUNK = 1000  # cycles that are looked at together


@dataclass(frozen=True)
class Cycles:
    """Some cycles, N of them, in their order.

    Attributes:
        q, dq: (N, n).
        rows: of all tasks below each other: J (N, m, n), and the rest (N, m); exact (N, 3, m).
        wanted: J·q̈ that is asked for, (N, m), and how exactly it is known.
        mass, bias: M (N, n, n) and h (N, n), viscous friction at the end of the period included.
        weight: torques that the robot adds to a command by itself, (N, n).
        lower, upper: of q̈, (N, n).
        numbers: weights (N, k) or priorities (N, k, k).
        moved: whether they are others in the next tick, (N,).
        measured: wrenches along the directions in which tasks keep one, (N, w) [N, N m].
        touches: whether some such task does, (N,).
        ddq, tau: of the answer, and how exactly they are known, (N, n).
    """

    q: Array
    dq: Array
    rows: TaskRows
    wanted: Array
    wanted_exact: Array
    mass: Array
    bias: Array
    weight: Array
    lower: Array
    upper: Array
    numbers: Array
    moved: Flags
    measured: Array
    touches: Flags
    ddq: Array
    ddq_exact: Array
    tau: Array
    tau_exact: Array

    def part(self, which: Flags) -> Cycles:
        """Some of the cycles, (N,)."""
        found = {each.name: getattr(self, each.name) for each in fields(self)}
        found["rows"] = TaskRows(*(part[which] for part in self.rows))
        return Cycles(**{k: v if k == "rows" else v[which] for k, v in found.items()})


class Hierarchy:
    """What a config makes of a robot.

    Args:
        description: of the robot.
        entries: the tasks of the config.
        settings: its parameters, complete.
        torques: whether answers are torques; else accelerations.
        messages: of live targets.

    Attributes:
        tasks, gains: of each task.
        spans: where each task's rows stand.
        bounds: of the accelerations.
        torque_max: greatest torques, (n,).

    Raises:
        UnverifiableError: a task that cannot be recomputed.
    """

    def __init__(
        self,
        description: RobotDescription,
        entries: Sequence[Mapping[str, Any]],
        settings: Mapping[str, Any],
        *,
        torques: bool,
        messages: Messages,
    ) -> None:
        self.description, self.torques = description, torques
        self.robot = robot = Robot(description, messages)
        self.tasks: list[AccelerationTask] = [
            WrenchTask(entry["parameters"], robot)
            if entry["task"] == "wrench"
            else acceleration_task_of(entry, robot)
            for entry in entries
        ]
        self.gains = [gains_of(entry) for entry in entries]
        self.presses = [task for task in self.tasks if isinstance(task, WrenchTask)]
        places = {sensor: i for i, sensor in enumerate(description.wrench_sensors)}
        self._felt = {press.sensor: places[press.sensor] for press in self.presses}
        self.bounds = Bounds.of(description, settings["bounds"])
        given = settings["bounds"]["torque_max"] or (np.inf,)
        self.torque_max = np.minimum(description.effort, given)
        self._body = RigidBody(robot)
        self._friction = self._body.damping * float(settings["compensate_friction"])
        robot.place(description.initial_position)
        robot.move(np.zeros(description.n))
        for task in self.tasks:
            task.begin(robot, 0.0)
        rest = np.zeros(description.n)
        sizes = [len(task.at(robot, rest, 0.0, description.period_s).error) for task in self.tasks]
        edges = np.cumsum([0, *sizes]).tolist()
        self.spans = [slice(*edge) for edge in pairwise(edges)]
        self.sizes = sizes

    def cycles(
        self, run: ControllerRun, begin: Callable[[], Schedule]
    ) -> Iterator[tuple[ControllerRun, Cycles]]:
        """All answers, some at a time.

        Args:
            run: whose States are finite.
            begin: makes the schedule of weights or priorities, as it is at a reset.
        """
        numbers, moved = scheduled(run, begin)
        lower, upper = self._limits(run)
        places, begun = np.arange(len(run.answers)), -1
        for start in range(0, len(places), CHUNK):
            chosen = (places >= start) & (places < start + CHUNK)
            part, seen = run.only(chosen), []
            for at, present in zip(part.answered.tolist(), numbers[chosen], strict=True):
                if reset_of(run, at) != begun:
                    begun = reset_of(run, at)
                    self._begin(run, begun)
                seen.append(self._look(run.states[at], absent_in(present)))
            found = [np.array(each) for each in zip(*seen, strict=True)]
            limits = lower[chosen], upper[chosen], numbers[chosen], moved[chosen]
            yield part, self._cycles(part, found, *limits)

    def _limits(self, run: ControllerRun) -> tuple[Array, Array]:
        """Bounds of all answers; who begins outside them may stay there."""
        states = run.answered_states
        lower, upper = np.zeros((2, *states["q"].shape))
        resets = np.array([reset_of(run, at) for at in run.answered.tolist()], np.int64)
        for reset in np.unique(resets).tolist():
            mine = resets == reset
            limits = self.bounds.begun(run.states["q"][reset])
            lower[mine], upper[mine] = limits.at(states[mine]["q"], states[mine]["dq"])
        return lower, upper

    def _begin(self, run: ControllerRun, reset: int) -> None:
        """Have all tasks set out from the first State since a reset that is finite."""
        states = run.states[reset:]
        finite = np.isfinite(states["q"]).all(1) & np.isfinite(states["dq"]).all(1)
        state = states[int(finite.argmax())]
        self.robot.place(state["q"])
        self.robot.move(state["dq"])
        for task in self.tasks:
            task.begin(self.robot, int(state["tick"]) * self.description.period_s)

    def _look(self, state: Any, absent: Array) -> tuple[Array, ...]:
        """What is wanted, M, h, the robot's own torques, wrenches, and all rows, at a State."""
        q, dq, T = state["q"], state["dq"], self.description.period_s
        self.robot.place(q)
        self.robot.move(dq)
        time_s = int(state["tick"]) * T
        for task in self.tasks:
            task.watch(self.robot, time_s)
        M, h, weight = self._body.at(q, dq)
        M, h = M + T * np.diag(self._friction), h + self._friction * dq
        for sensor, place in self._felt.items():
            J, _, _ = self.robot.frame_motion(sensor, own_axes=True)
            h -= J.T @ state["wrench"][6 * place : 6 * place + 6]
        seen, asked = [], []
        for task, (kp, kd), out in zip(self.tasks, self.gains, absent, strict=True):
            rows = task.at(self.robot, dq, time_s, T)
            wanted = kp * rows.error - kd * rows.motion - rows.rate
            if isinstance(task, WrenchTask):
                place = self._felt[task.sensor]
                wrench = state["wrench"][6 * place : 6 * place + 6]
                task.feel(self.robot, wrench, float(out), time_s, T)
                if task.touches:
                    rows, wanted = task.press(rows, wanted, M)
            seen.append(rows)
            asked.append(wanted)
        measured = np.concatenate([np.zeros(0), *(press.measured for press in self.presses)])
        touches = np.array(any(press.touches for press in self.presses))
        return (np.concatenate(asked), M, h, weight, measured, touches, *stack_rows(seen))

    def _cycles(
        self,
        run: ControllerRun,
        found: Sequence[Array],
        lower: Array,
        upper: Array,
        numbers: Array,
        moved: Flags,
    ) -> Cycles:
        states = run.answered_states
        wanted, mass, bias, weight, measured, touches = found[:6]
        rows = TaskRows(*found[6:])
        kp, kd = np.repeat(np.array(self.gains), self.sizes, axis=0).T
        e, nu, rate = np.moveaxis(rows.exact, 1, 0)
        exact = kp * e + kd * nu + rate
        exact += ROUNDING * (kp * np.abs(rows.error) + kd * np.abs(rows.motion) + np.abs(wanted))
        motion = self._motion(run, mass, bias, weight, states["dq"])
        given = states["q"], states["dq"], rows, wanted, exact, mass, bias, weight
        present = lower, upper, numbers, moved, measured, touches.astype(bool)
        return Cycles(*given, *present, *motion)

    def _motion(
        self, run: ControllerRun, M: Array, h: Array, weight: Array, dq: Array
    ) -> tuple[Array, Array, Array, Array]:
        """q̈ and τ of the answers, and how exactly each is known, (N, n)."""
        answers, n = run.answers, self.description.n
        values, still = answers["values"].astype(float), np.zeros(h.shape)
        if has_decision(run, 2 * n):
            ddq, tau = np.split(answers["decision"].astype(float), 2, axis=1)
            return ddq, still, tau, still
        if not self.torques:
            tau = (M @ values[..., None])[..., 0] + h
            return values, still, tau, still + rounding_of(M, h, dq, values)
        tau, inverse = values + weight, np.linalg.inv(M)
        ddq = (inverse @ (tau - h)[..., None])[..., 0]
        exact = ROUNDING * (np.abs(values) + np.abs(weight)) + rounding_of(M, h, dq, ddq)
        return ddq, (np.abs(inverse) @ exact[..., None])[..., 0], tau, exact


def rounding_of(M: Array, h: Array, dq: Array, ddq: Array) -> Array:
    """How exactly M·q̈ + h is known, (N, 1), of M (N, n, n) and the rest (N, n).

    Inertias of light links are differences of what they are about the root, so each entry of M has
    the rounding of the largest.
    """
    motion = np.abs(ddq).sum(1) + np.abs(dq).sum(1) ** 2
    found = np.abs(M).max((1, 2)) * motion + np.abs(h).max(1)
    return np.asarray(ROUNDING * found[:, None])


def has_decision(run: ControllerRun, size: int) -> bool:
    """Whether the answers hold so many numbers of what was solved for."""
    answers = run.answers
    return "decision" in (answers.dtype.names or ()) and answers["decision"].shape[1] == size


def absent_in(numbers: Array) -> Array:
    """How far each task is out, (k,) from 0 to 1, by priorities (k, k) or weights (k,)."""
    if numbers.ndim == 2:
        return numbers.diagonal()
    return np.asarray(numbers <= 0.0, float)


def reset_of(run: ControllerRun, at: int) -> int:
    """Place of the State at which the controller last began anew."""
    return max(place for place in run.resets if place <= at)


def scheduled(run: ControllerRun, begin: Callable[[], Schedule]) -> tuple[Array, Flags]:
    """The numbers of each answer, (N, …), and whether they are others in the next tick, (N,).

    They are settled one tick ahead: a change that comes between two States shows after the second.
    """
    T, states = run.description.period_s, run.states
    finite = np.isfinite(states["q"]).all(1) & np.isfinite(states["dq"]).all(1)
    schedule, reset, done, settled, first = begin(), -1, 0, 0, 0
    present = schedule.at(0.0)
    waiting: list[tuple[int, dict[str, Any]]] = []
    numbers, moved = [], []
    for at in run.answered.tolist():
        if reset_of(run, at) != reset:
            reset = done = reset_of(run, at)
            schedule, settled, first = begin(), 0, int(states["tick"][reset])
            present = schedule.at(0.0)
            waiting = [change for change in run.changes if change[0] > reset]
        now = present
        for place in range(done, at + 1):
            while waiting and waiting[0][0] <= place:
                schedule.change(waiting.pop(0)[1], settled * T)
            tick = int(states["tick"][place]) - first
            if not finite[place]:
                continue
            now = schedule.at(tick * T) if tick > settled else present
            settled = tick + 1
            present = schedule.at(settled * T) if schedule.moving else now
        done = at + 1
        numbers.append(now)
        moved.append(bool((now != present).any()))
    return np.array(numbers), np.array(moved, bool)
