"""The equation of motion of a robot, M·q̈ + h = τ, by Pinocchio's own functions."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from hoap3.tools.verify.controllers.acceleration.model.wanted import ROUNDING
from hoap3.tools.verify.robot import Robot

Array = NDArray[np.float64]


class RigidBody:
    """M, h and what gravity takes, all in wire order.

    Args:
        robot: whose model is used; its data stay as they are.

    Attributes:
        damping: viscous friction of the URDF, (n,) [N m s/rad or N s/m].
    """

    def __init__(self, robot: Robot) -> None:
        self._model, self._order = robot.model.copy(), robot.order
        if robot.description.gravity == "none":
            self._model.gravity.setZero()
        self._adds_gravity = robot.description.gravity == "compensated"
        self._data, self.damping = self._model.createData(), self._model.damping[robot.order].copy()
        self._q, self._v = np.zeros((2, self._model.nv))

    def at(self, q: Array, dq: Array) -> tuple[Array, Array, Array]:
        """M (n, n), h (n,), and the torques that the robot itself adds to commands, (n,)."""
        model, data, order = self._model, self._data, self._order
        self._q[order], self._v[order] = q, dq
        M = np.triu(pin.crba(model, data, self._q))
        M = (M + np.triu(M, 1).T)[np.ix_(order, order)]
        h = pin.nonLinearEffects(model, data, self._q, self._v)[order].copy()
        if not self._adds_gravity:
            return M, h, np.zeros(len(q))
        return M, h, pin.computeGeneralizedGravity(model, data, self._q)[order].copy()


def rounding_of(M: Array, h: Array, dq: Array, ddq: Array) -> Array:
    """How exactly M·q̈ + h is known, (N, 1), of M (N, n, n) and the rest (N, n).

    Inertias of light links are differences of what they are about the root, so each entry of M has
    the rounding of the largest.
    """
    motion = np.abs(ddq).sum(1) + np.abs(dq).sum(1) ** 2
    found = np.abs(M).max((1, 2)) * motion + np.abs(h).max(1)
    return np.asarray(ROUNDING * found[:, None])
