"""Builds the Pinocchio model of a described robot; Pinocchio is imported here, on use.

It sorts the joints in its own way: `RobotModel.order` says where each joint of the wire went.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.description import RobotDescription
from hoap3.protocol.errors import DescriptionError, FrameNotFoundError
from hoap3.protocol.robot.followers.followers import Followers

SOME_RANGE = math.pi  # rad: a revolute joint must have limits, of which nothing is used


@dataclass(frozen=True)
class RobotModel:
    """A fixed-base model: the root link stands still at the world's origin.

    Attributes:
        description: what the model was built from.
        model, data: ``pinocchio.Model`` and its ``pinocchio.Data``; nq == nv == m, the joints of
            the wire and their followers. It has the description's armature; ``damping`` and
            ``friction`` are those of the URDF.
        order: (m,) index into Pinocchio's q and v of each joint in wire order, and then of each
            follower. Without followers ``q_pinocchio[order] = q_wire`` and ``J_wire =
            J_pinocchio[:, order]``. Read-only.
        followers: what joints of the wire and all m have to do with each other; None without any.
        root_mass: mass of the root link and all that is fixed to it [kg]; Pinocchio keeps it in
            ``model.inertias[0]`` and leaves it out of the centre of mass and of the total.
        root_com: (3,) its centre of mass in the root link's frame [m]. Read-only.
        total_mass: with the root [kg].
        frames: Pinocchio's frame index of every link.
    """

    description: RobotDescription
    model: Any
    data: Any
    order: NDArray[np.intp]
    root_mass: float
    root_com: NDArray[np.float64]
    total_mass: float
    frames: dict[str, int]
    followers: Followers | None

    @property
    def wire(self) -> NDArray[np.intp]:
        """(n,) the part of `order` that is the wire's."""
        return self.order[: self.description.n]

    def frame_id(self, name: str) -> int:
        """Pinocchio's index of a frame.

        Raises:
            FrameNotFoundError: no link is called so; carries the names of all.
        """
        if name not in self.frames:
            raise FrameNotFoundError(name, self.description.name, self.frames)
        return self.frames[name]

    def com_in(self, frame: str, q: NDArray[np.float64]) -> NDArray[np.float64]:
        """Centre of mass at `q`, (n,) in wire order, in a frame's axes from its origin, (3,) [m].

        Raises:
            FrameNotFoundError: no link is called so.
        """
        import pinocchio as pin

        ours = np.zeros(self.model.nq)
        ours[self.order] = self.followers.positions(q) if self.followers else q
        share = self.root_mass / self.total_mass
        moving = pin.centerOfMass(self.model, self.data, ours)
        com = (1.0 - share) * np.array(moving) + share * self.root_com
        placed = pin.updateFramePlacement(self.model, self.data, self.frame_id(frame))
        return np.asarray(placed.actInv(com))

    def pose_in(self, frame: str, reference: str, q: NDArray[np.float64]) -> NDArray[np.float64]:
        """Pose of a frame at `q`, (n,) in wire order, as seen from another one.

        Returns:
            (7,) x, y, z [m] and a unit quaternion qx, qy, qz, qw.

        Raises:
            FrameNotFoundError: no link is called so.
        """
        import pinocchio as pin

        ours = np.zeros(self.model.nq)
        ours[self.order] = self.followers.positions(q) if self.followers else q
        pin.framesForwardKinematics(self.model, self.data, ours)
        placed, seen_from = (self.data.oMf[self.frame_id(name)] for name in (frame, reference))
        return np.asarray(pin.SE3ToXYZQUAT(seen_from.actInv(placed)))


def build_model(description: RobotDescription) -> RobotModel:
    """Build the model of a described robot.

    Raises:
        DescriptionError: Pinocchio or its URDF reader refuses the text.
    """
    import pinocchio as pin

    try:
        model = pin.buildModelFromXML(one_coordinate_each(description))
    except (ArithmeticError, LookupError, RuntimeError, ValueError) as error:
        raise DescriptionError(
            f"robot {description.name!r}: Pinocchio cannot read the URDF ({error}). "
            "Check it with check_urdf from liburdfdom-tools."
        ) from error
    followers = Followers(description) if description.structure.followers else None
    names = (*description.joint_names, *(followers.names if followers else ()))
    order = np.array([model.joints[model.getJointId(name)].idx_q for name in names], dtype=np.intp)
    model.armature[order[: description.n]] = description.armature
    root = model.inertias[0]
    root_com = np.array(root.lever, dtype=np.float64)
    for array in (order, root_com):
        array.setflags(write=False)
    return RobotModel(
        description=description,
        model=model,
        data=model.createData(),
        order=order,
        root_mass=float(root.mass),
        root_com=root_com,
        total_mass=float(root.mass) + float(pin.computeTotalMass(model)),
        frames={
            name: int(model.getFrameId(name, pin.FrameType.BODY)) for name in description.frames
        },
        followers=followers,
    )


def collision_shapes(
    description: RobotDescription,
) -> dict[str, list[tuple[Any, NDArray[np.float64], NDArray[np.float64]]]]:
    """The <collision> shapes of each link as Pinocchio reads them.

    Returns:
        By link: Coal's geometry, its centre (3,) [m] and its axes (3, 3) in the link's frame.

    Raises:
        DescriptionError: Pinocchio or its URDF reader refuses the text.
    """
    import pinocchio as pin

    model = build_model(description).model
    urdf = one_coordinate_each(description)
    found: dict[str, list[tuple[Any, NDArray[np.float64], NDArray[np.float64]]]] = {}
    shapes = pin.buildGeomFromUrdfString(model, urdf, pin.COLLISION)
    for shape in shapes.geometryObjects:
        frame = model.frames[shape.parentFrame]
        here = frame.placement.actInv(shape.placement)
        placed = (shape.geometry, here.translation.copy(), here.rotation.copy())
        found.setdefault(frame.name, []).append(placed)
    return found


def one_coordinate_each(description: RobotDescription) -> str:
    """The robot's URDF, continuous joints as revolute ones; without any, the text as it is.

    Pinocchio gives a continuous joint two coordinates, cosine and sine. A follower is a joint of
    its own to it, unless asked otherwise.
    """
    if not description.structure.continuous:
        return description.urdf
    robot = ET.fromstring(description.urdf)  # noqa: S314 (`read_urdf` has checked it)
    for joint in robot.iterfind("joint[@type='continuous']"):
        joint.set("type", "revolute")
        limit = joint.find("limit")
        if limit is None:
            limit = ET.SubElement(joint, "limit", velocity="1", effort="1")
        limit.attrib.setdefault("velocity", "1")
        limit.attrib.setdefault("effort", "1")
        limit.set("lower", str(-SOME_RANGE))
        limit.set("upper", str(SOME_RANGE))
    return ET.tostring(robot, encoding="unicode")


def moved_origin(
    xyz: NDArray[np.float64], rpy: NDArray[np.float64], twist: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Origin of a URDF after a motion in its own axes, (6,) [m, rad]: its `xyz` and `rpy`."""
    import pinocchio as pin

    placed = pin.SE3(pin.rpy.rpyToMatrix(*rpy), xyz) * pin.exp6(twist)
    return np.array(placed.translation), roll_pitch_yaw(placed.rotation)


def roll_pitch_yaw(rotation: NDArray[np.float64]) -> NDArray[np.float64]:
    """As a URDF writes a rotation R = Rz(yaw)·Ry(pitch)·Rx(roll), (3, 3): `rpy`, (3,) [rad]."""
    import pinocchio as pin

    return np.array(pin.rpy.matrixToRpy(rotation), np.float64)
