"""Centre of mass by another way: a floating model, whose base is somewhere odd."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from hoap3.protocol.messages import FloatArray
from hoap3.protocol.robot.description import RobotDescription

BASE = np.array([0.3, -0.7, 1.1, *(np.array([0.1, 0.5, -0.3, 0.8]) / np.sqrt(0.99))])


class FreeFlyer:
    """The same robot with its root link's mass where Pinocchio has it: on a floating joint."""

    def __init__(self, description: RobotDescription) -> None:
        self.model = pin.buildModelFromXML(description.urdf, pin.JointModelFreeFlyer())
        self.data = self.model.createData()
        joints = [self.model.joints[self.model.getJointId(j)] for j in description.joint_names]
        self.places = [joint.idx_q for joint in joints]
        self.columns = [joint.idx_v for joint in joints]

    def com(self, frame: str, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Centre of mass, (3,), and its Jacobian, (3, n), in a frame; joints in wire order."""
        whole = np.empty(self.model.nq)
        whole[:7], whole[self.places] = BASE, q
        com_jacobian = pin.jacobianCenterOfMass(self.model, self.data, whole)[:, self.columns]
        com = self.data.com[0]
        number = self.model.getFrameId(frame, pin.FrameType.BODY)
        placement = pin.updateFramePlacement(self.model, self.data, number)
        world = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        frame_jacobian = pin.getFrameJacobian(self.model, self.data, number, world)
        linear, angular = np.vsplit(frame_jacobian[:, self.columns], 2)
        arm = com - placement.translation
        seen = com_jacobian - linear + np.cross(arm, angular, axis=0)
        return placement.actInv(com), placement.rotation.T @ seen
