"""Rigid-body dynamics of a described robot, by Pinocchio, in the joint order of the wire."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.description import RobotDescription
from hoap3.protocol.errors import DescriptionError
from hoap3.protocol.messages import FloatArray
from hoap3.protocol.robot.pinocchio_model import build_model

SINGULAR = 1e-12  # least eigenvalue of M, scaled to 1 on its diagonal


class Dynamics:
    """M(q)·ddq + h(q, dq) = τ for a robot whose root link stands still.

    All arrays are (n,) in wire order, contiguous float64; those called `out` are written. Read
    rad, rad/s, rad/s², N m, or for prismatic joints m, m/s, m/s², N. Armatures of the rotors are
    part of M. Friction is no part of h, nor is gravity where the description has it `none`.

    Args:
        description: of the robot.

    Attributes:
        damping: viscous friction of the URDF [N m s/rad].
        friction: Coulomb friction of the URDF [N m].
        inertia, joint_jacobian: see `place`.

    Raises:
        DescriptionError: Pinocchio cannot build the model.
    """

    def __init__(self, description: RobotDescription) -> None:
        import pinocchio

        self.robot = build_model(description)
        self.n = description.n
        self._model, self._data, self._order = self.robot.model, self.robot.data, self.robot.order
        self._aba, self._rnea, self._crba = pinocchio.aba, pinocchio.rnea, pinocchio.crba
        self._world = pinocchio.Convention.WORLD
        self._gravity_torque = pinocchio.computeGeneralizedGravity
        if description.gravity == "none":
            self._model.gravity.setZero()
        self._damped = pinocchio.Model(self._model)  # `forward_damped` changes its armature
        self._added = self._damped.armature
        self._armature = np.array(self._model.armature)[self._order]
        self.damping = np.array(self._model.damping)[self._order]
        self.friction = np.array(self._model.friction)[self._order]
        self._q, self._v, self._x = np.zeros(self.n), np.zeros(self.n), np.zeros(self.n)
        self.inertia = self._data.M.reshape(self.n, self.n)
        self.joint_jacobian = self._data.J.reshape(6, self.n)

    def mass(self, q: FloatArray) -> FloatArray:
        """M(q), a new (n, n)."""
        self._q[self._order] = q
        upper = np.triu(self._crba(self._model, self._data, self._q))
        return np.asarray((upper + np.triu(upper, 1).T)[np.ix_(self._order, self._order)])

    def check_forward(self, q: FloatArray) -> None:
        """Refuse a robot of which torques do not say how it moves.

        Args:
            q: a posture, (n,).

        Raises:
            DescriptionError: a joint moves nothing that weighs.
        """
        names, mass = self.robot.description.joint_names, self.mass(q)
        scale = 1.0 / np.sqrt(np.where(mass.diagonal() > 0.0, mass.diagonal(), 1.0))
        least, directions = np.linalg.eigh(scale[:, None] * mass * scale)
        if not least[0] > SINGULAR:
            joint = names[int(np.argmax(np.abs(directions[:, 0])))]
            raise DescriptionError(
                f"joint {joint!r}: under torques it moves nothing that weighs. Give its link an "
                "<inertial>, or the joint an armature."
            )

    def forward(self, q: FloatArray, dq: FloatArray, tau: FloatArray, out: FloatArray) -> None:
        """Accelerations that torques `tau` give."""
        order = self._order
        self._q[order], self._v[order], self._x[order] = q, dq, tau
        np.take(self._aba(self._model, self._data, self._q, self._v, self._x), order, out=out)

    def forward_damped(
        self, q: FloatArray, dq: FloatArray, tau: FloatArray, added: FloatArray, out: FloatArray
    ) -> None:
        """Accelerations that torques `tau` give where M has `added`, (n,) ≥ 0, on its diagonal."""
        order = self._order
        self._q[order], self._v[order], self._x[order] = q, dq, tau
        self._added[order] = self._armature + added
        np.take(self._aba(self._damped, self._data, self._q, self._v, self._x), order, out=out)

    def inverse(self, q: FloatArray, dq: FloatArray, ddq: FloatArray, out: FloatArray) -> None:
        """Torques that accelerations `ddq` need."""
        order = self._order
        self._q[order], self._v[order], self._x[order] = q, dq, ddq
        np.take(self._rnea(self._model, self._data, self._q, self._v, self._x), order, out=out)

    def gravity(self, q: FloatArray, out: FloatArray) -> None:
        """Torques that hold the robot at rest against gravity."""
        self._q[self._order] = q
        np.take(self._gravity_torque(self._model, self._data, self._q), self._order, out=out)

    def place(self, q: FloatArray, added: FloatArray) -> None:
        """Update three views of what Pinocchio has, in its own order of joints.

        `inertia`, (n, n), the upper triangle of M with `added`, (n,) ≥ 0, on its diagonal;
        `joint_jacobian`, (6, n), v and ω of what each joint moves, at the root's origin, in its
        axes; and every `placement`.
        """
        self._q[self._order] = q
        self._added[self._order] = self._armature + added
        self._crba(self._damped, self._data, self._q, self._world)

    def placement(self, joint: int) -> tuple[FloatArray, FloatArray]:
        """Where a joint is in the root: views of its rotation (3, 3) and its origin (3,) [m]."""
        found = self._data.oMi[joint]
        return found.rotation, found.translation

    def carrier(self, frame: str) -> tuple[int, FloatArray]:
        """Pinocchio's number of the joint that carries a frame, 0 for the root.

        Returns:
            That, and the frame's rotation and origin [m] seen from the joint, (3, 4).

        Raises:
            FrameNotFoundError: the robot has no such frame.
        """
        found = self._model.frames[self.robot.frame_id(frame)]
        placed = np.column_stack([found.placement.rotation, found.placement.translation])
        return int(found.parentJoint), np.ascontiguousarray(placed)

    def movers(self, frame: str) -> NDArray[np.bool_]:
        """Which joints of the wire move a frame, (n,).

        Raises:
            FrameNotFoundError: the robot has no such frame.
        """
        moved = np.zeros(self.n, np.bool_)
        for joint in self._model.supports[self.carrier(frame)[0]]:
            if joint > 0:
                moved[self._model.joints[joint].idx_v] = True
        return moved[self._order]
