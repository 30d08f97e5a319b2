"""Settings of `tsid`: the tasks or one goal, the posture of the null space, and the bounds."""

from __future__ import annotations

from typing import Any, Self

import numpy as np
from pydantic import Field, model_validator

from hoap3.protocol.errors import ConfigError, located, one_of
from hoap3.protocol.robot.description import COM, RobotDescription
from hoap3.remote_controller.controllers.acceleration.settings import HierarchyParameters
from hoap3.remote_controller.default_task import default_goal
from hoap3.remote_controller.model.kinematics import Kinematics
from hoap3.remote_controller.references.postures import PostureValues, posture_of
from hoap3.remote_controller.scheduling.weights import WeightSettings
from hoap3.remote_controller.tasks.accelerations.settings import (
    AccelerationTask,
    Gains,
    GoalSettings,
)
from hoap3.remote_controller.tasks.accelerations.standing import check_stands
from hoap3.remote_controller.tasks.accuracy import (
    TOLERANCE_DEG,
    TOLERANCE_M,
    ToleranceDeg,
    ToleranceM,
)
from hoap3.remote_controller.tasks.frames.frame_pose import FramePoseTask

POSE, REST = "pose", "rest"
"""What the task of `goal` is called, and the posture."""


class PostureSettings(PostureValues, Gains):
    """What the joints do where the tasks leave them free."""

    posture: str | None = Field(
        None, description="q_r, one of the robot's description; null: where it starts"
    )
    posture_rad: tuple[float, ...] = Field((), description="instead: q_r itself [rad or m]")
    weight: float = Field(
        1e-3,
        gt=0,
        description="w of (33), beside a task's 1; a smaller w is more exact, the elbow drifts",
    )


class Parameters(HierarchyParameters):
    """Problem (33), part by part."""

    tasks: tuple[AccelerationTask, ...] | None = Field(  # type: ignore[assignment]
        None, min_length=1, description="what shall be; null: one pose, that of `goal`"
    )
    frame: str | None = Field(
        None, description="frame that shall get there; null: that of the robot's default task"
    )
    goal: GoalSettings | None = Field(
        None,
        description="where it shall be; null: where the robot's default task has it, with the "
        "orientation that it has at the start",
    )
    tolerance_m: ToleranceM = TOLERANCE_M
    tolerance_deg: ToleranceDeg = TOLERANCE_DEG
    task: Gains = Field(Gains(), description="of the frame's acceleration")
    posture: PostureSettings = Field(PostureSettings(), description="of the null space")
    priorities: WeightSettings = Field(
        WeightSettings(), description="weights of the tasks beside each other"
    )

    @model_validator(mode="after")
    def _one_way(self) -> Self:
        if self.tasks is not None and (self.frame is not None or self.goal is not None):
            raise ValueError("should have either tasks, or frame and goal")
        if self.frame is None and self.goal is not None:
            raise ValueError("has a goal, but no frame that shall get there: add `frame`")
        return self


def with_all_tasks(robot: RobotDescription, given: Parameters) -> Parameters:
    """The parameters with their goal, and their posture, as tasks.

    Raises:
        ConfigError: a frame, a goal or a posture that does not fit the robot; a task has the name
            of the posture.
    """
    tasks = given.tasks
    if tasks is None:
        frame = given.frame
        if frame is not None and frame not in robot.frames:
            remedy = one_of(frame, robot.frames, "Its frames")
            raise ConfigError("", "frame", frame, "the robot has no such frame", remedy)
        if given.goal is not None and frame is not None:
            wanted = _pose_of(robot, given.goal)
        else:
            frame, wanted = _default_pose(robot, frame)
        wanted |= {"tolerance_m": given.tolerance_m, "tolerance_deg": given.tolerance_deg}
        tasks = (_task(POSE, "frame_pose", {"frame": frame, **wanted}, given.task),)
    for i, task in enumerate(tasks):
        if task.label == REST:
            problem = "is what the posture is called"
            raise ConfigError("", f"tasks.{i}.name", REST, problem, "Give the task another name")
    rest = given.posture
    target = posture_of(robot, rest.posture, rest.posture_rad, "posture.posture").tolist()
    tasks += (_task(REST, "posture", {"target_rad": target}, rest),)
    return given.model_copy(update={"tasks": tasks})


def weights_of(given: Parameters) -> WeightSettings:
    """Weights of the tasks, and of the posture."""
    weights = {**given.priorities.weights, REST: given.posture.weight}
    return given.priorities.model_copy(update={"weights": weights})


def _task(name: str, task: str, parameters: dict[str, Any], gains: Gains) -> AccelerationTask:
    kp, kd = gains.both
    return AccelerationTask(name=name, task=task, parameters=parameters, kp=kp, kd=kd)


def _pose_of(robot: RobotDescription, goal: GoalSettings) -> dict[str, Any]:
    """A goal as parameters of `frame_pose`."""
    with located("", "goal"):
        if goal.position_m is None:
            posture_of(robot, goal.posture, goal.posture_rad, "posture")
            return {"posture": goal.posture, "posture_rad": goal.posture_rad}
        check_stands(robot, goal.reference or robot.base_frame, "reference")
    target = {"kind": "point", "position_m": goal.position_m}
    return {"reference": goal.reference, "target": target, "rotation_rad": goal.rotation_rad}


def _default_pose(robot: RobotDescription, frame: str | None) -> tuple[str, dict[str, Any]]:
    """The robot's default task with the orientation of its initial posture; its frame, the rest."""
    goal = default_goal(robot, "goal", frame)
    if goal.point == COM:
        problem = f"is missing, and the default task of {robot.name!r} is for its centre of mass"
        raise ConfigError("", "goal", None, problem, "Name a frame and a goal for it")
    check_stands(robot, goal.reference, "goal")
    kinematics, pose = Kinematics(robot), np.zeros(6)
    task = FramePoseTask(kinematics, goal.point, goal.reference, pose)
    kinematics.update(robot.initial_position)
    task.read(kinematics, pose)
    target = {"kind": "point", "position_m": goal.target_m}
    turn = tuple(pose[3:].tolist())
    return goal.point, {"reference": goal.reference, "target": target, "rotation_rad": turn}
