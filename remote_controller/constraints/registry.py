"""Constraints by name, and the stack that a config lists."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from pydantic import Field

from hoap3.protocol.config.plugins import PluginGroup, building
from hoap3.protocol.config.settings import Settings, parse
from hoap3.protocol.errors import ConfigError, located
from hoap3.protocol.messages import FloatArray
from hoap3.protocol.robot.description import RobotDescription
from hoap3.remote_controller.constraints.acceleration_stack import MOST, AccelerationStack
from hoap3.remote_controller.constraints.constraint import Constraint, Level
from hoap3.remote_controller.constraints.constraint_validation import check_first_update
from hoap3.remote_controller.constraints.stack import ConstraintStack
from hoap3.remote_controller.model.kinematics import Kinematics

GROUP = "hoap3.constraints"
_OURS = "hoap3.remote_controller.constraints"
BUILTIN = {
    "joint_velocity": f"{_OURS}.joints.joint_velocity:JointVelocity",
    "joint_position": f"{_OURS}.joints.joint_position:JointPosition",
    "joint_acceleration": f"{_OURS}.joints.joint_acceleration:JointAcceleration",
    "joint_torque": f"{_OURS}.joints.joint_torque:JointTorque",
    "viability": f"{_OURS}.joints.viability:Viability",
    "support_polygon": f"{_OURS}.support.support_polygon:SupportPolygon",
    "zmp": f"{_OURS}.support.zmp:Zmp",
    "friction_cone": f"{_OURS}.support.friction_cone:FrictionCone",
    "distance": f"{_OURS}.collision.distance:Distance",
    "fixed_frame": f"{_OURS}.frames.fixed_frame:FixedFrame",
    "half_space": f"{_OURS}.frames.half_space:HalfSpace",
    "minimum_speed": f"{_OURS}.frames.minimum_speed:MinimumSpeed",
    "user_function": f"{_OURS}.user_function:UserFunction",
    "pfaffian": f"{_OURS}.pfaffian:Pfaffian",
}
CONSTRAINTS = PluginGroup(
    "constraint",
    GROUP,
    BUILTIN,
    ("hoap3.remote_controller.constraints.constraint:Constraint",),
    "extending",
)
registered, find = CONSTRAINTS.registered, CONSTRAINTS.find
WORDS: dict[Level, str] = {"velocity": "velocities", "acceleration": "accelerations"}


class ConstraintSettings(Settings):
    """One entry of a config's list of constraints."""

    constraint: str = Field(description="registered name, or package.module:Class")
    name: str | None = Field(
        None,
        min_length=1,
        description="of its rows, conditions and events; null: the constraint's own",
    )
    parameters: dict[str, Any] = Field({}, description="settings of the constraint itself")


@dataclass(frozen=True)
class Entry:
    """One line of a config's list of constraints, checked as far as it can be without a robot.

    Attributes:
        key: where it stands, such as "parameters.constraints.0".
        label: its `name`, else the constraint's own, with a number from the second one on.
        constraint: its class.
        parameters: a `Parameters` of that class.
    """

    key: str
    label: str
    constraint: type[Constraint]
    parameters: Settings


def read(
    entries: Sequence[ConstraintSettings], file: str = "config", key: str = "parameters.constraints"
) -> list[Entry]:
    """Check a list of constraints, as far as it can be without a robot.

    Args:
        entries: what is wanted.
        file, key: where the list stands, for errors.

    Raises:
        UnknownNameError, ConfigError: naming the entry, the key and the value.
    """
    found: list[Entry] = []
    for place, given in enumerate(entries):
        here = f"{key}.{place}"
        constraint = find(given.constraint, file, f"{here}.constraint")
        parameters = parse(constraint.Parameters, given.parameters, file, f"{here}.parameters")
        taken = {entry.label for entry in found}
        if given.name in taken:
            raise ConfigError(file, f"{here}.name", given.name, "is taken", "Choose another name")
        label = given.name or _numbered(given.constraint, taken)
        found.append(Entry(here, label, constraint, parameters))
    return found


