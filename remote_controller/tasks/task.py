"""What every task gives to a controller."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np

from protocol.messages import FloatArray
from remote_controller.kinematics import Kinematics


class Task(ABC):
    """An error e(q, t) that shall vanish, with its Jacobian J = ∂e/∂q.

    Attributes:
        error: e, (m,).
        jacobian: J, (m, n), in wire order.
        drift: dJ/dt · dq, (m,).
        target: what is aimed at, (m,), and
        target_rate: its velocity, (m,).
    """

    def __init__(self, dimension: int, joints: int) -> None:
        self.error = np.zeros(dimension)
        self.jacobian = np.zeros((dimension, joints))
        self.drift = np.zeros(dimension)
        self.target = np.zeros(dimension)
        self.target_rate = np.zeros(dimension)

    @abstractmethod
    def update(self, kinematics: Kinematics) -> None:
        """Recompute error and Jacobian; `kinematics` is up to date."""

    @abstractmethod
    def read(self, kinematics: Kinematics, out: FloatArray) -> None:
        """Write the quantity that is aimed at the target, (m,), into `out`."""
