"""A URDF as MuJoCo takes it: another link as its root, a foot instead of a pelvis; no `world`."""

from __future__ import annotations

from xml.etree import ElementTree as ET

import numpy as np

from hoap3.protocol.messages import FloatArray


def rerooted(urdf: str, link: str) -> str:
    """The same robot hanging from `link`: same links, joints, coordinates and shapes.

    A joint on the way from the old root to the new one is turned round: its axis changes sign, and
    a link without mass, in the joint's frame, stands between it and what was its parent.

    Args:
        urdf: a URDF that was checked.
        link: of it.
    """
    robot = ET.fromstring(urdf)  # noqa: S314 (`read_urdf` lets no DTD pass)
    above = {_end(joint, "child"): joint for joint in robot.findall("joint")}
    here = link
    while here in above:
        joint = above[here]
        parent, name = _end(joint, "parent"), f"{joint.get('name')} turned round"
        origin, axis = joint.find("origin"), joint.find("axis")
        ET.SubElement(robot, "link", name=name)
        fixed = ET.SubElement(robot, "joint", name=name, type="fixed")
        ET.SubElement(fixed, "parent", link=name)
        ET.SubElement(fixed, "child", link=parent)
        fixed.append(_inverse(origin))
        if origin is not None:
            joint.remove(origin)
        if axis is None:
            axis = ET.SubElement(joint, "axis", xyz="1 0 0")
        axis.set("xyz", _text(-_numbers(axis, "xyz")))
        _set_end(joint, "parent", here)
        _set_end(joint, "child", name)
        here = parent
    return ET.tostring(robot, encoding="unicode")


def body_of(link: str) -> str:
    """MuJoCo's name of a link: its own body is called world, and no other can be."""
    return f"link {link}" if link == "world" else link


def without_world(urdf: str) -> str:
    """The same robot with links called as `body_of` has it."""
    robot = ET.fromstring(urdf)  # noqa: S314 (`read_urdf` lets no DTD pass)
    for link in robot.findall("link"):
        link.set("name", body_of(link.get("name", "")))
    for joint in robot.findall("joint"):
        for end in ("parent", "child"):
            _set_end(joint, end, body_of(_end(joint, end)))
    return ET.tostring(robot, encoding="unicode")


def rotation_of(rpy: FloatArray | tuple[float, float, float]) -> FloatArray:
    """R_z(yaw)·R_y(pitch)·R_x(roll), (3, 3), as a URDF's `rpy` means it [rad]."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(rpy), np.sin(rpy)
    roll = np.array([[1.0, 0.0, 0.0], [0.0, cr, -sr], [0.0, sr, cr]])
    pitch = np.array([[cp, 0.0, sp], [0.0, 1.0, 0.0], [-sp, 0.0, cp]])
    yaw = np.array([[cy, -sy, 0.0], [sy, cy, 0.0], [0.0, 0.0, 1.0]])
    return np.asarray(yaw @ pitch @ roll)


def root_inertia(urdf: str, link: str) -> tuple[float, FloatArray, FloatArray]:
    """Mass [kg], its centre (3,) [m] and the inertia about it (3, 3) [kg m²], in the link's axes.

    All zero where the link has no <inertial>.
    """
    robot = ET.fromstring(urdf)  # noqa: S314 (`read_urdf` lets no DTD pass)
    found = [each for each in robot.findall("link") if each.get("name") == link]
    inertial = found[0].find("inertial") if found else None
    mass = None if inertial is None else inertial.find("mass")
    inertia = None if inertial is None else inertial.find("inertia")
    if inertial is None or mass is None or inertia is None:
        return 0.0, np.zeros(3), np.zeros((3, 3))
    origin = inertial.find("origin")
    centre, rotation = np.zeros(3), np.eye(3)
    if origin is not None:
        centre, rotation = _numbers(origin, "xyz"), rotation_of(_numbers(origin, "rpy"))
    xx, xy, xz, yy, yz, zz = (
        float(inertia.get(key, "0")) for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    )
    tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return float(mass.get("value", "0")), centre, rotation @ tensor @ rotation.T


def _inverse(origin: ET.Element | None) -> ET.Element:
    """An <origin> that undoes one."""
    if origin is None:
        return ET.Element("origin")
    back = rotation_of(_numbers(origin, "rpy")).T
    roll = np.arctan2(back[2, 1], back[2, 2])
    pitch = np.arctan2(-back[2, 0], np.hypot(back[2, 1], back[2, 2]))
    yaw = np.arctan2(back[1, 0], back[0, 0])
    if np.hypot(back[0, 0], back[1, 0]) < 1e-9:  # straight up or down: yaw and roll turn alike
        roll, yaw = np.arctan2(-back[1, 2], back[1, 1]), 0.0
    place = -back @ _numbers(origin, "xyz")
    return ET.Element("origin", xyz=_text(place), rpy=_text(np.array([roll, pitch, yaw])))


def _end(joint: ET.Element, end: str) -> str:
    found = joint.find(end)
    return "" if found is None else found.get("link", "")


def _set_end(joint: ET.Element, end: str, link: str) -> None:
    found = joint.find(end)
    if found is not None:
        found.set("link", link)


def _numbers(element: ET.Element, key: str) -> FloatArray:
    return np.array([float(word) for word in element.get(key, "0 0 0").split()])


def _text(values: FloatArray) -> str:
    return " ".join(repr(float(value) + 0.0) for value in values)
