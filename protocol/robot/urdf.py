"""Reads the structure of a URDF without trusting it, and without Pinocchio.

The format is http://wiki.ros.org/urdf/XML. What is accepted is a tree of at most 1024 links with
revolute, continuous, prismatic and fixed joints, of which some may follow others (<mimic>), and
boxes, cylinders and spheres as shapes: nothing that makes a reader open a file, expand an entity or
recurse without bound.
"""

from __future__ import annotations

import io
import math
import re
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Self
from xml.etree import ElementTree as ET

from hoap3.protocol.config.settings import XML_FORMATS
from hoap3.protocol.errors import DescriptionError, did_you_mean


@dataclass(frozen=True)
class Mimic:
    """What a mimic joint says: q = multiplier · q_joint + offset [rad or m]."""

    joint: str
    multiplier: float
    offset: float

    @classmethod
    def read(cls, where: str, given: Mapping[str, str]) -> Self:
        """Read the attributes of a <mimic>, whose numbers are checked already.

        Raises:
            DescriptionError: a multiplier of 0, with which nothing moves.
        """
        mimic = cls(
            given.get("joint", ""),
            float(given.get("multiplier", "1")),
            float(given.get("offset", "0")),
        )
        if mimic.multiplier == 0.0:
            raise DescriptionError(
                f"{where}: <mimic multiplier> is 0, so that it does not move. Write another "
                f'number, or type="fixed" with an <origin> at {mimic.offset}.'
            )
        return mimic


@dataclass(frozen=True)
class MimicJoint:
    """A joint that follows an independent one: q = multiplier · q_mimicked + offset [rad or m]."""

    name: str
    mimicked: str
    multiplier: float
    offset: float

    def mimicked_range(self, lower: float, upper: float) -> tuple[float, float]:
        """Return the range of the mimicked joint that keeps this one within its own."""
        first, last = ((end - self.offset) / self.multiplier for end in (lower, upper))
        return min(first, last), max(first, last)


def resolve(mimics: Mapping[str, Mimic | None]) -> dict[str, MimicJoint]:
    """The mimicked joint of each mimic joint, through other mimic joints if need be.

    Args:
        mimics: of all joints that are not fixed, by name; None of those that follow no other.

    Raises:
        DescriptionError: a joint follows what is no movable joint, or itself at last.
    """
    mimic_joints = {}
    for name, mimic in mimics.items():
        if mimic is not None:
            mimic_joints[name] = _follow(name, mimic, mimics)
    return mimic_joints


def _follow(name: str, mimic: Mimic, mimics: Mapping[str, Mimic | None]) -> MimicJoint:
    multiplier, offset, passed = 1.0, 0.0, [name]
    here: Mimic | None = mimic
    while here is not None:
        mimic_joint, mimicked = passed[-1], here.joint
        if mimicked in passed:
            chain = " → ".join([*passed, mimicked])
            raise DescriptionError(
                f"URDF joint {name!r}: it follows itself ({chain:.400}). "
                f"Remove the <mimic> of {mimicked!r}."
            )
        if mimicked not in mimics:
            raise DescriptionError(
                f"URDF joint {mimic_joint!r}: <mimic joint> is {mimicked[:60]!r}, no movable "
                "joint. "
                + did_you_mean(mimicked, mimics, 'Write <mimic joint=".."> with the name of one.')
            )
        offset += multiplier * here.offset
        multiplier *= here.multiplier
        passed.append(mimicked)
        here = mimics[mimicked]
    if multiplier == 0.0 or not math.isfinite(multiplier) or not math.isfinite(offset):
        raise DescriptionError(
            f"URDF joint {name!r}: it follows {passed[-1]!r} by {multiplier} and {offset}, through "
            f"{len(passed) - 2} others. Correct the multipliers and offsets of their <mimic>."
        )
    return MimicJoint(name, passed[-1], multiplier, offset)


MAX_BYTES = 1 << 20
MAX_DEPTH = 32
MAX_LINKS = 1024
MAX_NAME = 128  # characters
MAX_NUMBER = 64  # characters

CONTINUOUS = "continuous"
MOVABLE = ("revolute", CONTINUOUS, "prismatic")
SHAPES = ("box", "cylinder", "sphere")
RESERVED = {"joint": {"universe"}, "link": {"universe", "com"}}
"""Names with a meaning of their own: Pinocchio's joint 0 and world, the centre of mass in tasks."""

