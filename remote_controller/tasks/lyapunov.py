"""Lyapunov functions: what a stable-by-design controller is told to decrease (QP12, section II)."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np

from protocol.description import RobotDescription
from protocol.errors import BadProblemError
from protocol.messages import FloatArray
from protocol.settings import Settings
from remote_controller.kinematics import Kinematics
from remote_controller.tasks import status
from remote_controller.tasks.targets.target import Point, Target
from remote_controller.tasks.task import Task


@dataclass(frozen=True)
class Site:
    """What a configured task is built for, and where its settings stand.

    Attributes:
        description, kinematics: of the robot.
        file, key: where it is configured, for errors; other files are sought beside `file`.
    """

    description: RobotDescription
    kinematics: Kinematics
    file: str = "config"
    key: str = "task"

    @property
    def folder(self) -> Path:
        """Where other files that the config names are."""
        return Path(self.file).parent


class LyapunovFunction(ABC):
    """V(q, t) ≥ 0, which shall decrease to 0.

    A subclass sets `value`, `gradient` and `rate` in `update`; it may name its settings in a
    nested `Parameters` model, and is then built by `Class(description, kinematics, parameters)`.

    Args:
        joints: n.
        dimension: m, where V = ½|error|² of an error; else 0.

    Attributes:
        value: V.
        gradient: ∇V = ∂V/∂q, (n,), in wire order.
        rate: ∂V/∂t [1/s times the unit of V], so that V̇ = ∇V·u + ∂V/∂t (QP12, 18).
        error, jacobian: where V = ½|error|², that error, (m,), and ∂error/∂q, (m, n); weights
            are in them. Empty where V is no such square.
        status: one of `tasks.status`.
    """

    class Parameters(Settings):
        """Settings of this function; none here."""

    def __init__(self, joints: int, dimension: int = 0) -> None:
        self.value, self.rate = 0.0, 0.0
        self.gradient = np.zeros(joints)
        self.error = np.zeros(dimension)
        self.jacobian = np.zeros((dimension, joints))
        self.status = status.OK

    @classmethod
    def configured(cls, site: Site, parameters: Any) -> Self:
        """One for the robot at `site`; whoever is built otherwise says so here."""
        build: Any = cls
        built: Self = build(site.description, site.kinematics, parameters)
        return built

    def reset(self, kinematics: Kinematics, time_s: float) -> None:  # noqa: B027 - may be empty
        """Begin at the present configuration and time, so that nothing jumps.

        Args:
            kinematics: up to date.
            time_s: tick of the robot × its period [s].
        """

    @abstractmethod
    def update(self, kinematics: Kinematics, time_s: float) -> None:
        """Recompute V, ∇V and ∂V/∂t.

        Args:
            kinematics: up to date.
            time_s: tick of the robot × its period [s].
        """


class TaskFunction(LyapunovFunction):
    """V = ½ eᵀWe of a task that follows a target.

    Args:
        task: gives e and its Jacobian.
        target: what the task aims at; by default the task's present `target`, which stays.
        weights: (m,) diagonal of W, or one number for all of it; none means 1.

    Raises:
        BadProblemError: as many weights as there are components of e are expected, none of them
            negative and not all of them 0.
    """

    def __init__(
        self, task: Task, target: Target | None = None, weights: Sequence[float] = ()
    ) -> None:
        from remote_controller.tasks.lyapunov_kernels import quadratic  # noqa: PLC0415 - compiles

        m, n = task.jacobian.shape
        super().__init__(n, m)
        self._quadratic = quadratic
        self.task = task
        self.target = target or Point(task.target.copy())
        self._roots = np.sqrt(_checked(weights, m))
        self._present = np.zeros(self.target.dimension)
        self._error_rate = np.zeros(m)

    def reset(self, kinematics: Kinematics, time_s: float) -> None:
        """Have the target start from where the robot is."""
        task = self.task
        self.target.start(None, time_s)  # what is aimed at in the end decides how it is read
        self.target.at(time_s, task.target, task.target_rate)
        task.read(kinematics, self._present)
        self.target.start(self._present, time_s)

    def update(self, kinematics: Kinematics, time_s: float) -> None:
        """Recompute V, ∇V and ∂V/∂t for the target at `time_s`."""
        task = self.task
        self.target.at(time_s, task.target, task.target_rate)
        task.update(kinematics)
        task.explicit_rate(self._error_rate)
        self.value, self.rate = self._quadratic(
            task.error,
            task.jacobian,
            self._error_rate,
            self._roots,
            self.error,
            self.jacobian,
            self.gradient,
        )
        self.status = task.status


def _checked(weights: Sequence[float], dimension: int) -> FloatArray:
    given = np.array(weights or (1.0,), float)
    if given.size not in {1, dimension} or not (given >= 0.0).all() or not given.any():
        raise BadProblemError(
            f"weights {list(weights)}: expected 1 or {dimension} numbers ≥ 0, not all of them 0"
        )
    return np.broadcast_to(given, (dimension,)).copy()
