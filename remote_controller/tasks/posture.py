"""The joints in a posture."""

from __future__ import annotations

from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from hoap3.protocol.errors import ConfigError
from hoap3.protocol.messages import FloatArray
from hoap3.protocol.robot.description import RobotDescription
from hoap3.remote_controller.model.kinematics import Kinematics
from hoap3.remote_controller.references.live.live_settings import LivePostureSettings
from hoap3.remote_controller.references.postures import PostureValues, posture_of
from hoap3.remote_controller.references.settings import PostureTarget
from hoap3.remote_controller.references.target import Approach, Point
from hoap3.remote_controller.tasks.accuracy import (
    TOLERANCE_DEG,
    TOLERANCE_M,
    JointToleranceDeg,
    JointToleranceM,
    TaskError,
    joint_errors,
    prismatic_joints,
)
from hoap3.remote_controller.tasks.lyapunov import BuildContext
from hoap3.remote_controller.tasks.task import Task
from hoap3.remote_controller.tasks.task_function import TaskFunction


class PostureTask(Task):
    """e = q − q_d, of all joints or of some [rad or m]; J = I, or its rows of these joints.

    Args:
        kinematics: of the robot.
        joints: (m,) places of the joints in wire order.
        target: q_d, (m,) [rad or m].
    """

    class Parameters(PostureValues, Task.Parameters):
        """Which posture."""

        values_key = "target_rad"

        posture: str | None = Field(
            None, description="one of the robot's description; null: where the robot starts"
        )
        target_rad: tuple[float, ...] = Field(
            (), description="instead: q_d of `joints`, or of all joints [rad or m]"
        )
        target: PostureTarget | None = Field(
            None,
            description="or a motion, whose joints that it does not name stay where they are; or "
            "`kind: live`: somebody steers it",
        )
        joints: tuple[str, ...] = Field((), description="which joints; empty: all, in wire order")
        approach_s: float = Field(
            0.0, ge=0, description="duration of the way there [s]; 0: at once"
        )
        tolerance_deg: JointToleranceDeg = TOLERANCE_DEG
        tolerance_m: JointToleranceM = TOLERANCE_M

        @model_validator(mode="after")
        def _one_posture(self) -> Self:
            given = self.posture is not None, bool(self.target_rad), self.target is not None
            if sum(given) > 1:
                raise ValueError("should have one of posture, target_rad and target")
            if self.target is not None and self.approach_s:
                raise ValueError("should have approach_s of a trajectory below target")
            return self

    def __init__(self, kinematics: Kinematics, joints: list[int], target: FloatArray) -> None:
        super().__init__(len(joints), kinematics.n)
        self._all = np.zeros(kinematics.n)
        self._joints = np.array(joints, np.intp)
        self.jacobian[np.arange(len(joints)), self._joints] = 1.0
        self.target[:] = target
        self.prismatic = np.zeros(len(joints), np.bool_)
        self.tolerances = TOLERANCE_M, TOLERANCE_DEG

    @classmethod
    def configured(cls, context: BuildContext, parameters: Parameters) -> TaskFunction:
        """V of this task."""
        robot, aim = context.description, parameters.target
        joints = places_of(robot, parameters.joints)
        target = positions_of(robot, parameters, joints)
        task = cls(context.kinematics, joints, target)
        task.prismatic = prismatic_joints(robot)[joints]
        task.apply(parameters)
        if aim is None:
            point = Approach(Point(target), parameters.approach_s)
            return TaskFunction(task, point, parameters.weights)
        names, units = ([of[i] for i in joints] for of in (robot.joint_names, robot.joint_units))
        if isinstance(aim, LivePostureSettings):
            steered = aim.build(robot.lower[joints], robot.upper[joints], names, units)
            return TaskFunction(task, steered, parameters.weights)
        path = aim.posture(context.folder, robot, joints)
        tolerances = aim.tolerances(path, names, units)
        return TaskFunction(task, path, parameters.weights, tolerances)

    def apply(self, parameters: Any) -> None:
        """Read the tolerances."""
        self.tolerances = parameters.tolerance_m, parameters.tolerance_deg

    def update(self, kinematics: Kinematics) -> None:
        """Recompute e [rad or m]."""
        self.read(kinematics, self.error)
        np.subtract(self.error, self.target, out=self.error)

    def accuracy(self, asked: NDArray[np.bool_]) -> list[TaskError]:
        """The greatest error of any joint."""
        return joint_errors(self.error[asked], self.prismatic[asked], *self.tolerances)

    def read(self, kinematics: Kinematics, out: FloatArray) -> None:
        """Write q of the joints, (m,) [rad or m]."""
        kinematics.joints(self._all)
        np.take(self._all, self._joints, out=out)


def places_of(robot: RobotDescription, names: tuple[str, ...]) -> list[int]:
    """Places of joints in wire order; of all where none is named.

    Raises:
        ConfigError: a joint is named twice, or the robot does not have it.
    """
    known = list(robot.joint_names)
    for name in names:
        if name not in known or names.count(name) > 1:
            problem = "is named twice" if name in known else "is no joint of this robot"
            remedy = f"Its joints: {', '.join(known)}"
            raise ConfigError("", "joints", name, problem, remedy)
    return [known.index(name) for name in names or known]


def positions_of(
    robot: RobotDescription, parameters: PostureTask.Parameters, joints: list[int]
) -> FloatArray:
    """q_d of the joints at these places, (m,) [rad or m].

    Raises:
        ConfigError: no such posture, or too many values or too few.
    """
    given = parameters.target_rad
    if len(given) == len(joints):
        return np.array(given)
    if given and len(given) != robot.n:
        problem, remedy = f"has {len(given)} values", f"Give {len(joints)}, one for each joint"
        raise ConfigError("", "target_rad", None, problem, remedy)
    return posture_of(robot, parameters.posture, given, "posture")[joints]
