"""Makes of a vendor's URDF one that can travel: a new text of what is understood, and no more."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from xml.etree import ElementTree as ET

from hoap3.protocol.errors import DescriptionError
from hoap3.protocol.robot.pinocchio_model import roll_pitch_yaw
from hoap3.protocol.robot.urdf import UrdfStructure, read_urdf
from hoap3.robot_emulator.robots.urdf_import.figures import figure, triple
from hoap3.robot_emulator.robots.urdf_import.joints import (
    ENDLESS,
    HARD,
    RATES,
    SPEED,
    ReadJoint,
    read_joints,
)
from hoap3.robot_emulator.robots.urdf_import.links import Visual, read_links
from hoap3.robot_emulator.robots.urdf_import.names import rename_links, robot_name
from hoap3.robot_emulator.robots.urdf_import.notes import LONG, Notes
from hoap3.robot_emulator.robots.urdf_import.source import Source

SOFT, BRAKING = "safety_controller", "position_based_velocity_limits"
_TABLE = (
    "robot: name version: : link joint material; link: name: inertial: visual collision; "
    "inertial: : origin mass inertia; visual: name: origin geometry material; "
    "collision: name: origin geometry; geometry: : box cylinder sphere capsule mesh; "
    f"joint: name type: origin parent child axis limit dynamics mimic {SOFT} {BRAKING}; "
    "origin: xyz rpy quat_xyzw; mass: value; inertia: ixx ixy ixz iyy iyz izz; box: size; "
    "cylinder: radius length; capsule: radius length; sphere: radius; mesh: filename scale; "
    "parent: link; child: link; axis: xyz; dynamics: damping friction; "
    f"limit: lower upper velocity effort {' '.join(RATES)}; mimic: joint multiplier offset; "
    f"{SOFT}: soft_lower_limit soft_upper_limit; {BRAKING}: deceleration_limit"
)
UNDERSTOOD = {
    tag: [(*map(str.split, rest), [], [])[place] for place in range(3)]
    for tag, *rest in (each.split(":") for each in _TABLE.split("; "))
}
"""Of each element: its attributes, and the elements that it holds once, and more than once.

