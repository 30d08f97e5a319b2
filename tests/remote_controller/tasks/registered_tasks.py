"""Which tasks the property suite runs over.

Every registered task is a case: ours with the parameters of `task_cases`, those of installed
packages with their defaults. `HOAP3_TEST_TASKS` names others instead: files with `task` and
`parameters`, `package.module:Class`, or registered names, separated by commas; `HOAP3_TEST_ROBOT`
another robot than HOAP-3 for them.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

import task_cases

from hoap3.protocol.config.settings import load_yaml, parse
from hoap3.protocol.description import RobotDescription
from hoap3.remote_controller.model.kinematics import Kinematics
from hoap3.remote_controller.tasks.lyapunov import LyapunovFunction
from hoap3.remote_controller.tasks.registry import TaskSettings, build, find, registered
from hoap3.robot_emulator.robots import load


def _file(name: str) -> tuple[TaskSettings, str]:
    """A task that a file or a name says, and where that stands."""
    if Path(name).suffix not in {".yaml", ".yml"}:
        return TaskSettings(task=name), f"task {name}"
    folder = str(Path(name).resolve().parent)
    if folder not in sys.path:
        sys.path.append(folder)
    return parse(TaskSettings, load_yaml(Path(name)), name), name


def velocity_tasks() -> list[str]:
    """Registered tasks that have a V."""
    return [name for name in sorted(registered()) if "velocity" in find(name).levels]


def _cases() -> dict[str, tuple[RobotDescription, TaskSettings, str]]:
    named = [name.strip() for name in os.environ.get("HOAP3_TEST_TASKS", "").split(",")]
    named = [name for name in named if name]
    ours = {
        case: (robot, TaskSettings(task=name, parameters=parameters), case)
        for case, (robot, name, parameters) in task_cases.CASES.items()
    }
    if not named:
        known = {settings.task for _, settings, _ in ours.values()}
        named = [name for name in velocity_tasks() if name not in known]
    else:
        ours = {}
    robot = load(os.environ.get("HOAP3_TEST_ROBOT", "hoap3")) if named else task_cases.HOAP3
    return {**ours, **{name: (robot, *_file(name)) for name in named}}


CASES = _cases()


def make(case: str) -> tuple[RobotDescription, Kinematics, LyapunovFunction]:
    """The robot, kinematics of its own, and a new V."""
    robot, settings, file = CASES[case]
    kinematics = Kinematics(robot)
    return robot, kinematics, build(settings, robot, kinematics, file)
