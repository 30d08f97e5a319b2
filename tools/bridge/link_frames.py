"""Where a robot's links are, each as seen from the one that carries it, as viewers draw a robot.

They follow from the URDF (http://wiki.ros.org/urdf/XML/joint): a joint's frame lies at its <origin>
in the link before it, and turns about its axis by q, or moves along it. Quaternions are x, y, z, w.
"""

from __future__ import annotations

from xml.etree import ElementTree as ET

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.description import RobotDescription
from hoap3.protocol.messages import FloatArray


def world_frame(description: RobotDescription) -> str:
    """Return the name of the top frame, where a fixed base frame lies; no link has that name."""
    name = "world"
    while name in description.frames:
        name += "_"
    return name


class LinkFrames:
    """Positions and orientations of a robot's links from its joint positions.

    Args:
        description: of the robot.

    Attributes:
        parents, children: names of the frames, (k + 1,): first the world and the root link, then
            the links before and behind each of the k joints.
    """

    def __init__(self, description: RobotDescription) -> None:
        structure = description.structure
        self.parents = (world_frame(description), *(joint.parent for joint in structure.joints))
        self.children = (structure.root, *(joint.child for joint in structure.joints))
        k, places = len(structure.joints), description.joint_names
        self._master = np.zeros(k, np.intp)
        self._ratio, self._offset = np.zeros((2, k))
        self._turns = np.zeros(k, np.bool_)
        self._origin, self._axis = np.zeros((2, k, 3))
        self._rotation = np.zeros((k, 4))
        elements = ET.fromstring(description.urdf).findall("joint")  # noqa: S314 - read_urdf took it
        for row, (joint, element) in enumerate(zip(structure.joints, elements, strict=True)):
            self._origin[row], self._rotation[row] = _origin(element)
            if joint.name not in structure.moved:
                continue
            axis = _numbers(element.find("axis"), "xyz", "1 0 0")
            self._axis[row] = axis / np.linalg.norm(axis)
            self._turns[row] = joint.kind != "prismatic"
            follower = structure.followers.get(joint.name)
            self._master[row] = places.index(follower.master if follower else joint.name)
            self._ratio[row] = follower.ratio if follower else 1.0
            self._offset[row] = follower.offset if follower else 0.0
        above = {joint.child: row for row, joint in enumerate(structure.joints)}
        self._to_base: list[int] = []  # joints from the root to the base frame
        link = description.base_frame
        while link != structure.root:
            self._to_base.insert(0, above[link])
            link = structure.joints[above[link]].parent

    def poses(self, q: FloatArray, base: FloatArray) -> NDArray[np.float64]:
        """Each child in the frame of its parent, (k + 1, 7): x, y, z [m], qx, qy, qz, qw.

        Args:
            q: (n,) joint positions [rad or m].
            base: pose of the root link in the world, its first 7 numbers, as State has it; empty
                where the base frame is fixed.
        """
        moved = self._ratio * q[self._master] + self._offset
        half = 0.5 * moved * self._turns
        turn = np.column_stack([self._axis * np.sin(half)[:, None], np.cos(half)])
        along = self._axis * (moved * ~self._turns)[:, None]
        out = np.empty((len(self.children), 7))
        out[1:, :3] = self._origin + _turned(self._rotation, along)
        out[1:, 3:] = _product(self._rotation, turn)
        out[0] = base[:7] if len(base) else self._root(out[1:])
        return out

    def _root(self, poses: FloatArray) -> FloatArray:
        """Pose of the root link in the base frame."""
        place, turn = np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0])
        for row in self._to_base:
            place = place + _turned(turn, poses[row, :3])
            turn = _product(turn, poses[row, 3:])
        back = turn * np.array([-1.0, -1.0, -1.0, 1.0])
        return np.concatenate([-_turned(back, place), back])


def _numbers(element: ET.Element | None, attribute: str, default: str) -> FloatArray:
    text = default if element is None else element.get(attribute, default)
    return np.array([float(word) for word in text.split()])


def _origin(joint: ET.Element) -> tuple[FloatArray, FloatArray]:
    """Position and quaternion of a joint's <origin>: roll, pitch, yaw about fixed axes."""
    element = joint.find("origin")
    roll, pitch, yaw = _numbers(element, "rpy", "0 0 0")
    turn = np.array([0.0, 0.0, 0.0, 1.0])
    for axis, angle in ((2, yaw), (1, pitch), (0, roll)):
        part = np.array([0.0, 0.0, 0.0, np.cos(0.5 * angle)])
        part[axis] = np.sin(0.5 * angle)
        turn = _product(turn, part)
    return _numbers(element, "xyz", "0 0 0"), turn


def _product(a: FloatArray, b: FloatArray) -> FloatArray:
    """Quaternions a ⊗ b, (…, 4)."""
    vector = a[..., 3:] * b[..., :3] + b[..., 3:] * a[..., :3] + np.cross(a[..., :3], b[..., :3])
    scalar = a[..., 3:] * b[..., 3:] - np.sum(a[..., :3] * b[..., :3], axis=-1, keepdims=True)
    return np.concatenate([vector, scalar], axis=-1)


def _turned(turn: FloatArray, vector: FloatArray) -> FloatArray:
    """Vectors, (…, 3), turned by unit quaternions, (…, 4)."""
    t = 2.0 * np.cross(turn[..., :3], vector)
    return np.asarray(vector + turn[..., 3:] * t + np.cross(turn[..., :3], t))
