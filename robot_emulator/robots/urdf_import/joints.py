"""The joints of a vendor's URDF, as they can travel: kinds, limits, what is guessed."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from xml.etree import ElementTree as ET

import numpy as np

from hoap3.protocol.errors import ConfigError, DescriptionError, did_you_mean, one_of
from hoap3.protocol.robot.pinocchio_model import moved_origin
from hoap3.protocol.robot.urdf import Mimic, resolve
from hoap3.robot_emulator.robots.urdf_import.figures import figure, triple, written
from hoap3.robot_emulator.robots.urdf_import.names import joint_names
from hoap3.robot_emulator.robots.urdf_import.notes import Notes

SPEED = {"revolute": 1.0, "continuous": 1.0, "prismatic": 0.1}
"""Greatest speed where none is given [rad/s, m/s]: slow enough to be safe to watch."""
UNIT = {"revolute": "rad/s", "continuous": "rad/s", "prismatic": "m/s"}
RATES = ("acceleration", "deceleration", "jerk")  # of <limit>, since URDF 1.2
HARD = ("hard_lower", "hard_upper")  # of <limit>, after soft limits have taken their place
ENDLESS = 1e4  # rad; exporters write such limits for joints that turn without end
WELDED = {"floating", "planar", "spherical", "ball"}
ROOM = 1e-6  # rad or m between its limits: a joint with less cannot move
NO_ROOM = "locked, because lower and upper of their <limit> are equal"
NO_RANGE = "locked, because a prismatic joint needs lower and upper of <limit>, in m"
CONSTANT = "locked, because their <mimic> has a multiplier of 0"
ASKED = "locked, as asked"
AFTER_OTHERS = "fixed, because they follow a fixed joint"


@dataclass(frozen=True)
class ReadJoint:
    """A joint that moves, and what nobody gave of it.

    Attributes:
        name: under which it travels.
        kind: `revolute`, `continuous` or `prismatic`.
        guessed: of velocity, range; what no file says.
        velocity: greatest speed, given or guessed [rad/s or m/s].
        follows: the joint that moves it, or None.
        stops: where its usable range is narrower than they are; None: it is not [rad or m].
        rates: of `RATES`, what is given.
    """

    name: str
    kind: str
    guessed: tuple[str, ...]
    velocity: float
    follows: str | None
    stops: tuple[float, float] | None
    rates: frozenset[str]


def read_joints(
    robot: ET.Element, notes: Notes, lock: Sequence[str] = ()
) -> tuple[list[ET.Element], list[ReadJoint]]:
    """The joints as they can travel, and those of them that move, in the order of the file.

    Args:
        robot: of the vendor's URDF.
        notes: takes what was found.
        lock: joints that become fixed, each as NAME or NAME=VALUE [rad or m].

    Raises:
        ConfigError: there is no such joint to lock, or not there.
        DescriptionError: a joint cannot be what the file says; names it.
    """
    elements = robot.findall("joint")
    for element in elements:
        if not element.get("name"):
            raise DescriptionError("URDF: a <joint> without a name. Give it one.")
    stated = [str(element.get("name")) for element in elements]
    renamed = joint_names(stated, notes)
    locked = _locked(lock, elements, renamed, notes)
    kinds = _kinds(elements, locked, notes)
    made, read = [], []
    for element, name, kind in zip(elements, stated, kinds, strict=True):
        where = f"URDF joint {name!r:.80}"
        new = ET.Element("joint", name=renamed[name], type=kind)
        for tag, keep in (("origin", ("xyz", "rpy")), ("parent", ("link",)), ("child", ("link",))):
            copy_attributes(element.find(tag), new, keep)
        if locked.get(name):
            _move_origin(element, new, locked[name], where)
        if kind != "fixed":
            read.append(_moving(element, new, where, renamed, notes))
        made.append(new)
    unknown = {each.name for each in read if each.follows and "velocity" in each.guessed}
    relax_mimic_limits(made, unknown, notes)
    return made, read


def copy_attributes(of: ET.Element | None, into: ET.Element, keep: tuple[str, ...]) -> None:
    """Add a copy of an element with some of its attributes, as they are written."""
    if of is not None:
        ET.SubElement(into, of.tag, {key: of.attrib[key] for key in keep if key in of.attrib})


def _locked(
    lock: Sequence[str], elements: list[ET.Element], renamed: dict[str, str], notes: Notes
) -> dict[str, float]:
    """Return where joints are locked [rad or m], by stated name: as asked, or without room."""
    moving = {_name(each): each for each in elements if each.get("type") != "fixed"}
    known = {**{renamed[name]: name for name in moving}, **{name: name for name in moving}}
    asked: dict[str, float | None] = {}
    for text in lock:
        name, _, value = (text, "", "") if text in known else text.rpartition("=")
        if name not in known:
            remedy = f"Write NAME or NAME=VALUE. {one_of(name or text, known, 'Joints')}"
            raise ConfigError("--lock-joint", "", text, "names no joint that moves", remedy)
        given = ET.Element("joint", {"value": value} if value else {})
        asked[known[name]] = figure(given, "value", f"--lock-joint {text:.80}")
    found = {}
    for name, element in moving.items():
        lower, upper = _room(element)
        if name in asked or lower == upper:
            at = asked.get(name)
            at = float(np.clip(0.0, lower, upper)) if at is None else at
            if not (lower <= at <= upper and math.isfinite(at)):
                remedy = f"Write {lower:g} to {upper:g}"
                raise ConfigError("--lock-joint", name, at, "is beyond its limits", remedy)
            found[name] = at
            follows = element.find("mimic") is not None
            if name in asked:
                text = ASKED + (", and following no other joint any more" if follows else "")
            elif follows:
                text = CONSTANT
            else:
                has_range = any(_given(element, key) for key in ("lower", "upper"))
                text = NO_ROOM if has_range else NO_RANGE
            notes.add("read" if name in asked else "left out", text, f"{name} at {at:g}")
    return found


def _given(joint: ET.Element, key: str) -> bool:
    limit = joint.find("limit")
    return limit is not None and key in limit.attrib


def _room(joint: ET.Element) -> tuple[float, float]:
    """Return between which positions a joint can be [rad or m]; the same ones if it is stuck."""
    limit, mimic, kind = joint.find("limit"), joint.find("mimic"), joint.get("type", "")
    where = f"URDF joint {_name(joint)!r:.80}"
    if mimic is not None and figure(mimic, "multiplier", where) == 0.0:
        offset = figure(mimic, "offset", where) or 0.0
        return offset, offset
    lower, upper = (figure(limit, key, where) or 0.0 for key in ("lower", "upper"))
    limited = kind == "prismatic" or (kind == "revolute" and (lower or upper))
    is_stuck = upper - lower <= ROOM
    if not limited or lower > upper or (is_stuck and mimic is not None):
        return -math.inf, math.inf
    return lower, lower if is_stuck else upper


def _move_origin(element: ET.Element, new: ET.Element, value: float, where: str) -> None:
    """Put a joint's origin where its position brings what it carries."""
    origin, axis = new.find("origin"), element.find("axis")
    origin = ET.SubElement(new, "origin") if origin is None else origin
    xyz, rpy = (triple(origin, key, where, 0.0) for key in ("xyz", "rpy"))
    along = np.array([1.0, 0.0, 0.0]) if axis is None else triple(axis, "xyz", where, 1.0)
    twist = np.zeros((2, 3))
    twist[int(element.get("type") != "prismatic")] = value * along / (np.linalg.norm(along) or 1.0)
    for key, values in zip(("xyz", "rpy"), moved_origin(xyz, rpy, twist.ravel()), strict=True):
        origin.set(key, written(values))


