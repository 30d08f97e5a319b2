"""A URDF as Pinocchio shall read it: one coordinate for each moving joint."""

from __future__ import annotations

import math
from xml.etree import ElementTree as ET

from hoap3.protocol.description import RobotDescription

SOME_RANGE = math.pi  # rad: a revolute joint must have limits, of which nothing is used


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