def build(
    entries: Sequence[ConstraintSettings],
    description: RobotDescription,
    kinematics: Kinematics,
    period_s: float,
    file: str = "config",
    key: str = "parameters.constraints",
) -> ConstraintStack:
    """The constraints of a list, for a robot; somebody else's are also tried once.

    Args:
        entries, file, key: as for `read`.
        description, kinematics: of the robot; `kinematics` may be moved.
        period_s: T, for which u is held [s].

    Raises:
        UnknownNameError, ConfigError: what `read` refuses, or what does not fit the robot or the
            period, or gives no numbers of the right shape in the initial posture.
    """
    made, labels, _ = _make(entries, description, kinematics, period_s, file, key, "velocity")
    return ConstraintStack(made, labels, description.n)


def build_accelerations(
    entries: Sequence[ConstraintSettings],
    description: RobotDescription,
    kinematics: Kinematics,
    period_s: float,
    file: str = "config",
    key: str = "parameters.constraints",
    brake: FloatArray | float = np.inf,
    ranges: tuple[FloatArray | float, FloatArray | float] = (-np.inf, np.inf),
) -> AccelerationStack:
    """The same for a controller of accelerations or torques.

    Args:
        entries, file, key: as for `read`.
        description, kinematics: of the robot; `kinematics` is moved, now and by each update.
        period_s: T, for which q̈ is held [s].
        brake, ranges: as of `AccelerationStack`.

    Raises:
        UnknownNameError, ConfigError: as `build`, or there are more than 63.
    """
    if len(entries) > MOST:
        problem, remedy = f"has {len(entries)} constraints", f"Give {MOST} at most"
        raise ConfigError(file, key, None, problem, remedy)
    made, labels, keys = _make(
        entries, description, kinematics, period_s, file, key, "acceleration"
    )
    return AccelerationStack(made, labels, keys, description, kinematics, file, brake, ranges)


def _make(
    entries: Sequence[ConstraintSettings],
    description: RobotDescription,
    kinematics: Kinematics,
    period_s: float,
    file: str,
    key: str,
    level: Level,
) -> tuple[list[Constraint], list[str], list[str]]:
    """Constraints that serve a level, their labels, and where their parameters stand."""
    checked = read(entries, file, key)

    def made(entry: Entry) -> Constraint:
        found, given = entry.constraint, entry.parameters
        keys = f"{entry.key}.constraint", f"{entry.key}.parameters"
        with building(found, entry.label, description, given, file, *keys):
            return found(given, description, kinematics, period_s)

    for given, entry in zip(entries, checked, strict=True):
        place = f"{entry.key}.constraint"
        if not entry.constraint.serves(level):
            problem = f"says nothing about {WORDS[level]}"
            raise ConfigError(file, place, given.constraint, problem, _remedy(entry, level))
        if given.constraint not in BUILTIN:
            one = made(entry), description, kinematics
            with located(file, f"{entry.key}.parameters"):
                check_first_update(*one, file, place, given.constraint, level)
    parameters = [f"{entry.key}.parameters" for entry in checked]
    return [made(entry) for entry in checked], [entry.label for entry in checked], parameters


def _remedy(entry: Entry, level: Level) -> str:
    """What to do about a constraint that does not serve a level."""
    if "acceleration" in entry.constraint.levels and level == "acceleration":
        return "Have the class write its margins in look, rather than in update"
    if entry.constraint.levels == ("acceleration",):
        return "Take a controller of accelerations or torques, or leave it out"
    if entry.constraint.__module__.startswith(_OURS):
        return "Take a controller of velocities, or leave it out"
    return "Give the class update_accelerations and levels, or take a controller of velocities"


def _numbered(name: str, taken: set[str]) -> str:
    """The name, with a number if it is taken."""
    label, number = name, 1
    while label in taken:
        number += 1
        label = f"{name} {number}"
    return label
