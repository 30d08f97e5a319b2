"""Describes the robot of a vendor's URDF: what it says, and named defaults where it says nothing.

====================  ============================================================================
no velocity, or 0     1 rad/s, or 0.1 m/s: slow enough to stand beside
its accelerations     that speed within 0.2 s, for setpoints and for braking
no acceleration       250/s times the velocity, and 10/s times it for braking
no limits, or 0 0     a revolute joint turns without end; a prismatic one is locked
no effort, or 0       none: the robot takes no torques
no inertia            only positions are commanded, where nothing that moves has one
start posture         `zero`: each joint at 0, or at the limit nearest to it
default task          the tool moves by 5 % of its reach, at least 1 cm, see `tip`
====================  ============================================================================
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hoap3.protocol.config.wrong_settings import NAME_PATTERN
from hoap3.protocol.errors import ConfigError, DescriptionError
from hoap3.protocol.robot.description import CommandKind, RobotDescription
from hoap3.protocol.robot.rigid_body_dynamics import Dynamics
from hoap3.robot_emulator.robots.urdf_import.joints import ReadJoint
from hoap3.robot_emulator.robots.urdf_import.notes import Note, Notes
from hoap3.robot_emulator.robots.urdf_import.sanitize import Sanitized, sanitize
from hoap3.robot_emulator.robots.urdf_import.source import Source, read_source
from hoap3.robot_emulator.robots.urdf_import.tip import default_task, reach
from hoap3.robot_emulator.robots.yaml_file import (
    BRAKE_RATE,
    SETPOINT_RATE,
    DefaultTaskEntry,
    JointEntry,
    RobotFile,
    describe,
)

RISE_S = 0.2  # within which a guessed speed is reached, and lost again


@dataclass(frozen=True)
class ImportedRobot:
    """A robot that was made of a vendor's URDF.

    Attributes:
        source: the URDF.
        parts: the URDF that travels, and what stays here.
        file: what its `robot.yaml` says.
        description: what controllers are told.
        notes: what was read, guessed and left out.
    """

    source: Source
    parts: Sanitized
    file: RobotFile
    description: RobotDescription
    notes: tuple[Note, ...]


def import_robot(
    name: str | Path,
    package_path: Sequence[Path] = (),
    *,
    called: str | None = None,
    strict: bool = False,
    tip: str | None = None,
    lock_joints: Sequence[str] = (),
) -> ImportedRobot:
    """Make a robot of a vendor's URDF.

    Args:
        name: a URDF or xacro file, or `robot_descriptions:NAME`.
        package_path: folders in which `package://` is looked for first.
        called: the robot's name; by default as near to the stated one as can be.
        strict: a mesh that cannot be found or read is an error.
        tip: the link that the default task moves; None: see `tip`.
        lock_joints: joints that become fixed, each as NAME or NAME=VALUE [rad or m].

    Raises:
        ConfigError: a file cannot be read, or there is no such tip, or no such joint to lock.
        DescriptionError: something in it cannot be what it says; names the link or the joint.
        NotInstalledError: it needs a library that is not installed.
    """
    if called is not None and not re.fullmatch(NAME_PATTERN, called):
        remedy = "Write a small letter, then at most 31 small letters, digits and _"
        raise ConfigError("--name", "", called, "is no name for the network", remedy)
    try:
        source, notes = read_source(name, package_path), Notes()
        parts = sanitize(source, notes, called, lock_joints, strict=strict)
        file = RobotFile(name=parts.name, urdf=f"{parts.name}.urdf", joints=_entries(parts, notes))
        robot = describe(file, parts.urdf)
        file = file.model_copy(update={"command_kinds": _commands(robot, notes)})
        robot = describe(file, parts.urdf)
        file = file.model_copy(update={"default_task": _task(robot, notes, tip)})
        robot = describe(file, parts.urdf)
        _note_the_rest(parts, robot, notes)
    except DescriptionError as error:
        raise DescriptionError(f"{name}: {error}") from error
    return ImportedRobot(source, parts, file, robot, notes.all)


def _entries(parts: Sanitized, notes: Notes) -> tuple[JointEntry, ...]:
    """The joints with a setpoint, in the order of the file."""
    return tuple(_entry(joint, notes) for joint in parts.joints if joint.follows is None)


def _entry(joint: ReadJoint, notes: Notes) -> JointEntry:
    given: dict[str, Any] = {"name": joint.name, "guessed": joint.guessed}
    if joint.stops is not None:
        given |= zip(("lower_hard", "upper_hard"), joint.stops, strict=True)
    if "acceleration" in joint.rates:
        return JointEntry(**given)
    brakes = "" if "deceleration" in joint.rates else f", {BRAKE_RATE:g}/s to brake"
    text = f"accelerations of {SETPOINT_RATE:g}/s times the velocity{brakes}"
    if "velocity" in joint.guessed:
        text = f"accelerations that reach that velocity within {RISE_S:g} s, and brake as fast"
        given["setpoint_acceleration_max"] = joint.velocity / RISE_S
        if "deceleration" not in joint.rates:
            given["brake_acceleration"] = joint.velocity / RISE_S
    notes.add("guessed", text, joint.name)
    return JointEntry(**given | {"guessed": (*joint.guessed, "acceleration")})


def _commands(robot: RobotDescription, notes: Notes) -> tuple[CommandKind, ...]:
    """What the robot can take, by what is known of it."""
    if not robot.structure.weighs:
        notes.add("left out", "nothing that moves has a mass: positions are all that it takes")
        return ("position",)
    try:
        Dynamics(robot).check_forward(robot.initial_position)
    except DescriptionError as error:
        notes.add("left out", f"no accelerations and torques: {str(error).partition('. ')[0]}")
        return ("position",)
    if not all(map(math.isfinite, robot.effort)):
        return ("position", "acceleration")
    return ("position", "acceleration", "torque")


def _task(robot: RobotDescription, notes: Notes, tip: str | None) -> DefaultTaskEntry | None:
    task = default_task(robot, tip)
    if task is None:
        notes.add("left out", "no default task, because no joint moves the origin of a link")
        return None
    move = task.move_m or (0.0, 0.0, 0.0)
    x, y, z = move
    far, whole = math.hypot(*move), reach(robot, task.point)
    share = f", {far / whole:.1%} of its reach of {whole:.3g} m" if whole else ""
    text = (
        f"default task: {task.point!r}, the tool, moves by {x:g}, {y:g}, {z:g} m ({far:.3g} m"
        f"{share}), to where its joints can bring it"
    )
    notes.add("guessed", text)
    return DefaultTaskEntry(**task.model_dump())


def _note_the_rest(parts: Sanitized, robot: RobotDescription, notes: Notes) -> None:
    moving = [link for link in parts.massless if link in parts.structure.moving]
    if moving and robot.structure.weighs:
        notes.add("read", "links that move and weigh nothing", *moving)
    away = [
        f"{joint.name} at {start:g}"
        for joint, start in zip(robot.joints, robot.initial_position.tolist(), strict=True)
        if start != 0.0
    ]
    text = "start posture: all joints at 0" + (", or at the limit nearest to it" if away else "")
    notes.add("guessed", text, *away)