def _kinds(elements: list[ET.Element], locked: dict[str, float], notes: Notes) -> list[str]:
    """What each joint is here: a free base is welded, mimic joints of fixed joints are fixed."""
    kinds = ["fixed" if _name(each) in locked else each.get("type", "") for each in elements]
    _weld_base(elements, kinds, notes)
    by_name = {element.get("name"): number for number, element in enumerate(elements)}
    changed = True
    while changed:  # a mimic joint may be followed itself
        changed = False
        for number, element in enumerate(elements):
            mimic, name = element.find("mimic"), _name(element)
            if mimic is None or kinds[number] == "fixed":
                continue
            mimicked, where = str(mimic.get("joint")), f"URDF joint {name!r:.80}"
            if kinds[by_name.get(mimicked, number)] == "fixed":
                ratio, offset = (figure(mimic, key, where) for key in ("multiplier", "offset"))
                ratio = 1.0 if ratio is None else ratio
                value = ratio * locked.get(mimicked, 0.0) + (offset or 0.0)
                notes.add("read", AFTER_OTHERS, f"{name} at {value:g}" if value else name)
                kinds[number], locked[name], changed = "fixed", value, True
    return kinds


def _weld_base(elements: list[ET.Element], kinds: list[str], notes: Notes) -> None:
    """Fix joints without one coordinate where only what is fixed carries them; refuse others."""
    carriers = {_end(each, "child"): (_end(each, "parent"), i) for i, each in enumerate(elements)}
    for number, (element, kind) in enumerate(zip(elements, kinds, strict=True)):
        if kind in SPEED or kind == "fixed":
            continue
        where = f"URDF joint {_name(element)!r:.80}"
        if kind not in WELDED:
            known = (*SPEED, "fixed", "floating", "planar")
            hint = did_you_mean(kind, known, "Write revolute, continuous, prismatic or fixed.")
            raise DescriptionError(f"{where}: there is no type {kind[:40]!r}. {hint}")
        link = _end(element, "parent")
        for _ in elements:  # upwards, at most once through all
            if link not in carriers:
                break
            link, above = carriers[link]
            if kinds[above] not in {"fixed", *WELDED}:
                raise DescriptionError(
                    f"{where}: {kind} within the robot, not at its base: it would take several "
                    "coordinates. Write revolute and prismatic joints instead, one after another, "
                    "or lock it with --lock-joint."
                )
        text = f"welded, because the base stands still here: {kind} joint of the base"
        notes.add("left out", text, _name(element))
        kinds[number] = "fixed"


