"""Dynamics of the robot and motion of one of its frames, once per sample."""

from __future__ import annotations

import numpy as np

from protocol.description import RobotDescription
from protocol.dynamics import Dynamics
from protocol.messages import FloatArray


class FrameDynamics:
    """M(q)·ddq + h(q, dq) = τ of a robot, and d/dt ν = J·ddq + J̇·dq of a frame's twist ν.

    Joints are in wire order. The twist is that of the frame in its own axes (Pinocchio's LOCAL):
    velocity of its origin [m/s] over angular velocity [rad/s]. Gravity is part of h unless the
    description has it `none`; friction is not.

    Args:
        description: of the robot.
        frame: name.

    Attributes:
        mass, bias: M (n, n) and h (n,).
        weight: torques that hold the robot, (n,), where it adds these itself; else 0.
        jacobian, drift, twist: J (6, n), J̇·dq (6,) and ν (6,).
        origin, rotation: of the frame in the root's axes, (3,) [m] and (3, 3); views.
        damping: viscous friction of the joints, (n,) [N m s/rad].

    Raises:
        DescriptionError: Pinocchio cannot build the model.
        FrameNotFoundError: the robot has no such frame.
    """

    def __init__(self, description: RobotDescription, frame: str) -> None:
        import pinocchio  # noqa: PLC0415 - heavy: whoever only checks a config does not need it

        from remote_controller.dynamics_kernels import frame_dynamics  # noqa: PLC0415 - compiles

        self._gather = frame_dynamics
        rigid = Dynamics(description)  # which has set gravity
        self.n, self.damping, self._robot = description.n, rigid.damping, rigid.robot
        self._model, self._data = rigid.robot.model, rigid.robot.data
        self._order = np.array(rigid.robot.order, np.int64)
        self._frame = self._robot.frame_id(frame)
        self._crba, self._nle = pinocchio.crba, pinocchio.nonLinearEffects
        self._world = pinocchio.Convention.WORLD
        self._place = pinocchio.updateFramePlacement
        self._place_all = pinocchio.framesForwardKinematics
        self._weigh = pinocchio.computeGeneralizedGravity
        self._compensated = description.gravity == "compensated"
        self._movers = self._movers_of(self._frame)
        data = self._data
        placement = data.oMf[self._frame]
        self.origin, self.rotation = placement.translation, placement.rotation
        self._views = (data.M.reshape(self.n, self.n), data.nle, data.J.reshape(6, self.n))
        self._q, self._v = np.zeros(self.n), np.zeros(self.n)
        self.mass, self.jacobian = np.zeros((self.n, self.n)), np.zeros((6, self.n))
        self.bias, self.weight = np.zeros(self.n), np.zeros(self.n)
        self.twist, self.drift = np.zeros(6), np.zeros(6)

    def update(self, q: FloatArray, dq: FloatArray) -> None:
        """Take joint positions and velocities, (n,) [rad, rad/s or m, m/s]; both finite."""
        model, data, order = self._model, self._data, self._order
        self._q[order], self._v[order] = q, dq
        self._crba(model, data, self._q, self._world)  # and the Jacobian of the joints
        self._nle(model, data, self._q, self._v)
        self._place(model, data, self._frame)
        if self._compensated:
            np.take(self._weigh(model, data, self._q), order, out=self.weight)
        self._gather(
            *self._views,
            self.origin,
            self.rotation,
            order,
            self._movers,
            dq,
            self.mass,
            self.bias,
            self.jacobian,
            self.twist,
            self.drift,
        )

    def placement(self, q: FloatArray, frame: str) -> tuple[FloatArray, FloatArray]:
        """Where a frame is in posture `q`, (n,): copies of origin (3,) [m] and rotation (3, 3)."""
        self._q[self._order] = q
        self._place_all(self._model, self._data, self._q)
        found = self._data.oMf[self._robot.frame_id(frame)]
        return found.translation.copy(), found.rotation.copy()

    def stands(self, frame: str) -> bool:
        """Whether no joint moves a frame."""
        return not self._movers_of(self._robot.frame_id(frame)).size

    def _movers_of(self, number: int) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
        """Joints of the wire that move a frame, from the root outwards."""
        model, places = self._model, list(self._order)
        joints = [j for j in model.supports[model.frames[number].parentJoint] if j > 0]
        return np.array([places.index(model.joints[j].idx_v) for j in joints], np.int64)
