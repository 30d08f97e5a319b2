"""The tasks of a controller over all its cycles: errors, Jacobians, and where u leads."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hoap3.remote_controller.problems.oracles.robot_oracle import Robot
from hoap3.remote_controller.problems.oracles.tasks.config_oracle import default_entry, task_of
from hoap3.remote_controller.problems.oracles.tasks.task_oracle import AnyTask
from hoap3.remote_controller.problems.velocity import PLACE
from hoap3.tools.logs.disk_rows import RowsAt
from hoap3.tools.verify.controller_log import ControllerRun

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Cycles:
    """All tasks under each other, m rows, for each of N answers.

    Attributes:
        e: errors, (N, m).
        J: ∂e/∂q, (N, m, n).
        rate: ∂e/∂t, (N, m).
        ahead: e a period later where u leads, (N, m).
    """

    e: Array
    J: Array
    rate: Array
    ahead: Array


@dataclass(frozen=True)
class Tasks:
    """The tasks of a config.

    Attributes:
        robot: its kinematics.
        labels: their names.
        entries: as the config has them.
        tasks: what is to vanish.
    """

    robot: Robot
    labels: list[str]
    entries: list[Mapping[str, Any]]
    tasks: list[AnyTask]

    @classmethod
    def of(cls, run: ControllerRun, given: Sequence[Mapping[str, Any]] | None) -> Tasks:
        """Those of `parameters.tasks`; without any, the robot's default task.

        Raises:
            UnverifiableError: one that cannot be recomputed.
        """
        description = run.description
        robot = Robot(description, run.messages)
        entries = [default_entry(description)] if given is None else list(given)
        labels = [str(entry.get("name") or entry.get("task")) for entry in entries]
        return cls(robot, labels, entries, [task_of(entry, robot) for entry in entries])

    @property
    def sizes(self) -> list[int]:
        """How many rows each has."""
        return [task.size for task in self.tasks]

    @property
    def places(self) -> Array:
        """How exactly each row of e is known, (m,) [its unit]."""
        return np.concatenate([PLACE * task.rounding * task.roots for task in self.tasks])

    @property
    def rows(self) -> list[slice]:
        """Where the rows of each are."""
        return [slice(*ends) for ends in pairwise(np.cumsum([0, *self.sizes]).tolist())]

    def over(self, run: ControllerRun, base: Array, u: Array) -> Cycles:
        """All cycles of a run.

        Args:
            run: each answer of which is to a State that is finite.
            base: (S, n) joint positions of each State that kinematics are computed from.
            u: (N, n) velocity of each answer.
        """
        T, starts, begun = run.description.period_s, _starts(run), -1
        N, m, n = len(run.answers), sum(self.sizes), run.description.n
        e, rate, ahead = np.zeros((3, N, m))
        found = Cycles(e, np.zeros((N, m, n)), rate, ahead)
        for k, place in enumerate(run.answered.tolist()):
            if starts[k] != begun:
                begun = starts[k]
                self._begin(base[begun], float(run.states["tick"][begun]) * T)
            now = float(run.states["tick"][place]) * T
            self._watch(run.states["q"][place], now)
            self._look(found, k, base[place], now)
            self.robot.place_only(base[place] + u[k] * T)
            self._errors(now + T, found.ahead[k])
        return found

    def _begin(self, q: Array, time_s: float) -> None:
        self.robot.place(q)
        for task in self.tasks:
            task.begin(self.robot, time_s)

    def _watch(self, q: Array, time_s: float) -> None:
        watched = [task for task in self.tasks if task.watched]
        if watched:
            self.robot.place(q)
        for task in watched:
            task.watch(self.robot, time_s)

    def _look(self, found: Cycles, k: int, q: Array, time_s: float) -> None:
        self.robot.place(q)
        for task, rows in zip(self.tasks, self.rows, strict=True):
            found.e[k, rows], found.J[k, rows], found.rate[k, rows] = task.at(self.robot, time_s)

    def _errors(self, time_s: float, out: Array) -> None:
        for task, rows in zip(self.tasks, self.rows, strict=True):
            out[rows] = task.error_at(self.robot, time_s)


def _starts(run: ControllerRun) -> list[int]:
    """For each answer the place of the State at which its tasks began: finite, after a reset."""
    states = run.states
    finite = np.flatnonzero(RowsAt.of(states).finite("q", "reference"))
    resets = np.array([0, *run.resets])
    begun = resets[np.searchsorted(resets, run.answered, "right") - 1]
    found: list[int] = finite[np.searchsorted(finite, begun)].tolist()
    return found
