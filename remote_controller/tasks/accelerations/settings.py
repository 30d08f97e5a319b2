"""Tasks as controllers of accelerations and torques have them in a config."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any, ClassVar, Self

from pydantic import Field, model_validator

from hoap3.protocol.config.changeable import CHANGEABLE
from hoap3.protocol.config.settings import Settings, parse, warn_renamed
from hoap3.protocol.errors import ConfigError
from hoap3.remote_controller.tasks.registry import LabelledTask

FORMER_KINDS = {
    "position": "frame_position",
    "pose": "frame_pose",
    "posture": "posture",
    "force": "wrench",
}
"""Tasks by what `kind` called them before 0.2, when their settings stood beside the gains."""
_TASK = re.compile(
    r"(?P<task>parameters\.tasks\.(?P<place>\d+))\.parameters(\.(?P<below>.*))?$", re.DOTALL
)
Triple = tuple[float, float, float]


class Gains(Settings):
    """Of a wanted acceleration kp·error − kd·velocity."""

    kp: float = Field(10.0, gt=0, description="of the error [1/s²]", json_schema_extra=CHANGEABLE)
    kd: float | None = Field(
        None,
        ge=0,
        description="[1/s]; null: 2√kp, critical damping",
        json_schema_extra=CHANGEABLE,
    )

    @property
    def both(self) -> tuple[float, float]:
        """Gains kp and kd."""
        return self.kp, 2.0 * math.sqrt(self.kp) if self.kd is None else self.kd


def critical_damping(parameters: Any, key: str) -> float | None:
    """What a kd that is null stands for, by its dotted key among parameters: 2√kp."""
    *place, name = key.split(".")
    if name != "kd":
        return None
    for part in place:
        parameters = parameters[int(part)] if part.isdigit() else getattr(parameters, part)
    return 2.0 * math.sqrt(parameters.kp)


class GoalSettings(Settings):
    """Where the frame shall be: at a pose, or where it is in a posture of the robot."""

    posture: str | None = Field(None, description="of the robot's description")
    posture_rad: tuple[float, ...] = Field((), description="instead: a posture itself [rad or m]")
    position_m: Triple | None = Field(None, description="or: the frame's origin")
    rotation_rad: Triple = Field((0.0, 0.0, 0.0), description="axis × angle of its orientation")
    reference: str | None = Field(
        None, description="frame in which the pose is given, which stands; null: the base frame"
    )

    @model_validator(mode="after")
    def _one_goal(self) -> Self:
        given = (self.posture is not None, bool(self.posture_rad), self.position_m is not None)
        if sum(given) != 1:
            raise ValueError("should have one of posture, posture_rad and position_m")
        return self


class AccelerationTask(LabelledTask, Gains):
    """A task that asks for an acceleration: ë = −kp·e − kd·ė."""

    hints: ClassVar = {"gain_per_s": "Accelerations have the gains kp [1/s²] and kd [1/s]"}

    @classmethod
    def with_todays_keys(cls, content: dict[str, Any], where: str = "config") -> dict[str, Any]:
        """From the form with a `kind`.

        Raises:
            ConfigError: with file "" and the key inside the task; it is neither form, or both.
        """
        if "kind" not in content:
            return content
        kind, known = content["kind"], ", ".join(FORMER_KINDS)
        for key in ("task", "parameters"):
            if key in content:
                problem = f"is the form before 0.2, and {key!r} beside it is today's"
                raise ConfigError("", "kind", kind, problem, "Leave out `kind`")
        if not isinstance(kind, str) or kind not in FORMER_KINDS:
            remedy = f"Write `task` and `parameters`; before 0.2 there were {known}"
            raise ConfigError("", "kind", kind, "no task was called that", remedy)
        task = FORMER_KINDS[kind]
        warn_renamed(
            where, f"`kind: {kind}` is `task: {task}` with its settings under `parameters` now"
        )
        own = {"name", "kp", "kd"}
        kept = {key: content[key] for key in content if key in own}
        settings = {key: content[key] for key in content if key not in own and key != "kind"}
        if kind == "pose":
            settings |= _taken_apart(settings.pop("goal", None), settings)
        if kind == "posture" and "posture_rad" in settings:
            settings |= _unlike(settings, {"target_rad": settings.pop("posture_rad")})
        return {**kept, "task": task, "parameters": settings}


def _taken_apart(goal: Any, beside: Mapping[str, Any]) -> dict[str, Any]:
    """What a former `goal` says, as parameters of `frame_pose`."""
    if goal is None:
        return {}
    if not isinstance(goal, dict):
        remedy = f"Write keys below it: {', '.join(GoalSettings.model_fields)}"
        raise ConfigError("", "goal", goal, "is not a mapping", remedy)
    parse(GoalSettings, goal, "", "goal")
    found = dict(goal)
    place = found.pop("position_m", None)
    if place is not None:
        found["target"] = {"kind": "point", "position_m": place}
    return _unlike(beside, found)


def _unlike(given: Mapping[str, Any], found: dict[str, Any]) -> dict[str, Any]:
    """What a former key says, of which nothing may stand beside it in today's words."""
    for key in found:
        if key in given:
            problem = "is there in the form before 0.2, too"
            raise ConfigError("", key, given[key], problem, "Leave one of them out")
    return found


@contextmanager
def told_as_written(parameters: Mapping[str, Any]) -> Iterator[None]:
    """Have errors of tasks in the form before 0.2 name the keys that the config has.

    Args:
        parameters: of a controller, as its config has them.
    """
    try:
        yield
    except ConfigError as error:
        told = _as_written(error, parameters)
        if told is error:
            raise
        raise told from error


def _as_written(error: ConfigError, parameters: Mapping[str, Any]) -> ConfigError:
    """The same error, of the keys that stand in a config."""
    found = _TASK.match(error.key)
    tasks = parameters.get("tasks")
    if not found or not isinstance(tasks, list) or int(found["place"]) >= len(tasks):
        return error
    task = tasks[int(found["place"])]
    if not isinstance(task, dict) or "kind" not in task:
        return error
    below, goal = found["below"] or "", task.get("goal") or {}
    if task["kind"] == "posture":
        below = re.sub(r"^target_rad\b", "posture_rad", below)
    elif below.startswith("target") and "position_m" in goal:
        below = "goal.position_m" + below.removeprefix("target").removeprefix(".position_m")
    elif below.partition(".")[0] in goal:
        below = f"goal.{below}"
    key = ".".join(filter(None, (found["task"], below)))
    text = error.problem, error.remedy, [_as_written(each, parameters) for each in error.others]
    return type(error)(error.file, key, error.value, *text)