def _end(joint: ET.Element, tag: str) -> str:
    """The link at its end `parent` or `child`."""
    found = joint.find(tag)
    return "" if found is None else found.get("link", "")


def _name(joint: ET.Element) -> str:
    return joint.get("name", "")


def _moving(
    element: ET.Element, new: ET.Element, where: str, renamed: dict[str, str], notes: Notes
) -> ReadJoint:
    name = new.attrib["name"]
    axis = element.find("axis")
    if axis is not None and not triple(axis, "xyz", where, 1.0).any():
        raise DescriptionError(f"{where}: <axis> is zero. Write its direction, as 0 0 1.")
    copy_attributes(axis, new, ("xyz",))
    limit = element.find("limit")
    mimic = element.find("mimic")
    guessed = []
    lower, upper = _range(new, limit, where, notes, mimic_joint=mimic is not None)
    bounds = {} if lower is None else {"lower": repr(lower), "upper": repr(upper)}
    if mimic is None and new.attrib["type"] != element.get("type"):
        guessed.append("range")
    velocity = figure(limit, "velocity", where) or 0.0
    if not 0.0 < velocity < math.inf:
        velocity = SPEED[new.attrib["type"]]
        guessed.append("velocity")
        if mimic is None:
            unit = UNIT[new.attrib["type"]]
            text = f"velocity {velocity:g} {unit}, because none is given (or 0)"
            notes.add("guessed", text, name)
    effort = figure(limit, "effort", where) or 0.0
    if not 0.0 < effort < math.inf:
        effort = 0.0
        if mimic is None:
            text = "no effort is given (or 0), so that the robot takes no torques"
            notes.add("left out", text, name)
    given = {} if limit is None else limit.attrib
    rates = {key: given[key] for key in RATES if key in given}
    limits = bounds | {"velocity": repr(velocity), "effort": repr(effort)} | rates
    ET.SubElement(new, "limit", limits)
    hard = [float(given[key]) for key in HARD if key in given]
    copy_attributes(element.find("dynamics"), new, ("damping", "friction"))
    follows = None
    if mimic is not None:
        copy_attributes(mimic, new, ("joint", "multiplier", "offset"))
        follows = renamed.get(mimic.get("joint", ""))
        if follows is None:
            hint = did_you_mean(mimic.get("joint", ""), renamed, 'Write <mimic joint="..">.')
            raise DescriptionError(
                f"{where}: follows {mimic.get('joint')!r:.60}, which is no joint. {hint}"
            )
        new[-1].set("joint", follows)
        notes.add("read", "mimic joints (<mimic>): they have no setpoint of their own", name)
    stops, kind = (hard[0], hard[1]) if hard else None, new.attrib["type"]
    return ReadJoint(name, kind, tuple(guessed), velocity, follows, stops, frozenset(rates))


def _range(
    new: ET.Element, limit: ET.Element | None, where: str, notes: Notes, *, mimic_joint: bool
) -> tuple[float | None, float | None]:
    """Its limits, or None of both where it has none; makes it continuous there.

    A missing limit is 0, as the format says, if the other one is given. Where neither is, or both
    are 0 as exporters leave them, they are not set. An angle has two limits or none: one
    beyond `ENDLESS` is that where the other one is a stop.
    """
    kind, name = new.attrib["type"], new.attrib["name"]
    if kind == "continuous":
        if limit is not None and {"lower", "upper"} & limit.attrib.keys():
            notes.add("left out", "lower and upper of continuous joints", name)
        return None, None
    lower, upper = (figure(limit, key, where) or 0.0 for key in ("lower", "upper"))
    wrong = _what_is_wrong(lower, upper, kind)
    if kind == "revolute" and lower > upper and 0.0 in {lower, upper} and not mimic_joint:
        text = "turns without end, because its limits are reversed: Bullet's way to write no limit"
        notes.add("guessed", text, f"{name} ({lower:g} to {upper:g})")
        new.set("type", "continuous")
        return None, None
    if wrong and not mimic_joint:
        raise DescriptionError(f"{where}: its limits {wrong}")
    if wrong:
        notes.add("left out", AGAINST_MIMICKED, name)
        lower = upper = 0.0
    if kind == "revolute" and max(-lower, upper) >= ENDLESS > min(-lower, upper):
        text = f"a limit of {ENDLESS:g} rad, because one beyond is given, and the other is a stop"
        notes.add("guessed", text, name)
        return max(lower, -ENDLESS), min(upper, ENDLESS)
    most = ENDLESS if kind == "revolute" else math.inf
    if lower < upper and max(-lower, upper) < most:
        return lower, upper
    if kind == "revolute" and mimic_joint:
        new.set("type", "continuous")  # its mimicked joint's range is its own
        return None, None
    if kind == "revolute":
        text = "turns without end, because no limits are given (or 0 0, or both beyond 10000 rad)"
        notes.add("guessed", text, name)
        new.set("type", "continuous")
        return None, None
    if mimic_joint:
        return None, None
    raise DescriptionError(
        f'{where}: prismatic, and without a range. Write its <limit lower=".." upper="..">, in m.'
    )


