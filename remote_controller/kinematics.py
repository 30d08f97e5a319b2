"""Kinematics, once per sample."""

from __future__ import annotations

from typing import Any

import numpy as np

from protocol.description import RobotDescription
from protocol.messages import FloatArray
from protocol.model import build_model


class Kinematics:
    """Where the robot's frames and its centre of mass are, and how they move with the joints.

    Joints are in wire order, everywhere. The root link is Pinocchio's fixed base; its mass is
    kept in the centre of mass.

    Raises:
        DescriptionError: Pinocchio cannot build the model.
    """

    def __init__(self, description: RobotDescription) -> None:
        import pinocchio  # noqa: PLC0415 - heavy: whoever only checks a config does not need it

        from remote_controller.kinematics_kernels import com_in_frame  # noqa: PLC0415 - compiles

        self._com_in_frame = com_in_frame
        self.robot = build_model(description)
        self.n = description.n
        self._model, self._data = self.robot.model, self.robot.data
        self._order = np.array(self.robot.order, np.int64)
        self._q = np.zeros(self.n)
        self._moving_share = 1.0 - self.robot.root_mass / self.robot.total_mass
        root_com: Any = self.robot.root_com
        self._root_moment = np.array(root_com * self.robot.root_mass / self.robot.total_mass)
        self._pass = pinocchio.jacobianCenterOfMass
        self._place = pinocchio.updateFramePlacement
        self._frame_jacobian = pinocchio.getFrameJacobian
        self._aligned = pinocchio.ReferenceFrame.LOCAL_WORLD_ALIGNED

    def frame_id(self, frame: str) -> int:
        """Number of a frame.

        Raises:
            FrameNotFoundError: the robot has no such frame.
        """
        return int(self.robot.frame_id(frame))

    def update(self, q: FloatArray) -> None:
        """Take the joint positions `q`, (n,) [rad or m]."""
        self._q[self._order] = q
        self._pass(self._model, self._data, self._q, False)

    def com(self, frame: int, position_out: FloatArray, jacobian_out: FloatArray) -> None:
        """Centre of mass, (3,) [m], and its Jacobian, (3, n) [m/rad], as seen from a frame."""
        data = self._data
        placement = self._place(self._model, data, frame)
        self._com_in_frame(
            data.Jcom,
            self._frame_jacobian(self._model, data, frame, self._aligned),
            data.com[0],
            placement.translation,
            placement.rotation,
            self._root_moment,
            self._moving_share,
            self._order,
            position_out,
            jacobian_out,
        )
