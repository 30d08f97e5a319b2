"""Joints that follow others, for a model that has a coordinate for each of them.

With q of the n joints of the wire, all m = n + f moving joints are at q_m = G·q + g₀: the joints of
the wire as they are, and behind them each mimic joint at multiplier · its mimicked joint + offset.
So, with the J, M, h and τ that the model has of all m,

    dq_m = G·dq,    J = J_m·G,    M = Gᵀ·M_m·G,    h = Gᵀ·h_m,    τ = Gᵀ·τ_m

G is constant, so J̇·dq = J̇_m·(G·dq), and h has no term of its own.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.messages import FloatArray
from hoap3.protocol.robot.description import RobotDescription


class MimicJoints:
    """G and g₀ of a robot; "full" arrays have the joints of the wire first, then the mimic joints.

    Args:
        description: of a robot with mimic joints.

    Attributes:
        names: of the mimic joints, (f,).
        matrix: G, (n + f, n), read-only.
        offsets: g₀, (n + f,) [rad or m], read-only.
        mimicked, multipliers: (n + f,) the joint of the wire that each moves with, and how far for
            each
            unit of that one: the only figure in its row of G.
        q, v: (n + f,) what `positions` and `velocities` wrote last.
    """

    def __init__(self, description: RobotDescription) -> None:
        from hoap3.protocol.robot import mimic_joints_kernels as kernels

        self._inertia, self._accelerations = kernels.tied_inertia, kernels.accelerations
        mimic_joints, places = description.structure.mimic_joints, description.joint_names
        n, m = description.n, description.n + len(mimic_joints)
        self.names = tuple(mimic_joints)
        self.matrix, self.offsets = np.eye(m, n), np.zeros(m)
        for row, mimic_joint in enumerate(mimic_joints.values(), n):
            self.matrix[row, places.index(mimic_joint.mimicked)] = mimic_joint.multiplier
            self.offsets[row] = mimic_joint.offset
        self.matrix.setflags(write=False)
        self.offsets.setflags(write=False)
        self.mimicked = np.argmax(self.matrix != 0.0, axis=1)
        self.multipliers = self.matrix[np.arange(m), self.mimicked]
        self.q, self.v = np.zeros(m), np.zeros(m)
        self._factor = np.zeros((n, n))

    def positions(self, q: FloatArray) -> FloatArray:
        """G·q + g₀ of `q`, (n,)."""
        np.matmul(self.matrix, q, out=self.q)
        self.q += self.offsets
        return self.q

    def velocities(self, dq: FloatArray) -> FloatArray:
        """G·dq of `dq`, (n,)."""
        return np.matmul(self.matrix, dq, out=self.v)

    def columns(self, full: FloatArray, out: FloatArray) -> None:
        """Write J_m·G, or Gᵀ·τ_m: `full`, (…, n + f), and `out`, (…, n)."""
        np.matmul(full, self.matrix, out=out)

    def inertia(self, full: FloatArray, order: NDArray[np.int64], out: FloatArray) -> None:
        """Write Gᵀ·M_m·G, (n, n), of the upper triangle of M_m in an order, `RobotModel.order`."""
        self._inertia(full, order, self.mimicked, self.multipliers, out)

    def accelerations(
        self, mass: FloatArray, added: FloatArray, torque: FloatArray, out: FloatArray
    ) -> None:
        """Write (M + diag(added))⁻¹·torque, all (n,), of an M that is an inertia."""
        self._accelerations(mass, added, torque, self._factor, out)

    def resistance(self, full: FloatArray, *, dry: bool) -> FloatArray:
        """Friction that the joints of the wire feel, (n,), of that of each moving joint, (n + f,).

        A mimic joint's speed is r times its mimicked joint's, and its torque counts r times there:
        viscous friction counts r² times, and dry friction, which the sign of the speed alone turns,
        |r|.
        """
        shares = np.abs(self.matrix) if dry else self.matrix**2
        return np.asarray(full @ shares)
