"""V = ½ eᵀWe of a task and its target."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from hoap3.protocol.errors import BadProblemError, ConfigError
from hoap3.protocol.messages import FloatArray
from hoap3.remote_controller.model.kinematics import Kinematics
from hoap3.remote_controller.references.target import Point, Target
from hoap3.remote_controller.references.trajectories.tolerances import Tolerances
from hoap3.remote_controller.tasks.accuracy import TaskError, violated
from hoap3.remote_controller.tasks.lyapunov import LyapunovFunction
from hoap3.remote_controller.tasks.task import Task


class TaskFunction(LyapunovFunction):
    """V = ½ eᵀWe of a task that follows a target.

    Args:
        task: gives e and its Jacobian.
        target: what the task aims at; by default the task's present `target`, which stays.
        weights: (m,) diagonal of W, or one number for all of it; none means 1.
        tolerances: of e without weights, where somebody asked for them.

    Raises:
        BadProblemError: as many weights as there are components of e are expected, none of them
            negative and not all of them 0.
    """

    def __init__(
        self,
        task: Task,
        target: Target | None = None,
        weights: Sequence[float] = (),
        tolerances: Tolerances | None = None,
    ) -> None:
        from hoap3.remote_controller.tasks.lyapunov_kernels import quadratic

        m, n = task.jacobian.shape
        super().__init__(n, m)
        self._quadratic = quadratic
        self.task = task
        self.target = target or Point(task.target.copy())
        self._roots = np.sqrt(_checked(weights, m))
        self._present = np.zeros(self.target.dimension)
        self._unweighted_rate = np.zeros(m)
        self._tolerances, self.watched = tolerances, tolerances is not None

    def reset(self, kinematics: Kinematics, time_s: float) -> None:
        """Have the target start from where the robot is."""
        task = self.task
        self.target.start(None, time_s)  # what is aimed at in the end decides how it is read
        self.target.at(time_s, task.target, task.target_rate)
        task.read(kinematics, self._present)
        self.target.start(self._present, time_s)
        if self._tolerances is not None:
            self._tolerances.restart()

    def watch(self, kinematics: Kinematics, tick: int, time_s: float) -> bool:
        """Compare the error with its tolerances; whether one of them is, or was, violated."""
        tolerances, task, target = self._tolerances, self.task, self.target
        if tolerances is None:
            return False
        if tolerances.violation is None and not tolerances.reached:
            target.at(time_s, task.target, task.target_rate)
            task.update(kinematics)
            if tolerances.judge(task.error, target.elapsed(time_s), tick) and tolerances.holds:
                task.read(kinematics, self._present)
                target.stay(self._present)
        return tolerances.violation is not None

    def update(self, kinematics: Kinematics, time_s: float) -> None:
        """Recompute V, ∇V and ∂V/∂t, and the error with its rate, for the target at `time_s`."""
        task = self.task
        self.target.at(time_s, task.target, task.target_rate)
        task.update(kinematics)
        task.explicit_rate(self._unweighted_rate)
        np.multiply(self._unweighted_rate, self._roots, out=self.error_rate)
        self.value, self.rate = self._quadratic(
            task.error,
            task.jacobian,
            self._unweighted_rate,
            self._roots,
            self.error,
            self.jacobian,
            self.gradient,
        )
        self.status = task.status

    def apply(self, parameters: Any) -> None:
        """Read the weights, and what the task has."""
        self._roots[:] = self._roots_of(parameters)
        self.task.apply(parameters)

    def weighted(self, jacobian: FloatArray, parameters: Any) -> FloatArray:
        """√W·∂e/∂q, (m, n), with the weights of some parameters.

        Args:
            jacobian: ∂e/∂q of the task, (m, n).
            parameters: of the task, perhaps changed ones.

        Raises:
            ConfigError: weights that make no V, with file "".
        """
        return self._roots_of(parameters)[:, None] * jacobian

    def _roots_of(self, parameters: Any) -> FloatArray:
        try:
            return np.sqrt(_checked(parameters.weights, self._roots.size))
        except BadProblemError as error:
            given, remedy = parameters.weights, "Correct them"
            raise ConfigError("", error.key, given, str(error), remedy) from error

    def accuracy(self) -> list[TaskError]:
        """Errors of the task, without weights; components of weight 0 are left out.

        Where a tolerance was violated, that alone: what is aimed at since is not what was asked.
        """
        if self._tolerances is not None and self._tolerances.violation is not None:
            return [violated(self._tolerances.violation)]
        return self.task.accuracy(self._roots > 0.0)


def _checked(weights: Sequence[float], dimension: int) -> FloatArray:
    given = np.array(weights or (1.0,), float)
    if given.size not in {1, dimension} or not (given >= 0.0).all() or not given.any():
        raise BadProblemError(
            f"weights {list(weights)}: expected 1 or {dimension} numbers ≥ 0, not all of them 0",
            "weights",
        )
    return np.broadcast_to(given, (dimension,)).copy()
