"""Rigid-body dynamics of a described robot, by Pinocchio, in the joint order of the wire."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.errors import DescriptionError
from hoap3.protocol.messages import FloatArray
from hoap3.protocol.robot.description import RobotDescription
from hoap3.protocol.robot.pinocchio_model import RobotModel, build_model

SINGULAR = 1e-12  # least eigenvalue of M, scaled to 1 on its diagonal


class Dynamics:
    """M(q)·ddq + h(q, dq) = τ for a robot whose root link stands still.

    All arrays are (n,) in wire order, contiguous float64; those called `out` are written. Read
    rad, rad/s, rad/s², N m, or for prismatic joints m, m/s, m/s², N. Armatures of the rotors are
    part of M. Friction is no part of h, nor is gravity where the description has it `none`.

    Of a robot with mimic joints (`MimicJoints`) M is Gᵀ·M_m·G and h is Gᵀ·h_m, and accelerations
    come from the two; of others, faster, from the articulated-body algorithm.

    Args:
        description: of the robot.
        robot: its model, if there is one already; gravity is as it is there.

    Attributes:
        damping: viscous friction of the URDF [N m s/rad], that of mimic joints included.
        friction: Coulomb friction of the URDF [N m], likewise.
        inertia, joint_jacobian: see `place`.
        inertia_order: (n,) place of each joint of the wire in `inertia`.

    Raises:
        DescriptionError: Pinocchio cannot build the model.
    """

    def __init__(self, description: RobotDescription, robot: RobotModel | None = None) -> None:
        import pinocchio

        self.robot = build_model(description) if robot is None else robot
        self.n, self.mimic_joints = description.n, self.robot.mimic_joints
        self._model, self._data, self._order = self.robot.model, self.robot.data, self.robot.order
        self._aba, self._rnea, self._crba = pinocchio.aba, pinocchio.rnea, pinocchio.crba
        self._world, self._nle = pinocchio.Convention.WORLD, pinocchio.nonLinearEffects
        self._gravity_torque = pinocchio.computeGeneralizedGravity
        if robot is None and description.gravity == "none":
            self._model.gravity.setZero()
        self._damped = pinocchio.Model(self._model)  # `forward` changes its armature
        self._added = self._damped.armature
        self._wire = self.robot.wire  # mimic joints have no armature of their own
        self._armature = np.array(self._model.armature)[self._wire]
        self.damping = np.array(self._model.damping)[self._order]
        self.friction = np.array(self._model.friction)[self._order]
        if self.mimic_joints:
            self.damping = self.mimic_joints.resistance(self.damping, dry=False)
            self.friction = self.mimic_joints.resistance(self.friction, dry=True)
        m = len(self._order)
        self._q, self._v, self._x = np.zeros(m), np.zeros(m), np.zeros(m)
        self._none, self._bias = np.zeros((2, self.n))
        self._full_inertia = self._data.M.reshape(m, m)
        self._places = np.array(self._order, np.int64)
        self.inertia, self.inertia_order = self._full_inertia, self._places
        if self.mimic_joints:
            self.inertia, self._mass = np.zeros((2, self.n, self.n))
            self.inertia_order = np.arange(self.n)
        self.joint_jacobian = self._data.J.reshape(6, m)

    def mass(self, q: FloatArray) -> FloatArray:
        """M(q), a new (n, n)."""
        self._take(q)
        self._crba(self._model, self._data, self._q)
        if self.mimic_joints is not None:
            mass = np.zeros((self.n, self.n))
            self.mimic_joints.inertia(self._full_inertia, self._places, mass)
            return mass
        upper = np.triu(self._full_inertia)
        return np.asarray((upper + np.triu(upper, 1).T)[np.ix_(self._order, self._order)])

    def inertia_diagonal(self, q: FloatArray, out: FloatArray) -> None:
        """Write the diagonal of M(q), (n,)."""
        self._take(q)
        self._crba(self._model, self._data, self._q)
        if self.mimic_joints is None:
            np.take(self._full_inertia.diagonal(), self._order, out=out)
        else:
            self.mimic_joints.inertia(self._full_inertia, self._places, self._mass)
            np.copyto(out, self._mass.diagonal())

    def _take(self, q: FloatArray) -> None:
        """Take positions into Pinocchio's order."""
        self._q[self._order] = q if self.mimic_joints is None else self.mimic_joints.positions(q)

    def _move(self, dq: FloatArray, ddq: FloatArray) -> None:
        """Take velocities and accelerations likewise."""
        order, mimic_joints = self._order, self.mimic_joints
        self._v[order] = dq if mimic_joints is None else mimic_joints.velocities(dq)
        self._x[order] = ddq if mimic_joints is None else mimic_joints.velocities(ddq)

    def _give(self, torques: FloatArray, out: FloatArray) -> None:
        """Write torques of Pinocchio's order in the wire's."""
        if self.mimic_joints is None:
            np.take(torques, self._order, out=out)
        else:
            self.mimic_joints.columns(torques[self._order], out)

    def check_forward(self, q: FloatArray) -> None:
        """Refuse a robot of which torques do not say how it moves.

        Args:
            q: a posture, (n,).

        Raises:
            DescriptionError: a joint moves nothing that weighs, or more than a number holds.
        """
        names, mass = self.robot.description.joint_names, self.mass(q)
        endless = ~np.isfinite(mass).all(axis=1)
        if endless.any():
            raise DescriptionError(
                f"joint {names[int(np.argmax(endless))]!r}: what it moves is too heavy to reckon "
                "with. Correct the masses, inertias and origins of the links behind it."
            )
        scale = 1.0 / np.sqrt(np.where(mass.diagonal() > 0.0, mass.diagonal(), 1.0))
        least, directions = np.linalg.eigh(scale[:, None] * mass * scale)
        if not least[0] > SINGULAR:
            joint = names[int(np.argmax(np.abs(directions[:, 0])))]
            raise DescriptionError(
                f"joint {joint!r}: under torques it moves nothing that weighs. Give its link an "
                "<inertial>, or the joint an armature."
            )

    def forward(
        self, q: FloatArray, dq: FloatArray, tau: FloatArray, added: FloatArray, out: FloatArray
    ) -> None:
        """Accelerations that torques `tau` give where M has `added`, (n,) ≥ 0, on its diagonal."""
        self._take(q)
        if self.mimic_joints is not None:
            self._crba(self._model, self._data, self._q)
            self.mimic_joints.inertia(self._full_inertia, self._places, self._mass)
            self.bias(q, dq, self._bias)
            np.subtract(tau, self._bias, out=self._bias)
            self.mimic_joints.accelerations(self._mass, added, self._bias, out)
            return
        self._move(dq, tau)
        self._added[self._wire] = self._armature + added
        ddq = self._aba(self._damped, self._data, self._q, self._v, self._x)
        np.take(ddq, self._order, out=out)

    def inverse(self, q: FloatArray, dq: FloatArray, ddq: FloatArray, out: FloatArray) -> None:
        """Torques that accelerations `ddq` need."""
        self._take(q)
        self._move(dq, ddq)
        self._give(self._rnea(self._model, self._data, self._q, self._v, self._x), out)

    def bias(self, q: FloatArray, dq: FloatArray, out: FloatArray) -> None:
        """Torques h(q, dq) that no acceleration needs."""
        self._take(q)
        self._move(dq, self._none)
        self._give(self._nle(self._model, self._data, self._q, self._v), out)

    def gravity(self, q: FloatArray, out: FloatArray) -> None:
        """Torques that hold the robot at rest against gravity."""
        self._take(q)
        self._give(self._gravity_torque(self._model, self._data, self._q), out)

    def place(self, q: FloatArray, added: FloatArray) -> None:
        """Update three views of what Pinocchio has, in its own order of joints.

        `inertia`, (n, n), the upper triangle of M with `added`, (n,) ≥ 0, on its diagonal; of a
        robot with mimic joints all of it, in the order of the wire;
        `joint_jacobian`, (6, m), v and ω of what each joint moves, at the root's origin, in its
        axes; and every `placement`.
        """
        self._take(q)
        self._added[self._wire] = self._armature + added
        self._crba(self._damped, self._data, self._q, self._world)
        if self.mimic_joints is not None:
            self.mimic_joints.inertia(self._full_inertia, self._places, self.inertia)

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
        """Which joints, those of the wire and behind them the mimic joints, move a frame, (m,).

        Raises:
            FrameNotFoundError: the robot has no such frame.
        """
        return self.robot.moved_by(frame)[self._order]