_WRITE_INSTEAD = {
    "floating": "Remove it: the base is fixed, the root link stands for it.",
    "planar": "Write two prismatic joints and a revolute one instead.",
}
_XACRO = (
    "URDF: this is a xacro file, from which a URDF is made. Expand it first: "
    "`xacro FILE > robot.urdf`."
)
_INERTIA = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
_LIMITS = ("lower", "upper", "velocity", "effort")
_RATES = ("acceleration", "deceleration", "jerk")  # of <limit>, since URDF 1.2
_NUMBER = re.compile(r"[+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
_NUMBERS = {  # attributes that must hold that many finite numbers
    "origin": {"xyz": 3, "rpy": 3},
    "axis": {"xyz": 3},
    "box": {"size": 3},
    "mass": {"value": 1},
    "cylinder": {"radius": 1, "length": 1},
    "sphere": {"radius": 1},
    "inertia": dict.fromkeys(_INERTIA, 1),
    "limit": dict.fromkeys((*_LIMITS, *_RATES), 1),
    "dynamics": {"damping": 1, "friction": 1},
    "mimic": {"multiplier": 1, "offset": 1},
}


@dataclass(frozen=True)
class UrdfJoint:
    """A joint as the URDF has it; limits in rad, rad/s, N m (or m, m/s, N), None if not given.

    `acceleration`, `deceleration` [rad/s²] and `jerk` [rad/s³] are those of URDF 1.2. A continuous
    joint has no `lower` and no `upper`, whatever its <limit> says; `mimic` is what a
    mimic joint says of its mimicked joint.
    """

    name: str
    kind: str
    parent: str
    child: str
    lower: float | None
    upper: float | None
    velocity: float | None
    effort: float | None
    mimic: Mimic | None = None
    acceleration: float | None = None
    deceleration: float | None = None
    jerk: float | None = None


@dataclass(frozen=True)
class UrdfStructure:
    """Links and joints of one tree.

    Attributes:
        links, joints: in the order of the text.
        root: the link that everything hangs from.
        moving: the links that some joint moves.
        mimic_joints: the joints that follow others, by name, in the order of the text.
        weighs: whether anything that moves has a mass.
    """

    links: tuple[str, ...]
    joints: tuple[UrdfJoint, ...]
    root: str
    moving: frozenset[str]
    mimic_joints: dict[str, MimicJoint]
    weighs: bool

    @cached_property
    def moved(self) -> dict[str, UrdfJoint]:
        """The joints that are not fixed, by name, in the order of the text."""
        return {joint.name: joint for joint in self.joints if joint.kind in MOVABLE}

    @cached_property
    def movable(self) -> dict[str, UrdfJoint]:
        """Those of them that follow no other: one coordinate each."""
        return {name: joint for name, joint in self.moved.items() if joint.mimic is None}

    @cached_property
    def continuous(self) -> frozenset[str]:
        """Names of the joints, mimic joints among them, that turn without end."""
        return frozenset(joint.name for joint in self.joints if joint.kind == CONTINUOUS)


@lru_cache(maxsize=4)  # a description checks itself anew at each change
def read_urdf(text: str) -> UrdfStructure:
    """Check a URDF and return its structure.

    Raises:
        DescriptionError: not a URDF that is accepted; the message says what to write instead.
    """
    robot = _parse(text)
    if robot.find("link") is None:
        raise DescriptionError(
            "URDF: no <link>. Write one for each body, and a <joint> between each and the next."
        )
    _check_shapes(robot)
    _check_numbers(robot)
    links = _unique("link", (_name(link) for link in robot.findall("link")))
    if len(links) > MAX_LINKS:
        raise DescriptionError(f"URDF: {len(links)} links. At most {MAX_LINKS} are accepted.")
    known = set(links)
    joints = tuple(_joint(element, known) for element in robot.findall("joint"))
    _unique("joint", (joint.name for joint in joints))
    root, moving = _tree(links, joints)
    weighs = _check_inertias(robot, moving)
    mimic_joints = resolve({each.name: each.mimic for each in joints if each.kind in MOVABLE})
    return UrdfStructure(links, joints, root, moving, mimic_joints, weighs)


def _parse(text: str) -> ET.Element:
    """Parse; entities and depth are refused before anything can expand or recurse."""
    size = len(text.encode("utf-8", errors="replace"))
    if size > MAX_BYTES:
        raise DescriptionError(f"URDF: {size} bytes. At most {MAX_BYTES} are accepted.")
    for forbidden in ("<!DOCTYPE", "<!ENTITY"):
        if forbidden in text:
            raise DescriptionError(f"URDF: {forbidden} found. Remove it: a URDF needs none.")
    depth = 0
    root: ET.Element | None = None
    try:
        events = ET.iterparse(io.StringIO(text), ("start", "end"))  # noqa: S314 (no DTD gets here)
        for event, element in events:
            root = element if root is None else root
            if element.tag.startswith("{") and "xacro" in element.tag.partition("}")[0]:
                raise DescriptionError(_XACRO)
            depth += 1 if event == "start" else -1
            if depth > MAX_DEPTH:
                raise DescriptionError(
                    f"URDF: elements nested deeper than {MAX_DEPTH}. Flatten it."
                )
    except (ET.ParseError, UnicodeError) as error:
        if "<xacro:" in text:  # a prefix that is not declared
            raise DescriptionError(_XACRO) from error
        raise DescriptionError(f"URDF: {not_well_formed(error)}") from error
    if root is None or root.tag != "robot":
        raise DescriptionError(f"URDF: {wrong_root('' if root is None else root.tag)}")
    return root


def not_well_formed(error: Exception) -> str:
    """Say why text is not XML, and what to do."""
    remedy = "Correct that place"
    if "declaration not at start" in str(error):
        remedy = "Move <?xml ..?> to the very start of the file, before comments and blank lines"
    elif "unbound prefix" in str(error):
        xmlns = 'xmlns:xacro="http://www.ros.org/wiki/xacro" or xmlns:drake="http://drake.mit.edu"'
        remedy = f"Declare the prefix of that place in <robot>, such as {xmlns}"
    return f"not well-formed XML ({error}). {remedy}."


def wrong_root(tag: str) -> str:
    """Say what a file is whose outermost element is not <robot>, and what to do."""
    namespace, _, name = tag.rpartition("}")
    if namespace and name == "robot":
        return f'<robot> has xmlns="{namespace[1:61]}". Remove that attribute.'
    if name in XML_FORMATS:
        return ". ".join(XML_FORMATS[name])
    return f"the outermost element is <{tag[:40]}>. Write <robot name=..>."


def _check_shapes(robot: ET.Element) -> None:
    for tag in ("mesh", "texture"):
        if robot.find(f".//{tag}") is not None:
            raise DescriptionError(
                f"URDF: <{tag}> names a file, and files do not travel with a description. "
                f"Use a primitive: {', '.join(SHAPES)}."
            )
    for geometry in robot.iter("geometry"):
        for shape in geometry:
            if shape.tag not in SHAPES:
                raise DescriptionError(
                    f"URDF: shape <{shape.tag[:40]}>. Use a primitive: {', '.join(SHAPES)}."
                )


def _check_numbers(robot: ET.Element) -> None:
    for part in robot:
        where = f"URDF {part.tag[:40]} {part.get('name')!r:.{MAX_NAME}}"
        for element in part.iter():
            if element.tag == "origin" and "quat_xyzw" in element.attrib:
                remedy = "Write rpy instead, or make the robot with `hoap3 robot import`"
                raise DescriptionError(f"{where}: <origin quat_xyzw> is not read here. {remedy}.")
            for attribute, text in element.attrib.items():
                count = _NUMBERS.get(element.tag, {}).get(attribute)
                if count is not None:
                    _numbers(f"{where}: <{element.tag} {attribute}>", text, count)
                if element.tag == "dynamics" and count is not None and float(text) < 0.0:
                    raise DescriptionError(
                        f"{where}: <dynamics {attribute}> is {text[:60]}. Write 0 or more."
                    )
            if element.tag == "axis" and not any(map(float, element.get("xyz", "1 0 0").split())):
                raise DescriptionError(f"{where}: <axis> is zero. Write its direction, as 0 0 1.")


def _numbers(where: str, text: str, count: int) -> None:
    words = text.split()
    if len(words) != count or not all(map(is_finite, words)):
        raise DescriptionError(
            f"{where}: found {text[:60]!r}. Write {count} finite number(s), each of at most "
            f"{MAX_NUMBER} characters{xacro_hint(text)}."
        )


def is_finite(word: str) -> bool:
    """Whether text is a finite decimal number: ASCII digits, and no `_` between them."""
    if len(word) > MAX_NUMBER or not _NUMBER.fullmatch(word):
        return False
    return math.isfinite(float(word))


def xacro_hint(text: str) -> str:
    """Say what to do about a xacro expression that stands where a number should."""
    if "$(" in text or "${" in text:
        return ", or expand this xacro expression first: `xacro FILE > robot.urdf`"
    return ""


def _check_inertias(robot: ET.Element, moving: frozenset[str]) -> bool:
    """Refuse what URDF readers drop without a word; whether anything that moves has a mass."""
    moving_mass = 0.0
    for link in robot.findall("link"):
        name, inertial = _name(link), link.find("inertial")
        if inertial is None:
            continue
        mass, inertia = inertial.find("mass"), inertial.find("inertia")
        if mass is None or "value" not in mass.attrib:
            raise DescriptionError(f'URDF link {name!r}: no mass. Write <mass value="..">, in kg.')
        if inertia is None or not inertia.attrib.keys() >= set(_INERTIA):
            raise DescriptionError(
                f"URDF link {name!r}: <inertia> is not complete. Write {', '.join(_INERTIA)}."
            )
        value = float(mass.attrib["value"])
        if value < 0.0:
            raise DescriptionError(f"URDF link {name!r}: mass {value} kg. Write 0 or more.")
        moving_mass += value if name in moving else 0.0
    return moving_mass > 0.0


def _name(element: ET.Element) -> str:
    name = element.get("name")
    if not name:
        raise DescriptionError(f"URDF: a <{element.tag}> without a name. Give it one.")
    if len(name) > MAX_NAME:
        raise DescriptionError(
            f"URDF {element.tag}: the name {name[:40]!r}… has {len(name)} characters. Write at "
            f"most {MAX_NAME}."
        )
    if name in RESERVED[element.tag]:
        raise DescriptionError(f"URDF {element.tag} {name!r}: a reserved name. Choose another.")
    return name


def _unique(kind: str, names: Iterable[str]) -> tuple[str, ...]:
    found = tuple(names)
    twice = first_twice(found)
    if twice is not None:
        raise DescriptionError(f"URDF {kind} {twice!r}: appears twice. Rename one of them.")
    return found


def first_twice(names: Sequence[str]) -> str | None:
    """The first name that appears more than once, or None."""
    return next((name for name, count in Counter(names).items() if count > 1), None)


def _joint(element: ET.Element, links: set[str]) -> UrdfJoint:
    name, kind = _name(element), element.get("type", "")
    where, mimic = f"URDF joint {name!r}", element.find("mimic")
    if mimic is not None and kind == "fixed":
        raise DescriptionError(f"{where}: it is fixed and has a <mimic>. Remove one of the two.")
    if kind != "fixed" and kind not in MOVABLE:
        instead = _WRITE_INSTEAD.get(kind, "Write revolute, continuous, prismatic or fixed.")
        raise DescriptionError(f"{where}: type {kind[:40]!r} is not supported. {instead}")
    ends = []
    for end in ("parent", "child"):
        found = element.find(end)
        link = "" if found is None else found.get("link", "")
        if link not in links:
            hint = did_you_mean(link, links, f'Write <{end} link="..">.')
            raise DescriptionError(f"{where}: its {end} {link[:60]!r} is not a link. {hint}")
        ends.append(link)
    limit = element.find("limit")
    given = {} if limit is None else limit.attrib
    if kind not in ("fixed", CONTINUOUS) and not given.keys() >= {"velocity", "effort"}:
        raise DescriptionError(
            f"{where}: its limits are not complete. "
            'Write <limit lower=".." upper=".." velocity=".." effort="..">.'
        )
    used = (*(_LIMITS[2:] if kind == CONTINUOUS else _LIMITS), *_RATES)
    limits = {key: float(given[key]) for key in used if key in given}
    follows = None if mimic is None else Mimic.read(where, mimic.attrib)
    figures = {**dict.fromkeys(_LIMITS), **limits}
    return UrdfJoint(name, kind, ends[0], ends[1], mimic=follows, **figures)


def _tree(links: tuple[str, ...], joints: tuple[UrdfJoint, ...]) -> tuple[str, frozenset[str]]:
    """Find the root and the links that move; refuse anything but one tree."""
    _unique("child link", (joint.child for joint in joints))
    carried = {joint.child for joint in joints}
    roots = [link for link in links if link not in carried]
    if len(roots) != 1:
        found = ", ".join(roots[:5]) or "none"
        raise DescriptionError(
            f"URDF: {len(roots)} links without a parent ({found:.200}). Join the links to one tree."
        )
    below: defaultdict[str, list[UrdfJoint]] = defaultdict(list)
    for joint in joints:
        below[joint.parent].append(joint)
    moves, ahead = {roots[0]: False}, list(roots)
    for link in ahead:  # which grows meanwhile
        for joint in below[link]:
            moves[joint.child] = moves[link] or joint.kind in MOVABLE
            ahead.append(joint.child)
    if len(moves) != len(links):
        raise DescriptionError(
            f"URDF: {len(links) - len(moves)} links form a loop apart from root {roots[0]!r}. "
            "Join the links to one tree."
        )
    return roots[0], frozenset(link for link, moving in moves.items() if moving)
