"""Robots by name or by path: a folder each, with `robot.yaml` and a URDF, or a vendor's URDF.

Other distributions add robots through the entry-point group `hoap3.robots`; the entry point is the
path of such a folder or YAML file, or a callable that returns a `RobotDescription`.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Sequence
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path

from hoap3.protocol.config.plugins import blame
from hoap3.protocol.errors import (
    ConfigError,
    Hoap3Error,
    NotInstalledError,
    UnknownNameError,
    UrdfWarning,
)
from hoap3.protocol.robot.description import RobotDescription
from hoap3.robot_emulator.robots.urdf_import.source import DESCRIPTIONS, is_source, split_arguments
from hoap3.robot_emulator.robots.yaml_file import read_robot

__all__ = ["GROUP", "available", "find_file", "load", "load_configured"]

GROUP = "hoap3.robots"
FILE = "robot.yaml"

_FOLDER = Path(__file__).parent


def available() -> list[str]:
    """Names that `load` knows: shipped robots, and those of other distributions."""
    return sorted(_shipped() | entry_points(group=GROUP).names)


def load(
    name_or_path: str | Path, *, tip: str | None = None, lock_joints: Sequence[str] = ()
) -> RobotDescription:
    """Describe a robot.

    Args:
        name_or_path: a name of `available()`, a folder with a `robot.yaml`, or a YAML file. A name
            comes before a folder of the same name; write `./name` for the folder. Or a vendor's
            URDF or xacro file, or `robot_descriptions:NAME`, with arguments of xacro behind it,
            `FILE NAME:=VALUE`; what was guessed of it is said by an `UrdfWarning` each.
        tip: of a vendor's file: the link that the default task moves; None: the likeliest tool.
        lock_joints: of such a file: joints that become fixed, each as NAME or NAME=VALUE.

    Raises:
        UnknownNameError: neither a known name nor a path; carries the nearest name.
        ConfigError: a file is missing, or wrong; carries the key, the value and a remedy.
        DescriptionError: the robot's figures or its URDF do not hold together.
        NotInstalledError: the robot needs a library that is not installed.
    """
    if is_source(name_or_path):
        return _imported(name_or_path, tip, lock_joints)
    for option, value in (("--tip", tip), ("--lock-joint", (*lock_joints, None)[0])):
        if value is not None:
            remedy = "Import its URDF with this option, or edit its robot.yaml"
            raise ConfigError(option, "", value, f"is for URDF files, not {name_or_path}", remedy)
    if isinstance(name_or_path, str):
        if name_or_path in _shipped():
            return read_robot(_FOLDER / name_or_path / FILE)
        for entry in entry_points(group=GROUP, name=name_or_path):
            return _third_party(entry)
    path = Path(name_or_path)
    is_path = isinstance(name_or_path, Path) or "/" in name_or_path
    if not is_path and path.suffix not in {".yaml", ".yml"} and not os.path.exists(path):
        hint = " Or write the path of a folder, of a YAML file or of a URDF."
        raise UnknownNameError("robot", str(name_or_path), available(), hint)
    return read_robot(path / FILE if os.path.isdir(path) else path)


def load_configured(
    name: str, file: str, tip: str | None = None, lock_joints: Sequence[str] = ()
) -> RobotDescription:
    """`load` of what the key `robot` of a config names; that there is none is said of that key.

    Raises:
        UsageError: as of `load`.
    """
    path = split_arguments(name)[0]
    if "/" in path and not path.startswith(DESCRIPTIONS) and not os.path.exists(path):
        remedy = "Name a robot's folder, its YAML file or a URDF; paths count from the config"
        raise ConfigError(file, "robot", name, "no such file or folder", remedy)
    try:
        return load(name, tip=tip, lock_joints=lock_joints)
    except NotInstalledError:
        raise
    except UnknownNameError as error:
        raise UnknownNameError(error.kind, name, error.known, f" ({file}: robot)") from error


def find_file(name_or_path: str | Path) -> Path | None:
    """The YAML file that `load` reads, or None where it reads none."""
    if isinstance(name_or_path, str):
        if name_or_path in _shipped():
            return _FOLDER / name_or_path / FILE
        if name_or_path in entry_points(group=GROUP).names:
            return None
    path = Path(name_or_path)
    if is_source(name_or_path):
        return None
    return path / FILE if os.path.isdir(path) else path


def _imported(name: str | Path, tip: str | None, lock_joints: Sequence[str]) -> RobotDescription:
    """The robot of a vendor's URDF; each finding is a warning, which Python shows once."""
    from hoap3.robot_emulator.robots.urdf_import.imported import import_robot

    found = import_robot(name, tip=tip, lock_joints=lock_joints)
    for note in found.notes:
        warnings.warn(f"{found.source.path.name}: {note}", UrdfWarning, stacklevel=1)
    return found.description


def _shipped() -> set[str]:
    return {path.parent.name for path in _FOLDER.glob(f"*/{FILE}")}


def _third_party(entry: EntryPoint) -> RobotDescription:
    where = f"entry point {entry.name} of {GROUP}"
    try:
        robot = entry.load()
        if callable(robot):
            robot = robot()
    except Hoap3Error:
        raise
    except (Exception, SystemExit) as error:  # nobody else may end us
        remedy = "Correct the entry point, or reinstall the distribution that declares it"
        problem = f"cannot be loaded: {blame(error)}"
        raise ConfigError(where, "", entry.value, problem, remedy) from error
    if isinstance(robot, RobotDescription):
        return robot
    if isinstance(robot, str | Path):
        return read_robot(Path(robot) / FILE if Path(robot).is_dir() else Path(robot))
    remedy = "Return a RobotDescription, or give the path of a robot's folder or YAML file"
    raise ConfigError(where, "", robot, "is not a robot", remedy)
