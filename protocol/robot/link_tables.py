"""A robot's links as tables that a kernel can walk, and the columns of those tables.

Each joint has a frame of its own here: at the joint, fixed to the link that it moves, z along its
axis. That makes a revolute joint a turn about z and a prismatic one a shift along z.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.messages import FloatArray
from hoap3.protocol.robot.pinocchio_model import RobotModel

ROTATION, ORIGIN, MASS, MOMENT, INERTIA, ARMATURE, COLUMNS = 0, 9, 12, 13, 16, 22, 23


@dataclass(frozen=True, eq=False)
class Tree:
    """The moving links of a robot in Pinocchio's order: a parent comes before its children.

    Attributes:
        links: (n, 23) by joint: the rotation (3x3, row by row) and the origin of its frame in
            that of its parent at q = 0; of the link, seen from that frame: its mass [kg], its
            first moment, mass times centre of mass [kg m], its inertia about the origin, xx xy xz
            yy yz zz [kg m²]; and the armature [kg m², prismatic kg].
        parents: (n,) which joint moves the parent; -1 for the root.
        prismatic: (n,) whether the joint shifts.
        gravity: (3,) in the root's axes [m/s²].
        order: (n,) where each joint of the wire is in these tables.
    """

    links: FloatArray
    parents: NDArray[np.int64]
    prismatic: NDArray[np.bool_]
    gravity: FloatArray
    order: NDArray[np.int64]

    @property
    def tables(self) -> tuple[FloatArray, NDArray[np.int64], NDArray[np.bool_], FloatArray]:
        """What the kernels take."""
        return self.links, self.parents, self.prismatic, self.gravity


def build_tree(robot: RobotModel) -> Tree:
    """Take the tables out of a Pinocchio model of revolute and prismatic joints."""
    model, n = robot.model, robot.description.n
    links, prismatic = np.zeros((n, COLUMNS)), np.zeros(n, np.bool_)
    turned = [np.eye(3)]  # of each joint's frame here against Pinocchio's
    for joint in range(1, n + 1):
        data = model.joints[joint].createData()
        model.joints[joint].calc(data, np.zeros(n))
        axis = np.asarray(data.S, np.float64).reshape(6)
        row = joint - 1
        prismatic[row] = bool(np.any(axis[:3]))
        turned.append(_with_z_along(axis[:3] if prismatic[row] else axis[3:]))
        placement, inertia = model.jointPlacements[joint], model.inertias[joint]
        above, here = turned[int(model.parents[joint])], turned[joint]
        center = here.T @ inertia.lever
        moment, about_center = inertia.mass * center, here.T @ inertia.inertia @ here
        inertia_here = about_center + (moment @ center) * np.eye(3) - np.outer(moment, center)
        links[row, ROTATION:ORIGIN] = (above.T @ placement.rotation @ here).ravel()
        links[row, ORIGIN:MASS] = above.T @ placement.translation
        links[row, MASS] = inertia.mass
        links[row, MOMENT:INERTIA] = moment
        links[row, INERTIA:ARMATURE] = inertia_here[np.triu_indices(3)]
        links[row, ARMATURE] = model.armature[row]
    parents = np.array([int(parent) - 1 for parent in list(model.parents)[1:]], np.int64)
    gravity = np.array(model.gravity.linear, np.float64)
    return Tree(links, parents, prismatic, gravity, np.array(robot.order, np.int64))


def _with_z_along(axis: FloatArray) -> FloatArray:
    """A rotation whose third column is the axis; the unit matrix for z itself."""
    if axis[2] == 1.0:
        return np.eye(3)
    x = np.cross(np.eye(3)[int(np.argmin(np.abs(axis)))], axis)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(axis, x), axis])
