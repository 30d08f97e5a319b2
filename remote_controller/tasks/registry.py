"""Tasks by name: ours, those of installed packages, and the user's own by dotted path."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from pydantic import Field

from hoap3.protocol.config.plugins import PluginGroup, building
from hoap3.protocol.config.settings import RobotName, Settings, parse
from hoap3.protocol.errors import BadProblemError, ConfigError
from hoap3.protocol.robot.description import RobotDescription
from hoap3.remote_controller.model.kinematics import Kinematics
from hoap3.remote_controller.scheduling.priorities import distinct
from hoap3.remote_controller.tasks.accuracy import TaskError
from hoap3.remote_controller.tasks.derivative_check import check_derivatives
from hoap3.remote_controller.tasks.lyapunov import BuildContext, Level, LyapunovFunction

GROUP = "hoap3.tasks"
_OURS = "hoap3.remote_controller.tasks"
AXES = "xyz"
BUILTIN = {
    "com": f"{_OURS}.com:ComTask",
    "frame_position": f"{_OURS}.frames.frame_position:FramePositionTask",
    "frame_pose": f"{_OURS}.frames.frame_pose:FramePoseTask",
    "frame_orientation": f"{_OURS}.frames.frame_orientation:FrameOrientationTask",
    "posture": f"{_OURS}.posture:PostureTask",
    "weighted_sum": f"{_OURS}.weighted_sum:WeightedSum",
    "joint_curve": f"{_OURS}.curve_following.curve_following:JointCurve",
    "task_curve": f"{_OURS}.curve_following.curve_following:TaskCurve",
    "wrench": f"{_OURS}.accelerations.wrench:WrenchTask",
}
TASKS = PluginGroup(
    "task",
    GROUP,
    BUILTIN,
    (
        "hoap3.remote_controller.tasks.lyapunov:LyapunovFunction",
        "hoap3.remote_controller.tasks.task:Task",
    ),
    "extending",
)
registered, find = TASKS.registered, TASKS.find


class TaskSettings(Settings):
    """Which task, and its settings."""

    task: str = Field(description="registered name, or package.module:Class")
    parameters: dict[str, Any] = Field({}, description="settings of the task itself")
    tolerance: float | None = Field(
        None,
        gt=0,
        description="of a task of your own: greatest |e| at the end that counts as reached, in "
        "the unit of e; null: that of the class, or of its unit",
    )


class LabelledTask(TaskSettings):
    """A task, under a name of its own."""

    name: RobotName | None = Field(
        None, description="in priorities, log and commands; null: the task's"
    )

    @property
    def label(self) -> str:
        """The name by which people know it."""
        return self.name or self.task


@dataclass(frozen=True)
class FollowedTask:
    """One task of a controller.

    Attributes:
        name: of it.
        directions: names of the rows of its error; () where its Jacobian cannot be singular.
        rows: which rows of the controller's stacked errors, of those that are derivatives.
        accuracy: its errors at the last update.
        judged: whether it must reach its target; what is above one of lower priority may keep it.
    """

    name: str
    directions: tuple[str, ...]
    rows: slice
    accuracy: Callable[[], Sequence[TaskError]]
    judged: Callable[[], bool] = lambda: True


def labels_of(given: Sequence[LabelledTask]) -> list[str]:
    """Names of the tasks of a config.

    Raises:
        ConfigError: two have the same.
    """
    return distinct([task.label for task in given])


def check_parameters(
    settings: TaskSettings, file: str = "config", key: str = "task", level: Level = "velocity"
) -> Any:
    """The parsed parameters of a task; refuses what is wrong for any robot.

    Args:
        settings: what is wanted.
        file, key: where the settings stand, for errors.
        level: what the controller commands.

    Raises:
        UnknownNameError, ConfigError: see `find`; the task has no meaning at this level, or a
            parameter is wrong.
    """
    found = find(settings.task, file, f"{key}.task")
    if level not in found.levels:
        problem = f"asks for no {level}"
        remedy = f"Choose a controller of the {' or '.join(found.levels)} level, or another task"
        raise ConfigError(file, f"{key}.task", settings.task, problem, remedy)
    if settings.tolerance is not None and settings.task in BUILTIN:
        problem = "is for tasks of your own"
        remedy = "Give the tolerances of this task in its parameters"
        raise ConfigError(file, f"{key}.tolerance", settings.tolerance, problem, remedy)
    return parse(found.Parameters, settings.parameters, file, f"{key}.parameters")


def build(
    settings: TaskSettings,
    description: RobotDescription,
    kinematics: Kinematics,
    file: str = "config",
    key: str = "task",
    level: Level = "velocity",
) -> LyapunovFunction:
    """The configured task for a robot; of somebody else's, the derivatives are checked as well.

    Args:
        settings: what is wanted.
        description, kinematics: of the robot; a checked task leaves `kinematics` at its initial
            posture.
        file, key: where the settings stand, for errors. Other files are sought beside `file`.
        level: what the controller commands.

    Raises:
        UnknownNameError, ConfigError: it cannot be found, its parameters are wrong, the robot
            lacks a frame that they name, it cannot be built for this robot, or its gradient is
            not that of its value.
    """
    parameters = check_parameters(settings, file, key, level)
    found = find(settings.task, file, f"{key}.task")
    context = BuildContext(description, kinematics, file, f"{key}.parameters", level)
    keys = f"{key}.task", context.key
    with building(found, settings.task, description, parameters, file, *keys):
        try:
            function: LyapunovFunction = found.configured(context, parameters)
            function.parameters = parameters
            if settings.tolerance is not None:
                getattr(function, "task", function).tolerance = settings.tolerance
            if settings.task not in BUILTIN:
                at_name = BuildContext(description, kinematics, file, f"{key}.task")
                check_derivatives(function, at_name, settings.task)
        except BadProblemError as error:
            value = getattr(parameters, error.key, None)
            raise ConfigError("", error.key, value, str(error), "Correct them") from error
    return function


def build_with_error(
    settings: TaskSettings,
    description: RobotDescription,
    kinematics: Kinematics,
    file: str,
    key: str,
    level: Level = "velocity",
) -> LyapunovFunction:
    """A task that has an error, which a controller of several tasks needs; as `build`.

    Raises:
        ConfigError, UnknownNameError: it cannot be built, or gives V only.
    """
    function = build(settings, description, kinematics, file, key, level)
    if below := function.without_error():
        name: Any = settings.model_dump()
        for part in below.split("."):
            name = name[int(part) if part.isdigit() else part]
        problem = f"has no error e, only V: there is no {level} that it wants"
        raise ConfigError(file, f"{key}.{below}", name, problem, "Give it an error, or leave it")
    return function


def followed_task(
    name: str,
    settings: TaskSettings,
    rows: slice,
    accuracy: Callable[[], Sequence[TaskError]],
    base: str,
    judged: Callable[[], bool] = lambda: True,
) -> FollowedTask:
    """Return a configured task with the names of its rows, in its own axes.

    Args:
        name, rows, accuracy, judged: as of `FollowedTask`.
        settings: of the task.
        base: base frame of the robot.
    """
    directions = _directions(settings, rows.stop - rows.start, base)
    return FollowedTask(name, directions, rows, accuracy, judged)


def _directions(settings: TaskSettings, rows: int, base: str) -> tuple[str, ...]:
    kind, given = settings.task, settings.parameters
    turns = tuple(f"rotation about {axis} of the target" for axis in AXES)
    if kind == "frame_position":
        return tuple(
            f"{axis} of {given.get('reference') or base}" for axis in given.get("axes", AXES)
        )
    if kind == "com":
        return tuple(f"{axis} of {given.get('frame', 'r_sole')}" for axis in AXES)
    if kind == "frame_pose":
        return (*(f"{axis} of the target" for axis in AXES), *turns)
    if kind == "frame_orientation":
        return turns
    return () if kind == "posture" else tuple(f"row {row + 1}" for row in range(rows))
