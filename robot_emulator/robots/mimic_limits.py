"""How far a joint may go, and how fast, so that its mimic joints stay within their own limits.

A mimic joint at q_f = r·q + c keeps l ≤ q_f ≤ u where q is between (l − c)/r and (u − c)/r, and its
speed v where |dq| ≤ v/|r|. Its effort bounds nothing: the motor is the mimicked joint's.
"""

from __future__ import annotations

import math

from hoap3.protocol.errors import DescriptionError
from hoap3.protocol.robot.description import RobotDescription
from hoap3.protocol.robot.urdf import UrdfStructure


def limits_with_mimic_joints(structure: UrdfStructure, name: str) -> dict[str, float]:
    """The limits of a joint by <limit> of the URDF, narrowed by those of its mimic joints.

    Returns:
        `lower`, `upper` [rad or m], `velocity` [rad/s or m/s] and `effort` [N m or N], as far as
        the URDF has them.

    Raises:
        DescriptionError: no position suits a joint and its mimic joints.
    """
    limits, by = _own(structure, name), {"lower": name, "upper": name}
    for mimic_joint in structure.mimic_joints.values():
        if mimic_joint.mimicked == name:
            for key, value in _mimicked_limits(structure, mimic_joint.name).items():
                tighter = max if key == "lower" else min
                if key not in limits or tighter(value, limits[key]) != limits[key]:
                    limits[key], by[key] = value, mimic_joint.name
    lower, upper = limits.get("lower"), limits.get("upper")
    if lower is not None and upper is not None and not lower < upper and by["lower"] != by["upper"]:
        raise DescriptionError(
            f"joint {name!r}: with its mimic joints it cannot move: from {lower} by the limits of "
            f"{by['lower']!r} to {upper} by those of {by['upper']!r}. Correct one of them."
        )
    return limits


def mimic_joint_notes(robot: RobotDescription) -> list[str]:
    """Notes on the limits of mimicked joints, a line for each joint.

    They name limits that mimic joints narrow compared with the URDF, and limits of the robot's file
    that exceed those of its mimic joints.
    """
    structure, notes = robot.structure, []
    for joint in robot.joints:
        led = [each.name for each in structure.mimic_joints.values() if each.mimicked == joint.name]
        own = _own(structure, joint.name)
        told = []
        for key, left in (limits_with_mimic_joints(structure, joint.name) if led else {}).items():
            if key == "effort":  # mimic joints leave it as it is
                continue
            used = getattr(joint, key)
            if used == left != own.get(key):
                told.append(f"{key} {left:.6g} instead of {_said(own.get(key))}")
            elif (used < left) if key == "lower" else (used > left):
                told.append(f"{key} {used:.6g}, where they may go to {left:.6g} only")
        if told:
            notes.append(f"joint {joint.name!r}, with {', '.join(led)}: {'; '.join(told)}")
    return notes


def _said(limit: float | None) -> str:
    return "none" if limit is None else f"{limit:.6g}"


def _own(structure: UrdfStructure, name: str) -> dict[str, float]:
    joint = structure.moved[name]
    limits = {key: getattr(joint, key) for key in ("lower", "upper", "velocity", "effort")}
    return {key: value for key, value in limits.items() if value is not None}


def _mimicked_limits(structure: UrdfStructure, name: str) -> dict[str, float]:
    """What a mimic joint's limits leave its mimicked joint."""
    mimic_joint, own = structure.mimic_joints[name], _own(structure, name)
    lower, upper = mimic_joint.mimicked_range(
        own.get("lower", -math.inf), own.get("upper", math.inf)
    )
    seen = {key: end for key, end in (("lower", lower), ("upper", upper)) if math.isfinite(end)}
    if "velocity" in own:
        seen["velocity"] = own["velocity"] / abs(mimic_joint.multiplier)
    return seen
