"""Tasks whose error cannot fall: stationary ones, and those that bounds or constraints block."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from hoap3.protocol.messages import FloatArray
from hoap3.protocol.robot.description import RobotDescription
from hoap3.remote_controller.controllers.certificate import BLOCKED, STATIONARY
from hoap3.remote_controller.tasks.accuracy import TaskError
from hoap3.remote_controller.tasks.registry import FollowedTask

LASTING_S = 0.1  # for which a task makes no progress before it counts as blocked


class Progress:
    """Finds which tasks are stationary or blocked, as conditions of a controller.

    Stationary: |Jᵀe| ≤ 1e-6·|J|·|e| with an error above its tolerance, as where an arm is stretched
    and its target lies further in. One condition for each direction in which e may be largest.

    Blocked: for 0.1 s V = ½|e|² of a task with an error above its tolerance has fallen by less than
    0.1 % a second, it is not stationary, and joints are at bounds that its gradient points beyond,
    or constraints at their rows. One condition for each joint and constraint. A task of lower
    priority is never blocked: the tasks above it may be what keeps it.

    Args:
        robot: its description.
        before: conditions that the controller has already.
        tasks: of the controller.
        bounds: of what it decides on, (n,) each, rewritten in place.
        constraints: their labels.
        ends: positions that the robot does not go beyond, (2, n); None where bounds keep them.

    Attributes:
        names: of all conditions, `before` included.
        bounds: as given.
        stationary: bits of the conditions that a task is stationary.
    """

    def __init__(
        self,
        robot: RobotDescription,
        before: Sequence[str],
        tasks: Sequence[FollowedTask],
        bounds: tuple[FloatArray, FloatArray],
        constraints: Sequence[str] = (),
        ends: FloatArray | None = None,
    ) -> None:
        from hoap3.remote_controller.controllers import progress_kernels as kernels

        self._kernels, self._tasks, self.bounds = kernels, tasks, bounds
        spans = [(task.rows.start, task.rows.stop) for task in tasks]
        self._spans = np.array(spans, np.int64).reshape(-1, 2)
        self._flat, self._stuck = np.zeros((2, len(tasks)), np.bool_)
        self._held = np.zeros((len(tasks), bounds[0].size), np.bool_)
        self._speed, self._nowhere = np.zeros((2, bounds[0].size))
        unlimited = np.full(self._nowhere.size, np.inf)
        self._ends = np.array([-unlimited, unlimited]) if ends is None else ends
        directions = [f"{STATIONARY}{t.name}, {each}" for t in tasks for each in t.directions]
        blocked = [*(f"bounds of {name}" for name in robot.joint_names), *constraints]
        self.names = (*before, *directions, *(BLOCKED + name for name in blocked))
        self._first, self._blocked = len(before), len(before) + len(directions)
        self._of_constraints = self._blocked + robot.n
        self.stationary = (1 << self._blocked) - (1 << self._first)
        self._T, self._patience = robot.period_s, math.ceil(LASTING_S / robot.period_s)
        self._reasons: dict[str, str] = {}
        self._since: dict[int, int] = {}  # ticks from which on tasks have made no progress

    def reset(self) -> None:
        """Forget for how long tasks have made no progress."""
        self._since = {}
        self._reasons = {}

    def find(
        self,
        tick: int,
        errors: tuple[FloatArray, FloatArray, float],
        velocity: FloatArray,
        acceleration: FloatArray | None = None,
        reference: FloatArray | None = None,
        rows: int = 0,
    ) -> int:
        """Return the conditions that hold, as bits.

        Args:
            tick: of the State.
            errors: of all tasks, (m,), their Jacobian, and the sign of e in them.
            velocity, acceleration: the answer, (n,); the latter of what decides on it.
            reference: of the robot, (n,), where `ends` were given.
            rows: constraints at whose rows the answer is, by bit.
        """
        decided = velocity
        if acceleration is not None:
            np.multiply(acceleration, self._T, out=self._speed)
            decided, velocity = acceleration, np.add(self._speed, velocity, out=self._speed)
        stacked, jacobian, sign = errors
        found = self._kernels.find_progress(
            stacked,
            jacobian,
            self._spans,
            sign,
            velocity,
            decided,
            *self.bounds,
            self._nowhere if reference is None else reference,
            self._ends,
            self._T,
            self._flat,
            self._stuck,
            self._held,
        )
        self._reasons.clear()
        present = self._stationary_tasks(stacked) if found & self._kernels.FLAT else 0
        is_held = found & self._kernels.HELD or (rows and found & self._kernels.STUCK)
        stuck = self._stuck_tasks(rows) if is_held else []
        if not stuck:
            self._since.clear()
            return present
        self._since = {task: self._since.get(task, tick) for task in stuck}
        lasting = [task for task, since in self._since.items() if tick - since >= self._patience]
        return present | self._blocked_tasks(lasting, rows) if lasting else present

    def _stationary_tasks(self, errors: FloatArray) -> int:
        present, bit = 0, self._first
        for task, flat in zip(self._tasks, self._flat, strict=True):
            if task.directions and flat and not is_within(task.accuracy()):
                row = int(np.abs(errors[task.rows]).argmax())
                present |= 1 << (bit + row)
                self._reasons[task.name] = STATIONARY + task.directions[row]
            bit += len(task.directions)
        return present

    def _stuck_tasks(self, rows: int) -> list[int]:
        return [
            i
            for i, task in enumerate(self._tasks)
            if self._stuck[i]
            and (rows or self._held[i].any())
            and task.judged()
            and not is_within(task.accuracy())
        ]

    def _blocked_tasks(self, stuck: list[int], rows: int) -> int:
        present = rows << self._of_constraints
        for joint in np.flatnonzero(self._held[stuck].any(axis=0)).tolist():
            present |= 1 << (self._blocked + joint)
        held = [name for bit, name in enumerate(self.names) if present >> bit & 1]
        what = BLOCKED + ", ".join(name.removeprefix(BLOCKED) for name in held)
        self._reasons |= {self._tasks[i].name: what for i in stuck}
        return present

    def reason_of(self, error: TaskError, task: str) -> str:
        """Return why an error of a task does not fall, "" where it is within or that is unknown."""
        return error.reason or ("" if error.within else self._reasons.get(task, ""))


def is_within(errors: Sequence[TaskError]) -> bool:
    """Return whether all errors are within their tolerances; without any, nothing shows it."""
    return bool(errors) and all(error.within for error in errors)
