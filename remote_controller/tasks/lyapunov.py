"""Lyapunov functions: what a stable-by-design controller is told to decrease (QP12, section II)."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Literal, Self

import numpy as np

from hoap3.protocol.config.settings import Settings
from hoap3.protocol.messages import FloatArray
from hoap3.protocol.robot.description import RobotDescription
from hoap3.remote_controller.model.kinematics import Kinematics
from hoap3.remote_controller.tasks import status
from hoap3.remote_controller.tasks.accuracy import ErrorUnit, TaskError, norm_error

Level = Literal["velocity", "acceleration"]
"""What a controller decides on; those of torques follow accelerations."""


@dataclass(frozen=True)
class BuildContext:
    """What a configured task is built for, and where its settings stand.

    Attributes:
        description, kinematics: of the robot.
        file, key: where it is configured, for errors; other files are sought beside `file`.
        level: what the controller commands.
    """

    description: RobotDescription
    kinematics: Kinematics
    file: str = "config"
    key: str = "task"
    level: Level = "velocity"

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
        error_rate: ∂error/∂t, (m,), what the target's motion makes; 0 where nobody sets it.
        status: one of `tasks.status`.
        watched: whether it has tolerances that `watch` compares with.
        parameters: of which it was built, where it was configured.
        tolerance: greatest |error|, or √(2V) where it has none, that counts as reached, in `unit`;
            None: that of the unit.
    """

    unit: ClassVar[ErrorUnit] = ""
    """Of the error: "m", "rad", "N", "N m", or "" for any other."""
    tolerance: float | None = None
    parameters: Any = None

    class Parameters(Settings):
        """Settings of this function; none here."""

    levels: ClassVar[tuple[Level, ...]] = ("velocity", "acceleration")
    """Where it has meaning."""

    def __init__(self, joints: int, dimension: int = 0) -> None:
        self.value, self.rate = 0.0, 0.0
        self.gradient = np.zeros(joints)
        self.error, self.error_rate = np.zeros((2, dimension))
        self.jacobian = np.zeros((dimension, joints))
        self.status = status.OK
        self.watched = False

    @property
    def followed(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """What controllers of several tasks bring to 0: e (k,), its Jacobian and ∂e/∂t.

        Arrays that every `update` rewrites; a motion along a curve has a row more than `error`.
        """
        return self.error, self.jacobian, self.error_rate

    def without_error(self) -> str | None:
        """Key of the settings of what has no error, but V alone; None where there is no such."""
        return None if len(self.followed[0]) else "task"

    @classmethod
    def configured(cls, context: BuildContext, parameters: Any) -> Self:
        """One for the robot at `context`; whoever is built otherwise says so here."""
        build: Any = cls
        built: Self = build(context.description, context.kinematics, parameters)
        return built

    def reset(self, kinematics: Kinematics, time_s: float) -> None:  # noqa: B027 - may be empty
        """Begin at the present configuration and time, so that nothing jumps.

        Args:
            kinematics: up to date.
            time_s: tick of the robot × its period [s].
        """

    def watch(self, kinematics: Kinematics, tick: int, time_s: float) -> bool:
        """Compare the errors with their tolerances; whether one of them is, or was, violated.

        Called once for each State in which the robot follows, of a `watched` task, after `reset`
        and before `update`: what follows a violation is decided here.

        Args:
            kinematics: of the robot as it was measured.
            tick, time_s: of the State; see `update`.
        """
        del kinematics, tick, time_s
        return False

    @abstractmethod
    def update(self, kinematics: Kinematics, time_s: float) -> None:
        """Recompute V, ∇V and ∂V/∂t, from posture and time alone: it has no memory of other calls.

        Controllers of accelerations also ask what is to either side of the robot, and ahead.

        Args:
            kinematics: up to date.
            time_s: tick of the robot × its period [s].
        """

    def apply(self, parameters: Any) -> None:  # noqa: B027 - most have nothing that changes
        """Read the parameters that may change: when it is built, and in a live change.

        Comes between two updates. Numbers of a class without an `apply` of its own cannot change.

        Raises:
            ConfigError: they do not fit; with file "" and the key inside the parameters.
        """

    def accuracy(self) -> list[TaskError]:
        """Errors at the last `update`, each with its tolerance: |error|, or √(2V) without one."""
        V = self.value
        size = np.array([math.sqrt(2.0 * V) if V >= 0.0 else math.nan])
        error = self.error if len(self.error) else size
        return norm_error(error, self.unit, self.tolerance)