<material> is colour, and colour does not matter.
"""
LENGTHS = ("xyz", "size", "length", "radius")
PLACEHOLDERS = {"velocity": 1e3, "effort": 1e6, **dict.fromkeys(RATES, 1e9)}
"""From which value on a limit is none, as exporters write it."""
LARGE = {"lower": 13.0, "upper": 13.0, "velocity": 60.0}
"""rad, rad/s: what is larger is probably in degrees."""


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
    count_the_rest(robot, notes)
    _normalize(robot, notes)
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


def count_the_rest(robot: ET.Element, notes: Notes) -> None:
    """Note the elements and attributes that mean nothing here, and how many they are."""
    unknown: defaultdict[str, Counter[str]] = defaultdict(Counter)
    for part in (*robot.findall("link"), *robot.findall("joint")):
        _count(part, f"{part.tag} {part.get('name', '')!r:.70}", unknown)
    _count(robot, "", unknown)
    version = robot.get("version", "1.0")
    if version.strip() not in {"1", "1.0", "1.1", "1.2"}:
        notes.add("read", f"as URDF 1.2, though <robot version> is {version!r:.20}")
    for what, found in unknown.items():
        notes.add("left out", what, *(f"{count} {each}" for each, count in found.most_common()))


def _count(element: ET.Element, part: str, unknown: defaultdict[str, Counter[str]]) -> None:
    """Count the attributes and children of an element that are not used."""
    attributes, once, often = UNDERSTOOD[element.tag]
    fixed = element.tag == "joint" and element.get("type") == "fixed"
    once = ["origin", "parent", "child", "axis"] if fixed else once
    for key in element.attrib:
        if key not in attributes and not (element.tag == "limit" and _short(key) in RATES):
            unknown["attributes that mean nothing here"][f"{_short(key)} of <{element.tag}>"] += 1
    seen: set[str] = set()
    for child in element:
        again = child.tag in seen or (element.tag == "geometry" and len(seen) > 0)
        seen.add(child.tag)
        if child.tag in once and again:
            what = "given more than once, so that the first holds"
            unknown[what][f"<{child.tag}> of {part}"] += 1
        elif child.tag not in {*once, *often} and element.tag != "geometry":
            of = " of fixed joints" if fixed and child.tag in UNDERSTOOD else ""
            unknown["elements that mean nothing here"][f"<{_short(child.tag)}>{of}"] += 1
        elif part and child.tag in UNDERSTOOD:
            _count(child, part, unknown)


def _short(tag: str) -> str:
    return tag.rpartition("}")[2][:40]


def _normalize(robot: ET.Element, notes: Notes) -> None:
    """Write what newer versions of URDF and dialects have as plain URDF, without placeholders."""
    for part in (*robot.findall("link"), *robot.findall("joint")):
        where = f"URDF {part.tag} {part.get('name')!r:.80}"
        for element in part.iter():
            if "quat_xyzw" in element.attrib:
                element.set("rpy", _roll_pitch_yaw(element, where))
            if element.tag != "axis":
                words = " ".join(element.get(key, "") for key in LENGTHS)
                notes.lengths(words.split(), f"{part.tag} {part.get('name')}")
        if part.tag != "joint" or part.get("type") == "fixed":
            continue
        limit = part.find("limit")
        if limit is None and (part.find(SOFT) is not None or part.find(BRAKING) is not None):
            limit = ET.SubElement(part, "limit")
        if limit is not None:
            for key in HARD:  # of a vendor, who means something else by it
                limit.attrib.pop(key, None)
            _normalize_limits(part, limit, where, notes)


def _roll_pitch_yaw(origin: ET.Element, where: str) -> str:
    """The `rpy` of an <origin> that has `quat_xyzw`, as URDF 1.1 may."""
    from scipy.spatial.transform import Rotation

    quaternion = triple(origin, "quat_xyzw", where, 0.0, 4)
    if "rpy" in origin.attrib or not quaternion.any():
        raise DescriptionError(
            f"{where}: <origin quat_xyzw> is {origin.get('quat_xyzw'):.60}, and rpy is "
            f"{origin.get('rpy', 'not given'):.60}. Write one of them, and no zero quaternion."
        )
    return " ".join(map(repr, roll_pitch_yaw(Rotation.from_quat(quaternion).as_matrix()).tolist()))


def _normalize_limits(joint: ET.Element, limit: ET.Element, where: str, notes: Notes) -> None:
    """Leave in <limit> what is plausible, with what other elements of the joint add to it."""
    name, braking, kind = joint.get("name", ""), joint.find(BRAKING), joint.get("type")
    found = {_short(key): value for key, value in limit.attrib.items() if _short(key) in RATES}
    if braking is not None and "deceleration_limit" in braking.attrib:
        found = {"deceleration": braking.attrib["deceleration_limit"], **found}
    limit.attrib.update(found | limit.attrib)
    follows = joint.find("mimic") is not None
    for key, most in PLACEHOLDERS.items():
        value = figure(limit, key, where)
        if value is None or (value == 0.0 and key not in RATES):
            continue
        if not 0.0 < value < most or (follows and key in RATES):
            del limit.attrib[key]
            why = "of a mimic joint" if follows and key in RATES else "that is not plausible"
            notes.add("left out", f"{key} {why}", f"{name} ({value:g})")
    for key, large in LARGE.items():
        most, unit = (LONG, "millimetres") if kind == "prismatic" else (large, "degrees")
        value = figure(limit, key, where) or 0.0
        if most < abs(value) < ENDLESS:
            notes.add("read", f"{key} so large that it may be in {unit}", f"{name} ({value:g})")
    soft = [figure(joint.find(SOFT), f"soft_{key}_limit", where) for key in ("lower", "upper")]
    if soft == [None, None]:
        return
    lower, upper = (value or 0.0 for value in soft)  # one that is missing is 0, as in <limit>
    hard = [figure(limit, key, where) or 0.0 for key in ("lower", "upper")]
    if any(hard):
        lower, upper = max(lower, hard[0]), min(upper, hard[1])
    if follows or kind == "continuous" or not lower < upper:
        notes.add(
            "left out", "soft limits of a mimic joint or a continuous joint, or without room", name
        )
        return
    stops = "and <limit> the stops" if any(hard) else "and <limit> has none"
    text = f"soft limits of <{SOFT}> are the usable range, {stops}"
    notes.add("read", text, f"{name} ({lower:g} to {upper:g})")
    limit.attrib |= {"lower": repr(lower), "upper": repr(upper)}
    if any(hard):
        limit.attrib |= dict(zip(HARD, map(repr, hard), strict=True))
