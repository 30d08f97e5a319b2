"""A frame's axes in an orientation, wherever its origin is."""

from __future__ import annotations

from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from hoap3.protocol.messages import FloatArray
from hoap3.remote_controller.model.kinematics import Kinematics
from hoap3.remote_controller.references.live.live_settings import LiveOrientationSettings
from hoap3.remote_controller.references.target import Approach, Hold, Point
from hoap3.remote_controller.tasks.accuracy import (
    TOLERANCE_DEG,
    TaskError,
    ToleranceDeg,
    angle_error,
)
from hoap3.remote_controller.tasks.lyapunov import BuildContext
from hoap3.remote_controller.tasks.task import Task
from hoap3.remote_controller.tasks.task_function import TaskFunction


class FrameOrientationTask(Task):
    """e = log(R_dᵀR) in SO(3): rotation vector [rad] from the target's axes to the frame's.

    The lower half of `frame_pose`, with the same derivatives: |e| ≤ π, J is exactly ∂e/∂q, and at
    half a turn status says `at_antipode`.

    Args:
        kinematics: of the robot.
        frame, reference: names.
        target: (3,) rotation vector of R_d (axis × angle [rad]), in the reference's axes.

    Raises:
        FrameNotFoundError: the robot has no such frame.
    """

    class Parameters(Task.Parameters):
        """Which frame, and how it shall be turned."""

        frame: str = Field(description="frame that shall be turned so")
        reference: str | None = Field(
            None, description="frame that it is seen from; null: the base frame"
        )
        rotation_rad: tuple[float, float, float] | None = Field(
            None,
            description="axis × angle of its orientation, in that frame [rad]; null: as it is at "
            "the start",
        )
        target: LiveOrientationSettings | None = Field(
            None, description="or `kind: live`: somebody turns it, by quaternions in that frame"
        )
        turn_s: float = Field(
            0.0, ge=0, description="duration of the turn from where it is [s]; 0: at once"
        )
        tolerance_deg: ToleranceDeg = TOLERANCE_DEG

        @model_validator(mode="after")
        def _one_goal(self) -> Self:
            if self.target is not None and (self.rotation_rad is not None or self.turn_s):
                raise ValueError("should have one of target and rotation_rad with turn_s")
            return self

    def __init__(
        self, kinematics: Kinematics, frame: str, reference: str, target: FloatArray
    ) -> None:
        from hoap3.remote_controller.tasks.se3_kernels import pose_error, rotation_vector

        super().__init__(3, kinematics.n)
        self._pose_error, self._rotation_vector = pose_error, rotation_vector
        self._frame, self._reference = kinematics.frame_id(frame), kinematics.frame_id(reference)
        self._pose, self._pose_rate, self._error, self._error_rate = np.zeros((4, 6))
        self._twist, self._jacobian = np.zeros((2, 6, kinematics.n))
        self._work = np.zeros((2, 3, 3))
        self._position, self.rotation = np.zeros(3), np.eye(3)
        self._nowhere = np.zeros(3)  # origins do not matter
        self.error, self.jacobian = self._error[3:], self._jacobian[3:]
        self.target, self.target_rate = self._pose[3:], self._pose_rate[3:]
        self.target[:] = target
        self.tolerance_deg = TOLERANCE_DEG

    @classmethod
    def configured(cls, context: BuildContext, parameters: Parameters) -> TaskFunction:
        """V of this task."""
        reference = parameters.reference or context.description.base_frame
        task = cls(context.kinematics, parameters.frame, reference, np.zeros(3))
        task.apply(parameters)
        if parameters.target is not None:
            return TaskFunction(task, parameters.target.build(), parameters.weights)
        if parameters.rotation_rad is None:
            return TaskFunction(task, Hold(3), parameters.weights)
        turn = Approach(Point(np.array(parameters.rotation_rad)), parameters.turn_s)
        return TaskFunction(task, turn, parameters.weights)

    def apply(self, parameters: Any) -> None:
        """Read the tolerance."""
        self.tolerance_deg = parameters.tolerance_deg

    def update(self, kinematics: Kinematics) -> None:
        """Recompute e [rad], J = ∂e/∂q, and ∂e/∂t from `target_rate`."""
        self._see(kinematics)
        self.status = self._pose_error(
            self._nowhere,
            self.rotation,
            self._twist,
            self._pose,
            self._pose_rate,
            self._work,
            self._error,
            self._jacobian,
            self._error_rate,
        )

    def explicit_rate(self, out: FloatArray) -> None:
        """Write ∂e/∂t, (3,) [rad/s]."""
        out[:] = self._error_rate[3:]

    def accuracy(self, asked: NDArray[np.bool_]) -> list[TaskError]:
        """Angle to the target."""
        return angle_error(self.error[asked], self.tolerance_deg)

    def read(self, kinematics: Kinematics, out: FloatArray) -> None:
        """Write of both rotation vectors of R the one nearer to the target's, (3,) [rad]."""
        self._see(kinematics)
        self._rotation_vector(self.rotation, self.target, out)

    def _see(self, kinematics: Kinematics) -> None:
        kinematics.frame(self._frame, self._reference, self._position, self.rotation, self._twist)
