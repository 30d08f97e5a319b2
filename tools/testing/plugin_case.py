"""A task or a constraint that a property suite runs over."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, Self, TypeVar

from hoap3.protocol.config.settings import Settings, load_yaml, parse
from hoap3.protocol.robot.description import RobotDescription
from hoap3.robot_emulator.robots import load

Entry = TypeVar("Entry", bound=Settings)


@dataclass(frozen=True)
class PluginCase(Generic[Entry]):
    """What it is, and for which robot.

    Attributes:
        label: what its tests are called by.
        robot: description of the robot.
        settings: its entry in a config.
        file: where that stands, for errors.
    """

    label: str
    robot: RobotDescription
    settings: Entry
    file: str

    @classmethod
    def named(cls, name: str, robot: str, settings: type[Entry], key: str) -> Self:
        """One that a file says, or a name.

        Args:
            name: a YAML file with an entry as a config has it, `package.module:Class`, or a
                registered name.
            robot: a name, or the path of a description.
            settings, key: model of the entry, and its key for the name: `task` or `constraint`.
        """
        path, description = Path(name), load(robot)
        if path.suffix not in {".yaml", ".yml"}:
            return cls(name, description, parse(settings, {key: name}, name), f"{key} {name}")
        folder = str(path.resolve().parent)
        if folder not in sys.path:
            sys.path.append(folder)
        content: dict[str, Any] = load_yaml(path)
        return cls(path.name, description, parse(settings, content, name), name)
