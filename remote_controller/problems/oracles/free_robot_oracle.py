"""A robot whose root link is free to move, by Pinocchio's free-flyer; all results in the world."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from hoap3.protocol.robot.description import RobotDescription
from hoap3.protocol.robot.pinocchio_model import one_coordinate_each
from hoap3.remote_controller.problems.oracles.robot_oracle import Robot, mimic_matrix
from hoap3.remote_controller.problems.oracles.tasks.live_oracle import Messages

Array = NDArray[np.float64]

BASE = 6
"""Coordinates of the base, before the joints."""
POSE, TWIST = 7, slice(7, 13)  # in State.base
QUATERNION = slice(3, 7)


class FreeRobot(Robot):
    """A robot at one base pose and joint position; arguments as of `Robot`.

    v, (n + 6,), is the twist of the root link in its own axes, velocity of its origin [m/s] over
    angular velocity [rad/s], and then the joints' velocities in wire order.

    Attributes:
        fixed: the robot as seen from its root link, at the same joint positions.
        base: State.base, (13,), to be written before `place`.
        v: (n + 6,), of the last `move`.
    """

    def __init__(self, description: RobotDescription, messages: Messages | None = None) -> None:
        super().__init__(description, messages)
        self.fixed = Robot(description, messages)
        self.width = BASE + description.n
        urdf = one_coordinate_each(description)
        self.model = model = pin.buildModelFromXML(urdf, pin.JointModelFreeFlyer())
        for name, inertia in zip(description.joint_names, description.armature, strict=True):
            model.armature[model.joints[model.getJointId(name)].idx_v] = inertia
        if description.gravity == "none":
            model.gravity.setZero()
        self.data = model.createData()
        joints, offset = mimic_matrix(description, model)
        self.G = np.hstack([np.eye(model.nv, BASE), joints])
        self._offset = offset[BASE:]
        self.q, self._v = pin.neutral(model), np.zeros(model.nv)
        self.base, self.v = np.zeros(13), np.zeros(self.width)
        self.base[POSE - 1] = 1.0
        self.weight = pin.computeTotalMass(model) * 9.81
        self._frames = {
            name: model.getFrameId(name, pin.FrameType.BODY) for name in description.frames
        }

    def place(self, q: Array) -> None:
        """Take joint positions, (n,) [rad or m], at the pose of `base`."""
        self.positions = np.array(q, float)
        self.q[:POSE] = self.base[:POSE]
        self.q[QUATERNION] /= np.linalg.norm(self.q[QUATERNION])
        self.q[POSE:] = self.G[BASE:, BASE:] @ self.positions + self._offset
        pin.computeJointJacobians(self.model, self.data, self.q)
        pin.updateFramePlacements(self.model, self.data)
        self.fixed.place(q)

    def move(self, dq: Array) -> None:
        """Take joint velocities, (n,) [rad/s or m/s], and the twist of `base`, after `place`."""
        turn = pin.Quaternion(self.q[QUATERNION]).matrix().T
        linear, angular = np.split(self.base[TWIST], 2)
        self.v = np.concatenate([turn @ linear, turn @ angular, dq])
        self._v = self.G @ self.v
        still = np.zeros_like(self._v)
        pin.forwardKinematics(self.model, self.data, self.q, self._v, still)
        pin.centerOfMass(self.model, self.data, self.q, self._v, still, False)
        pin.updateFramePlacements(self.model, self.data)
        self.fixed.move(dq)

    def dynamics(self) -> tuple[Array, Array]:
        """M (n + 6, n + 6) and h (n + 6,) of M·v̇ + h = (0, τ) + Σ Jᵀw, after `move`."""
        model, G, still = self.model, self.G, np.zeros_like(self._v)
        data: Any = model.createData()  # other results stay
        upper = np.triu(pin.crba(model, data, self.q))
        M = G.T @ (upper + np.triu(upper, 1).T) @ G
        return M, G.T @ pin.rnea(model, data, self.q, self._v, still)

    def in_root(self, frame: str) -> tuple[Array, Array, Array]:
        """Origin (3,) [m], axes (3, 3) and Jacobian (6, n + 6) of a frame in the world."""
        J, _, _ = self.frame_motion(frame, own_axes=False)
        placed = self.data.oMf[self._frames[self.known(frame)]]
        return placed.translation.copy(), placed.rotation.copy(), J

    def frame_motion(self, frame: str, *, own_axes: bool) -> tuple[Array, Array, Array]:
        """J (6, n + 6), ν = J·v and J̇·v of a frame in its own axes or in the world's."""
        number = self._frames[self.known(frame)]
        axes = pin.LOCAL if own_axes else pin.LOCAL_WORLD_ALIGNED
        accelerate = pin.getFrameAcceleration if own_axes else pin.getFrameClassicalAcceleration
        J = pin.getFrameJacobian(self.model, self.data, number, axes) @ self.G
        twist = pin.getFrameVelocity(self.model, self.data, number, axes).vector
        return J, twist, accelerate(self.model, self.data, number, axes).vector

    def com_motion(self) -> tuple[Array, Array, Array, Array]:
        """Centre of mass c (3,) [m], J (3, n + 6), ċ and J̇·v in the world, after `move`."""
        data = self.data
        place, velocity, rate = (np.array(each[0]) for each in (data.com, data.vcom, data.acom))
        J = pin.jacobianCenterOfMass(self.model, data, self.q, False) @ self.G
        return place, J, velocity, rate
