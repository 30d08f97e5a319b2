"""Where a robot's links and its centre of mass are, in the world that is drawn.

The world is that of State's `base` where the robot has a free base. Else it is the description's
`base_frame`, the frame that is fixed to the ground.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from hoap3.protocol.messages import FloatArray
from hoap3.protocol.robot.description import RobotDescription
from hoap3.protocol.robot.pinocchio_model import build_model

BASE = 7  # numbers of `base` that are its pose


class Poses:
    """Forward kinematics of all links, by Pinocchio.

    Args:
        description: of the robot.

    Attributes:
        links: names, in the order of the URDF.

    Raises:
        DescriptionError: Pinocchio cannot build the model.
    """

    def __init__(self, description: RobotDescription) -> None:
        import pinocchio as pin

        self._pin = pin
        self._robot = build_model(description)
        self._model, self._data = self._robot.model, self._robot.data
        self.links = description.frames
        self._place_of = {name: place for place, name in enumerate(self.links)}
        self._ids = [self._robot.frames[name] for name in self.links]
        self._base = self._robot.frames[description.base_frame]
        self._q = np.zeros(self._model.nq)
        self._weighs = description.structure.weighs
        self._placements: list[Any] = []
        self._com = np.zeros(3)

    def update(self, q: FloatArray, base: FloatArray | None = None) -> None:
        """Take joint positions and the pose of the root link.

        Args:
            q: (n,) in wire order [rad or m].
            base: State's `base`, (13,), or at least its pose, with a quaternion of any length; of
                zero, none. Empty or None without a free base.
        """
        pin, robot = self._pin, self._robot
        self._q[robot.order] = q if robot.mimic_joints is None else robot.mimic_joints.positions(q)
        pin.forwardKinematics(self._model, self._data, self._q)
        pin.updateFramePlacements(self._model, self._data)
        if base is not None and len(base) >= BASE:
            turn = pin.Quaternion(np.array(base[3:BASE], float))
            turn = turn.normalized() if turn.norm() > 0.0 else pin.Quaternion.Identity()
            root = pin.SE3(turn, np.array(base[:3], float))
        else:
            root = self._data.oMf[self._base].inverse()
        self._placements = [root * self._data.oMf[number] for number in self._ids]
        if self._weighs:
            moving = pin.centerOfMass(self._model, self._data, self._q)
            share = robot.root_mass / robot.total_mass
            self._com = root.act((1.0 - share) * np.array(moving) + share * robot.root_com)

    @property
    def poses(self) -> list[list[float]]:
        """Of each link: x, y, z [m] and quaternion x, y, z, w."""
        return [self._pin.SE3ToXYZQUAT(each).tolist() for each in self._placements]

    @property
    def com(self) -> FloatArray | None:
        """Centre of mass, (3,) [m]; None where nothing that moves has a mass."""
        return self._com.copy() if self._weighs else None

    def knows(self, link: object) -> bool:
        """Whether the robot has a link of that name."""
        return link in self._place_of

    def placement(self, link: str) -> Any:
        """Pose of a link, a `pinocchio.SE3`."""
        return self._placements[self._place_of[link]]

    def pose(self, link: str) -> list[float]:
        """Pose of a link: x, y, z [m] and quaternion x, y, z, w."""
        found: list[float] = self._pin.SE3ToXYZQUAT(self.placement(link)).tolist()
        return found

    def seen_from(self, link: str, reference: str) -> list[float]:
        """Pose of a link in another's axes, likewise."""
        relative = self.placement(reference).actInv(self.placement(link))
        found: list[float] = self._pin.SE3ToXYZQUAT(relative).tolist()
        return found

    def com_from(self, reference: str) -> list[float]:
        """Centre of mass in a link's axes, (3,) [m]."""
        return [float(each) for each in self.placement(reference).actInv(self._com)]