def _what_is_wrong(lower: float, upper: float, kind: str) -> str | None:
    """Why no joint could keep such limits, and what would do; None of both 0, as of others."""
    if lower > upper:
        remedy = "Correct them" + (", or make it continuous." if kind == "revolute" else ", in m.")
        return f"are reversed, lower {lower:g} and upper {upper:g}: no limit to Bullet. {remedy}"
    if lower == upper != 0.0:  # of a mimic joint: others are locked
        return f"leave it no range, both are {lower:g}. Widen them, or make it fixed."
    if kind == "revolute" and (lower >= ENDLESS or upper <= -ENDLESS):
        return f"leave it no angle below {ENDLESS:g} rad. Write them in rad, near 0."
    return None


AGAINST_MIMICKED = "the range of mimic joints that would leave their mimicked joints none"
AMPLE = 2.0  # times what its mimicked joint gives it: a velocity that bounds nothing

Range = tuple[float, float]


def relax_mimic_limits(joints: list[ET.Element], without_velocity: set[str], notes: Notes) -> None:
    """Remove limits of mimic joints that would narrow their mimicked joint's by mistake.

    These are a velocity that the file does not give, and a range that contradicts the mimicked
    joint's, for example by a missing sign.

    Args:
        joints: all of them, as they can travel; changed.
        without_velocity: names of the mimic joints whose velocity the file does not give.
        notes: takes what was found.

    Raises:
        DescriptionError: a joint follows what does not move, or itself.
    """
    moving = {joint.attrib["name"]: joint for joint in joints if joint.get("type") != "fixed"}
    mimic_joints = resolve({name: _mimic(joint) for name, joint in moving.items()})
    left = {name: _limits(joint) for name, joint in moving.items()}
    for name, mimic_joint in mimic_joints.items():
        joint, mimicked = moving[name], mimic_joint.mimicked
        both = _intersection(left[mimicked], mimic_joint.mimicked_range(*_limits(joint)))
        if both[0] < both[1]:
            left[mimicked] = both
        else:
            _drop_range(joint)
            notes.add("left out", AGAINST_MIMICKED, name)
        if name in without_velocity:
            limit = moving[mimicked].find("limit")
            speed = figure(limit, "velocity", f"URDF joint {mimicked!r:.80}") or 0.0
            for own in joint.findall("limit"):
                own.set("velocity", repr(AMPLE * abs(mimic_joint.multiplier) * speed))


def _mimic(joint: ET.Element) -> Mimic | None:
    mimic = joint.find("mimic")
    if mimic is None:
        return None
    where = f"URDF joint {joint.get('name')!r:.80}"
    for key in ("multiplier", "offset"):
        if not math.isfinite(figure(mimic, key, where) or 0.0):
            raise DescriptionError(f"{where}: <mimic {key}> is not finite. Write a number.")
    return Mimic.read(where, mimic.attrib)


def _limits(joint: ET.Element) -> Range:
    limit, name = joint.find("limit"), f"URDF joint {joint.get('name')!r:.80}"
    lower, upper = (figure(limit, key, name) for key in ("lower", "upper"))
    return -math.inf if lower is None else lower, math.inf if upper is None else upper


def _intersection(one: Range, other: Range) -> Range:
    return max(one[0], other[0]), min(one[1], other[1])


def _drop_range(joint: ET.Element) -> None:
    """A mimic joint goes where its mimicked joint brings it."""
    for limit in joint.findall("limit"):
        limit.attrib.pop("lower", None)
        limit.attrib.pop("upper", None)
    if joint.get("type") == "revolute":
        joint.set("type", "continuous")
