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

from hoap3.protocol.errors import DescriptionError, FrameNotFoundError
from hoap3.protocol.robot.description import RobotDescription
from hoap3.protocol.robot.mimic_joints import MimicJoints

SOME_RANGE = math.pi  # rad: a revolute joint must have limits, of which nothing is used


@dataclass(frozen=True)
class RobotModel:
    """A fixed-base model: the root link stands still at the world's origin.

    Attributes:
        description: what the model was built from.
        model, data: ``pinocchio.Model`` and its ``pinocchio.Data``; nq == nv == m, the joints of
            the wire and their mimic joints. It has the description's armature; ``damping`` and
            ``friction`` are those of the URDF.
        order: (m,) index into Pinocchio's q and v of each joint in wire order, and then of each
            mimic joint. Without mimic joints ``q_pinocchio[order] = q_wire`` and ``J_wire =
            J_pinocchio[:, order]``. Read-only.
        mimic_joints: what joints of the wire and all m have to do with each other; None without
            any.
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
    mimic_joints: MimicJoints | None

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

    def moved_by(self, frame: str) -> NDArray[np.bool_]:
        """Return which joints move a frame, (m,), in Pinocchio's order.

        Raises:
            FrameNotFoundError: no link is called so.
        """
        moved = np.zeros(self.model.nv, np.bool_)
        for joint in self.model.supports[self.model.frames[self.frame_id(frame)].parentJoint]:
            if joint > 0:  # 0 is the world
                moved[self.model.joints[joint].idx_v] = True
        return moved

    def com_in(self, frame: str, q: NDArray[np.float64]) -> NDArray[np.float64]:
        """Centre of mass at `q`, (n,) in wire order, in a frame's axes from its origin, (3,) [m].

        Raises:
            FrameNotFoundError: no link is called so.
        """
        import pinocchio as pin

        ours = np.zeros(self.model.nq)
        ours[self.order] = self.mimic_joints.positions(q) if self.mimic_joints else q
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
        ours[self.order] = self.mimic_joints.positions(q) if self.mimic_joints else q
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
    mimic_joints = MimicJoints(description) if description.structure.mimic_joints else None
    names = (*description.joint_names, *(mimic_joints.names if mimic_joints else ()))
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
        mimic_joints=mimic_joints,
    )


def one_coordinate_each(description: RobotDescription) -> str:
    """The robot's URDF, continuous joints as revolute ones; without any, the text as it is.

    Pinocchio gives a continuous joint two coordinates, cosine and sine. A mimic joint is a joint of
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
