"""A task that is given as an error: the shortest way to one of your own."""

from __future__ import annotations

from abc import abstractmethod

import numpy as np

from hoap3.remote_controller.model.kinematics import Kinematics
from hoap3.remote_controller.tasks.lyapunov import LyapunovFunction


class ErrorTask(LyapunovFunction):
    """An error e(q, t), (m,), that shall vanish; V = ½|e|², ∇V = Jᵀe and ∂V/∂t = eᵀ∂e/∂t follow.

    A subclass writes `error`, `jacobian` = ∂e/∂q and `error_rate` = ∂e/∂t in `evaluate`, in place.
    They are 0 at first: what is constant may be written once, and an error that does not depend on
    time leaves `error_rate` as it is. Every controller of tasks serves it.

    Args:
        joints: n.
        dimension: m > 0.
    """

    def __init__(self, joints: int, dimension: int) -> None:
        super().__init__(joints, dimension)

    @abstractmethod
    def evaluate(self, kinematics: Kinematics, time_s: float) -> None:
        """Write e, J and ∂e/∂t.

        Args:
            kinematics: up to date.
            time_s: tick of the robot × its period [s].
        """

    def update(self, kinematics: Kinematics, time_s: float) -> None:
        """Recompute the error, and V from it."""
        self.evaluate(kinematics, time_s)
        self.value = 0.5 * float(self.error @ self.error)
        self.rate = float(self.error @ self.error_rate)
        np.matmul(self.error, self.jacobian, out=self.gradient)
