"""The limits of joints that follow others (<mimic>), where they bound more than was meant.

The limits of a follower narrow its master's. Two kinds of them must not: a velocity that nobody
gave, and a range that contradicts the master's, as where a sign was forgotten.
"""

from __future__ import annotations

import math
from xml.etree import ElementTree as ET

from hoap3.protocol.errors import DescriptionError
from hoap3.protocol.urdf_followers import Mimic, resolve
from hoap3.robot_emulator.robots.urdf_import.figures import figure
from hoap3.robot_emulator.robots.urdf_import.notes import Notes

AGAINST_MASTER = "the range of followers that would leave their masters none"
AMPLE = 2.0  # times what its master gives it: a velocity that bounds nothing

Range = tuple[float, float]


def relax_followers(joints: list[ET.Element], without_velocity: set[str], notes: Notes) -> None:
    """Take away what the followers' limits would take from their masters by mistake.

    Args:
        joints: all of them, as they can travel; changed.
        without_velocity: names of the followers whose velocity nobody gave.
        notes: takes what was found.

    Raises:
        DescriptionError: a joint follows what does not move, or itself.
    """
    moving = {joint.attrib["name"]: joint for joint in joints if joint.get("type") != "fixed"}
    followers = resolve({name: _mimic(joint) for name, joint in moving.items()})
    left = {name: _range(joint) for name, joint in moving.items()}
    for name, follower in followers.items():
        joint, master = moving[name], follower.master
        both = _intersection(left[master], follower.seen_by_master(*_range(joint)))
        if both[0] < both[1]:
            left[master] = both
        else:
            _drop_range(joint)
            notes.add("left out", AGAINST_MASTER, name)
        if name in without_velocity:
            limit = moving[master].find("limit")
            speed = figure(limit, "velocity", f"URDF joint {master!r:.80}") or 0.0
            for own in joint.findall("limit"):
                own.set("velocity", repr(AMPLE * abs(follower.ratio) * speed))


def _mimic(joint: ET.Element) -> Mimic | None:
    mimic = joint.find("mimic")
    if mimic is None:
        return None
    where = f"URDF joint {joint.get('name')!r:.80}"
    for key in ("multiplier", "offset"):
        if not math.isfinite(figure(mimic, key, where) or 0.0):
            raise DescriptionError(f"{where}: <mimic {key}> is not finite. Write a number.")
    return Mimic.read(where, mimic.attrib)


def _range(joint: ET.Element) -> Range:
    limit, name = joint.find("limit"), f"URDF joint {joint.get('name')!r:.80}"
    lower, upper = (figure(limit, key, name) for key in ("lower", "upper"))
    return -math.inf if lower is None else lower, math.inf if upper is None else upper


def _intersection(one: Range, other: Range) -> Range:
    return max(one[0], other[0]), min(one[1], other[1])


def _drop_range(joint: ET.Element) -> None:
    """A follower goes where its master brings it."""
    for limit in joint.findall("limit"):
        limit.attrib.pop("lower", None)
        limit.attrib.pop("upper", None)
    if joint.get("type") == "revolute":
        joint.set("type", "continuous")
