"""What every task gives to a controller."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Annotated, Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from hoap3.protocol.config.changeable import CHANGEABLE, UNIT_WEIGHT
from hoap3.protocol.config.settings import Settings
from hoap3.protocol.messages import FloatArray
from hoap3.remote_controller.model.kinematics import Kinematics
from hoap3.remote_controller.tasks import status
from hoap3.remote_controller.tasks.accuracy import ErrorUnit, TaskError, norm_error
from hoap3.remote_controller.tasks.lyapunov import BuildContext, Level, LyapunovFunction


class Task(ABC):
    """An error e(q, t) that shall vanish, with its Jacobian J = ∂e/∂q.

    Attributes:
        error: e, (m,).
        jacobian: J, (m, n), in wire order.
        target: what is aimed at, (m,), and
        target_rate: its velocity, (m,).
        status: one of `tasks.status`.
    """

    class Parameters(Settings):
        """Settings that every task has."""

        weights: Annotated[tuple[float, ...], UNIT_WEIGHT] = Field(
            (),
            description="W of V = ½ eᵀWe: one number, or one for each component of e; empty: 1",
            json_schema_extra=CHANGEABLE,
        )

    levels: ClassVar[tuple[Level, ...]] = LyapunovFunction.levels
    """Where it has meaning."""
    unit: ClassVar[ErrorUnit] = ""
    tolerance: float | None = None
    """Of the error, as `LyapunovFunction` has them."""

    def __init__(self, dimension: int, joints: int) -> None:
        self.error = np.zeros(dimension)
        self.jacobian = np.zeros((dimension, joints))
        self.target = np.zeros(dimension)
        self.target_rate = np.zeros(dimension)
        self.status = status.OK

    @classmethod
    @abstractmethod
    def configured(cls, context: BuildContext, parameters: Any) -> LyapunovFunction:
        """V of this task as its `Parameters` have it, for the robot at `context`."""

    @abstractmethod
    def update(self, kinematics: Kinematics) -> None:
        """Recompute error and Jacobian; `kinematics` is up to date."""

    def apply(self, parameters: Any) -> None:  # noqa: B027 - some have nothing else
        """Read the parameters that may change; `TaskFunction` reads the weights."""

    @abstractmethod
    def read(self, kinematics: Kinematics, out: FloatArray) -> None:
        """Write the quantity that is aimed at the target, (m,), into `out`."""

    def accuracy(self, asked: NDArray[np.bool_]) -> list[TaskError]:
        """Size of the last error with its tolerance.

        Args:
            asked: components of e whose weight is not 0, (m,).
        """
        return norm_error(self.error[asked], self.unit, self.tolerance)

    def explicit_rate(self, out: FloatArray) -> None:
        """Write ∂e/∂t, (m,), which the target's motion makes, for the last `update`.

        It is −`target_rate`, unless a subclass knows better.
        """
        np.negative(self.target_rate, out=out)
