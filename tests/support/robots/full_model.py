"""Plain Pinocchio of all moving joints, and G, g₀ by hand: what our models are compared with."""

from __future__ import annotations

from collections.abc import Mapping
from xml.etree import ElementTree as ET

import numpy as np
import pinocchio as pin

from hoap3.protocol.robot.description import RobotDescription


class FullModel:
    """A robot's URDF read by Pinocchio alone, continuous joints written as revolute ones.

    Attributes:
        model, data: of all m moving joints.
        G, g0: (m, n) and (m,): q_pinocchio = G·q + g0 of the joints of the wire.
    """

    def __init__(self, robot: RobotDescription) -> None:
        tree = ET.fromstring(robot.urdf)
        for joint in tree.iterfind("joint[@type='continuous']"):
            joint.set("type", "revolute")
            for limit in joint.findall("limit"):
                joint.remove(limit)
            ET.SubElement(joint, "limit", lower="-9", upper="9", velocity="1", effort="1")
        mimics = {}
        for joint in tree.iterfind("joint"):
            found = joint.find("mimic")
            if found is not None:
                mimics[joint.get("name")] = found.attrib
                joint.remove(found)
        self.robot, self.model = robot, pin.buildModelFromXML(ET.tostring(tree, encoding="unicode"))
        self.data = self.model.createData()
        if robot.gravity == "none":
            self.model.gravity.setZero()
        self.G, self.g0 = np.zeros((self.model.nv, robot.n)), np.zeros(self.model.nv)
        for name in self.model.names[1:]:
            place = self.model.joints[self.model.getJointId(name)].idx_v
            self.G[place], self.g0[place] = self._law(name, mimics)
        for name, armature in zip(robot.joint_names, robot.armature, strict=True):
            place = self.model.joints[self.model.getJointId(name)].idx_v
            self.model.armature[place] = armature

    def _law(self, name: str, mimics: Mapping[str, Mapping[str, str]]) -> tuple[np.ndarray, float]:
        if name not in mimics:
            return np.eye(self.robot.n)[self.robot.joint_names.index(name)], 0.0
        row, offset = self._law(mimics[name]["joint"], mimics)
        ratio = float(mimics[name].get("multiplier", "1"))
        return ratio * row, ratio * offset + float(mimics[name].get("offset", "0"))

    def place(self, q: np.ndarray) -> None:
        """Take positions of the wire, (n,): frames and centre of mass."""
        full = self.G @ q + self.g0
        pin.framesForwardKinematics(self.model, self.data, full)
        pin.centerOfMass(self.model, self.data, full)

    def pose(self, frame: str, reference: str) -> tuple[np.ndarray, np.ndarray]:
        """Origin (3,) and axes (3, 3) of a frame as seen from another."""
        there, here = (
            self.data.oMf[self.model.getFrameId(name, pin.FrameType.BODY)]
            for name in (frame, reference)
        )
        seen = here.actInv(there)
        return seen.translation, seen.rotation

    def com(self, reference: str) -> np.ndarray:
        """Centre of mass (3,), the root's mass included."""
        root, mass = self.model.inertias[0], pin.computeTotalMass(self.model)
        whole = (root.mass * root.lever + mass * self.data.com[0]) / (root.mass + mass)
        here = self.data.oMf[self.model.getFrameId(reference, pin.FrameType.BODY)]
        return here.rotation.T @ (whole - here.translation)

    def mass(self, q: np.ndarray) -> np.ndarray:
        """Gᵀ·M·G by crba."""
        upper = np.triu(pin.crba(self.model, self.data, self.G @ q + self.g0))
        return self.G.T @ (upper + np.triu(upper, 1).T) @ self.G

    def torques(self, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> np.ndarray:
        """Gᵀ·τ by rnea."""
        full = (self.G @ q + self.g0, self.G @ dq, self.G @ ddq)
        return self.G.T @ pin.rnea(self.model, self.data, *full)
