"""The centre of mass at a point (QP12, section V)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from hoap3.protocol.messages import FloatArray
from hoap3.remote_controller.model.kinematics import Kinematics
from hoap3.remote_controller.references.settings import TargetSettings, target_of
from hoap3.remote_controller.references.trajectories.trajectory_settings import AXES, tolerances_of
from hoap3.remote_controller.tasks.accuracy import TOLERANCE_M, TaskError, ToleranceM, length_error
from hoap3.remote_controller.tasks.lyapunov import BuildContext
from hoap3.remote_controller.tasks.task import Task
from hoap3.remote_controller.tasks.task_function import TaskFunction


class ComTask(Task):
    """e = m(q) − m_d: centre of mass as seen from a frame, less its target [m].

    Args:
        kinematics: of the robot.
        frame: name of the frame, such as the sole that stands on the ground.
        target: m_d, (3,) [m], in that frame.

    Raises:
        FrameNotFoundError: the robot has no such frame.
    """

    class Parameters(Task.Parameters):
        """Where the centre of mass shall be."""

        frame: str = Field("r_sole", description="frame that it is seen from")
        target: TargetSettings | None = Field(
            None, description="target position in that frame; null: its position at the start"
        )
        tolerance_m: ToleranceM = TOLERANCE_M

    def __init__(self, kinematics: Kinematics, frame: str, target: FloatArray) -> None:
        super().__init__(3, kinematics.n)
        self._frame = kinematics.frame_id(frame)
        self._scratch = np.zeros_like(self.jacobian)
        self.position = np.zeros(3)
        self.target[:] = target
        self.tolerance_m = TOLERANCE_M

    @classmethod
    def configured(cls, context: BuildContext, parameters: Parameters) -> TaskFunction:
        """V of this task."""
        task = cls(context.kinematics, parameters.frame, np.zeros(3))
        task.apply(parameters)
        target = target_of(parameters.target, context.folder)
        tolerances = tolerances_of(parameters.target, target, AXES, "m")
        return TaskFunction(task, target, parameters.weights, tolerances)

    def apply(self, parameters: Any) -> None:
        """Read the tolerance."""
        self.tolerance_m = parameters.tolerance_m

    def update(self, kinematics: Kinematics) -> None:
        """Recompute e [m] and J [m/rad]."""
        kinematics.com(self._frame, self.position, self.jacobian)
        np.subtract(self.position, self.target, out=self.error)

    def accuracy(self, asked: NDArray[np.bool_]) -> list[TaskError]:
        """Distance to the target."""
        return length_error(self.error[asked], self.tolerance_m)

    def read(self, kinematics: Kinematics, out: FloatArray) -> None:
        """Write m(q), (3,) [m]."""
        kinematics.com(self._frame, out, self._scratch)
