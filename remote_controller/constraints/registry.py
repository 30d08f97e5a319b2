"""Constraints by name, and the stack that a config lists."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import EntryPoint
from typing import Any

from protocol.description import RobotDescription
from protocol.errors import ConfigError, FrameNotFoundError, Hoap3Error
from protocol.settings import Settings, parse
from remote_controller.constraints.constraint import Constraint
from remote_controller.constraints.stack import ConstraintStack
from remote_controller.kinematics import Kinematics
from remote_controller.plugins import Plugins, blame

GROUP = "hoap3.constraints"
_OURS = "remote_controller.constraints"
BUILTIN = {
    "joint_speed": f"{_OURS}.joint_speed:JointSpeed",
    "joint_position": f"{_OURS}.joint_position:JointPosition",
    "support_polygon": f"{_OURS}.support_polygon:SupportPolygon",
    "zmp": f"{_OURS}.zmp:Zmp",
    "distance": f"{_OURS}.distance:Distance",
    "frame_still": f"{_OURS}.frame_still:FrameStill",
    "half_space": f"{_OURS}.half_space:HalfSpace",
    "minimum_speed": f"{_OURS}.minimum_speed:MinimumSpeed",
    "pfaffian": f"{_OURS}.pfaffian:Pfaffian",
}
CONSTRAINTS: Plugins[Constraint] = Plugins(GROUP, "constraint", Constraint, BUILTIN)


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


def registered() -> dict[str, EntryPoint]:
    """Every constraint that can be named: ours, then those of installed packages."""
    return CONSTRAINTS.registered()


def find(name: str, file: str = "config", key: str = "constraint") -> type[Constraint]:
    """The class of a constraint.

    Raises:
        UnknownNameError: nobody registered it.
        ConfigError: it cannot be imported, or is not a constraint.
    """
    return CONSTRAINTS.find(name, file, key)


def read(
    entries: Sequence[Mapping[str, Any]],
    file: str = "config",
    key: str = "parameters.constraints",
) -> list[Entry]:
    """Check a list of constraints.

    Args:
        entries: mappings of `constraint`, a registered name or `package.module:Class`; `name`,
            optional; and the settings of that constraint.
        file, key: where the list stands, for errors.

    Raises:
        UnknownNameError, ConfigError: naming the entry, the key and the value.
    """
    found: list[Entry] = []
    for place, given in enumerate(entries):
        here = f"{key}.{place}"
        kind = given.get("constraint")
        if not isinstance(kind, str):
            remedy = f"Write one of {', '.join(registered())}, or package.module:Class"
            raise ConfigError(file, f"{here}.constraint", kind, "names no constraint", remedy)
        constraint = find(kind, file, f"{here}.constraint")
        settings = {
            name: value for name, value in given.items() if name not in {"constraint", "name"}
        }
        parameters = parse(constraint.Parameters, settings, file, here)
        found.append(Entry(here, _label(given, kind, found, file, here), constraint, parameters))
    return found


def build(
    entries: Sequence[Mapping[str, Any]],
    description: RobotDescription,
    kinematics: Kinematics,
    period_s: float,
    file: str = "config",
    key: str = "parameters.constraints",
) -> ConstraintStack:
    """The constraints of a list, for a robot.

    Args:
        entries, file, key: as for `read`.
        description, kinematics: of the robot; `kinematics` may be moved.
        period_s: T, for which u is held [s].

    Raises:
        UnknownNameError, ConfigError: what `read` refuses, or what does not fit the robot or the
            period.
    """
    checked = read(entries, file, key)
    made = [_made(entry, description, kinematics, period_s, file) for entry in checked]
    return ConstraintStack(made, [entry.label for entry in checked], description.n)


def _made(
    entry: Entry,
    description: RobotDescription,
    kinematics: Kinematics,
    period_s: float,
    file: str,
) -> Constraint:
    try:
        return entry.constraint(entry.parameters, description, kinematics, period_s)
    except FrameNotFoundError as error:
        path = _path_to(error.frame, entry.parameters.model_dump())
        problem = f"robot {description.name!r} has no such frame"
        remedy = f"Its frames: {', '.join(error.known)}"
        place = ".".join([entry.key, *path])
        raise ConfigError(file, place, error.frame, problem, remedy) from error
    except ConfigError as error:
        place = f"{entry.key}.{error.key}".rstrip(".")
        raise ConfigError(file, place, error.value, error.problem, error.remedy) from error
    except Hoap3Error:
        raise
    except Exception as error:
        raise ConfigError(
            file,
            entry.key,
            entry.label,
            f"cannot be built for robot {description.name!r} with {description.n} joints: "
            f"{blame(error, entry.constraint)}",
            "Correct it, or choose a robot that it is made for",
        ) from error


def _label(
    given: Mapping[str, Any], kind: str, before: Sequence[Entry], file: str, key: str
) -> str:
    taken = {entry.label for entry in before}
    name = given.get("name")
    if name is None:
        name, number = kind, 1
        while name in taken:
            number += 1
            name = f"{kind} {number}"
    if not isinstance(name, str) or not name:
        raise ConfigError(file, f"{key}.name", name, "is no name", "Write some text")
    if name in taken:
        raise ConfigError(file, f"{key}.name", name, "is taken", "Choose another name")
    return name


def _path_to(value: object, content: object) -> list[str]:
    """Keys under which a value stands in nested settings; none if it does not."""
    if isinstance(content, Mapping):
        parts = [(str(key), inner) for key, inner in content.items()]
    elif isinstance(content, list | tuple):
        parts = [(str(place), inner) for place, inner in enumerate(content)]
    else:
        return []
    for key, inner in parts:
        if inner == value:
            return [key]
        path = _path_to(value, inner)
        if path:
            return [key, *path]
    return []
