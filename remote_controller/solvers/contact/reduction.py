"""What is left to choose of a robot that is free to move and stands on rigid soles.

With v = (base, joints) the n + 6 velocities, w the wrenches of s soles, and the rows u of the base,
on which no motor acts,

    J_c v̇ = a_c,     M_u v̇ + h_u = J_{c,u}ᵀ w,     τ = M_a v̇ + h_a − J_{c,a}ᵀ w.

The first two are 6s + 6 equations of n + 6 + 6s numbers: n are free, however many soles there are.
An orthonormal basis Z of the null space has them as y:

    v̇ = v̇₀ + Z_v y,     w = w₀ + Z_w y,     τ = τ₀ + T y,

with y = 0 the smallest (v̇, w) there is. Tasks, limits and cones are rows of y, and solvers need not
know of base and soles.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

BASE = 6
DEPENDENT = 1e-7  # of the largest pivot: soles that tell the robot the same twice


class ContactReduction:
    """The free variables y, (n,), of one robot.

    Args:
        n: number of joints.
        units: of the wrenches, (6s,), such as [N] and [N m]: w/units counts beside v̇ [rad/s²].

    Attributes:
        motion_start, motion: v̇₀ (n + 6,) and Z_v (n + 6, n).
        wrench_start, wrench: w₀ (6s,) and Z_w (6s, n).
        torque_start, torque: τ₀ (n,) and T (n, n).
    """

    def __init__(self, n: int, units: Array) -> None:
        width, soles = n + BASE, units.size
        self.n, self._units = n, np.array(units)
        self._equations = np.zeros((soles + BASE, width + soles))
        self._sides = np.zeros(soles + BASE)
        self.motion_start, self.motion = np.zeros(width), np.zeros((width, n))
        self.wrench_start, self.wrench = np.zeros(soles), np.zeros((soles, n))
        self.torque_start, self.torque = np.zeros(n), np.zeros((n, n))

    def update(self, mass: Array, bias: Array, soles: Array, wanted: Array) -> bool:
        """Take a State.

        Args:
            mass, bias: M (n + 6, n + 6) and h (n + 6,), the rows of the base first.
            soles: J_c, (6s, n + 6).
            wanted: a_c, what J_c v̇ shall be, (6s,).

        Returns:
            Whether the equations are independent; all else is as it was if not.
        """
        E, e, c = self._equations, self._sides, wanted.size
        width = mass.shape[0]
        whole = 1.0 / np.abs(mass[:BASE, :BASE]).max()
        E[:c, :width] = soles
        np.multiply(mass[:BASE], whole, out=E[c:, :width])
        np.multiply(soles[:, :BASE].T, -whole * self._units, out=E[c:, width:])
        e[:c] = wanted
        np.multiply(bias[:BASE], -whole, out=e[c:])
        Q, R = np.linalg.qr(E.T, mode="complete")
        count = c + BASE
        pivots = np.abs(R[:count].diagonal())
        if not pivots.min() > DEPENDENT * pivots.max():
            return False
        start = Q[:, :count] @ np.linalg.solve(R[:count].T, e)
        Z = Q[:, count:]
        self.motion_start[:], self.motion[:] = start[:width], Z[:width]
        np.multiply(start[width:], self._units, out=self.wrench_start)
        np.multiply(Z[width:], self._units[:, None], out=self.wrench)
        pushed = soles[:, BASE:].T
        np.matmul(mass[BASE:], self.motion, out=self.torque)
        self.torque -= pushed @ self.wrench
        self.torque_start[:] = mass[BASE:] @ self.motion_start + bias[BASE:]
        self.torque_start -= pushed @ self.wrench_start
        return True
