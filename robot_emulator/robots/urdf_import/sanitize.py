"""Makes of a vendor's URDF one that can travel: a new text of what is understood, and no more."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from xml.etree import ElementTree as ET

from hoap3.protocol.errors import DescriptionError
from hoap3.protocol.urdf import UrdfStructure, read_urdf
from hoap3.robot_emulator.robots.urdf_import.joints import SPEED, ReadJoint, read_joints
from hoap3.robot_emulator.robots.urdf_import.links import Visual, read_links
from hoap3.robot_emulator.robots.urdf_import.names import rename_links, robot_name
from hoap3.robot_emulator.robots.urdf_import.notes import Notes
from hoap3.robot_emulator.robots.urdf_import.source import Source

UNDERSTOOD = {
    "robot": {"link", "joint", "material"},
    "link": {"inertial", "visual", "collision"},
    "joint": {"origin", "parent", "child", "axis", "limit", "dynamics", "mimic"},
}
"""What the elements of a URDF may hold here; <material> is colour, and colour does not matter."""


@dataclass(frozen=True)
class Sanitized:
    """A URDF that can travel.

    Attributes:
        name: of the robot, as it can stand on the network.
        urdf: the text.
        structure: of that text.
        joints: those that move, in the order of the file.
        massless: links without an inertia.
        visuals: meshes that stay here.
    """

    name: str
    urdf: str
    structure: UrdfStructure
    joints: tuple[ReadJoint, ...]
    massless: tuple[str, ...]
    visuals: tuple[Visual, ...]


def sanitize(
    source: Source, notes: Notes, name: str | None = None, lock: Sequence[str] = (), *, strict: bool
) -> Sanitized:
    """Make a URDF that can travel.

    Args:
        source: what the vendor has.
        notes: takes what was found.
        name: of the robot; by default what the file says, or is called.
        lock: joints that become fixed, each as NAME or NAME=VALUE.
        strict: a mesh that cannot be found or read is an error.

    Raises:
        ConfigError: there is no such joint to lock.
        DescriptionError: something in it cannot be what it says; names the link or the joint.
    """
    robot = source.robot
    stated = robot.get("name") or source.path.name.partition(".")[0]
    name = name or robot_name(stated)
    if name != stated:
        notes.add("read", f"the robot {stated!r:.60} is called {name!r} here")
    if robot.find("link") is None:
        raise DescriptionError("URDF: no <link>. Is this a part of a robot that others include?")
    _count_the_rest(robot, notes)
    rename_links(robot, notes)
    made, joints = read_joints(robot, notes, lock)
    if not any(each.get("type") in SPEED for each in robot.findall("joint")):
        raise DescriptionError("URDF: no joint moves. There is nothing to control.")
    links = read_links(robot, source.search, notes, strict=strict)
    new = ET.Element("robot", name=name)
    new.extend(links.made)
    new.extend(made)
    ET.indent(new)
    urdf = ET.tostring(new, encoding="unicode") + "\n"
    structure = read_urdf(urdf)
    return Sanitized(
        name, urdf, structure, tuple(joints), tuple(links.massless), tuple(links.visuals)
    )


def _count_the_rest(robot: ET.Element, notes: Notes) -> None:
    """Note the elements that are not understood, and how many they are."""
    unknown: Counter[str] = Counter()
    for element in (robot, *robot.findall("link"), *robot.findall("joint")):
        known = UNDERSTOOD[element.tag]
        unknown.update(_short(each.tag) for each in element if each.tag not in known)
    if unknown:
        found = [f"{count} <{tag}>" for tag, count in unknown.most_common()]
        notes.add("left out", "elements that mean nothing here", *found)


def _short(tag: str) -> str:
    return tag.rpartition("}")[2][:40]
