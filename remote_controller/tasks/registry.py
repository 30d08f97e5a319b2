"""Tasks by name: ours, those of installed packages, and the user's own by dotted path."""

from __future__ import annotations

from typing import Any

from pydantic import Field

from hoap3.protocol.config.settings import Settings, parse
from hoap3.protocol.description import RobotDescription
from hoap3.protocol.errors import BadProblemError, ConfigError
from hoap3.remote_controller.model.kinematics import Kinematics
from hoap3.remote_controller.plugins import PluginGroup, building
from hoap3.remote_controller.tasks.derivative_check import check_derivatives
from hoap3.remote_controller.tasks.lyapunov import BuildContext, LyapunovFunction

GROUP = "hoap3.tasks"
BUILTIN = {
    "com": "hoap3.remote_controller.tasks.com:ComTask",
    "frame_position": "hoap3.remote_controller.tasks.frame_position:FramePositionTask",
    "frame_pose": "hoap3.remote_controller.tasks.frame_pose:FramePoseTask",
    "posture": "hoap3.remote_controller.tasks.posture:PostureTask",
    "weighted_sum": "hoap3.remote_controller.tasks.weighted_sum:WeightedSum",
    "joint_curve": "hoap3.remote_controller.tasks.curve_following.curve_following:JointCurve",
    "task_curve": "hoap3.remote_controller.tasks.curve_following.curve_following:TaskCurve",
}
TASKS = PluginGroup(
    "task",
    GROUP,
    BUILTIN,
    (
        "hoap3.remote_controller.tasks.lyapunov:LyapunovFunction",
        "hoap3.remote_controller.tasks.task:Task",
    ),
    "docs/writing_a_task.md",
)
registered, find = TASKS.registered, TASKS.find


class TaskSettings(Settings):
    """Which task, and its settings."""

    task: str = Field(description="registered name, or package.module:Class")
    parameters: dict[str, Any] = Field({}, description="settings of the task itself")


def check_parameters(settings: TaskSettings, file: str = "config", key: str = "task") -> Any:
    """The parsed parameters of a task; refuses what is wrong for any robot.

    Raises:
        UnknownNameError, ConfigError: see `find`; or a parameter is wrong.
    """
    found = find(settings.task, file, f"{key}.task")
    return parse(found.Parameters, settings.parameters, file, f"{key}.parameters")


def build(
    settings: TaskSettings,
    description: RobotDescription,
    kinematics: Kinematics,
    file: str = "config",
    key: str = "task",
) -> LyapunovFunction:
    """The configured task for a robot; of somebody else's, the derivatives are checked as well.

    Args:
        settings: what is wanted.
        description, kinematics: of the robot; a checked task leaves `kinematics` at its initial
            posture.
        file, key: where the settings stand, for errors. Other files are sought beside `file`.

    Raises:
        UnknownNameError, ConfigError: it cannot be found, its parameters are wrong, the robot
            lacks a frame that they name, it cannot be built for this robot, or its gradient is
            not that of its value.
    """
    parameters = check_parameters(settings, file, key)
    found = find(settings.task, file, f"{key}.task")
    context = BuildContext(description, kinematics, file, f"{key}.parameters")
    keys = f"{key}.task", context.key
    with building(found, settings.task, description, parameters, file, *keys):
        try:
            function: LyapunovFunction = found.configured(context, parameters)
            if settings.task not in BUILTIN:
                at_name = BuildContext(description, kinematics, file, f"{key}.task")
                check_derivatives(function, at_name, settings.task)
        except BadProblemError as error:
            raise ConfigError("", "", None, str(error), "Correct them") from error
    return function
