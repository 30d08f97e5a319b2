"""A frame's origin at a point."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, field_validator

from hoap3.protocol.messages import FloatArray
from hoap3.remote_controller.model.kinematics import Kinematics
from hoap3.remote_controller.references.settings import TargetSettings, target_of
from hoap3.remote_controller.references.trajectories.trajectory_settings import tolerances_of
from hoap3.remote_controller.tasks.accuracy import TOLERANCE_M, TaskError, ToleranceM, length_error
from hoap3.remote_controller.tasks.lyapunov import BuildContext
from hoap3.remote_controller.tasks.task import Task
from hoap3.remote_controller.tasks.task_function import TaskFunction

Axis = Literal["x", "y", "z"]
AXES: tuple[Axis, ...] = ("x", "y", "z")


class FramePositionTask(Task):
    """e = p(q) − p_d: origin of a frame as seen from a reference frame, less its target [m].

    J is exact: the velocity of the origin relative to the reference, in the reference's axes. With
    fewer than three axes e has their components only, and the others are left free.

    Args:
        kinematics: of the robot.
        frame, reference: names.
        target: p_d, (3,) [m], in the reference's axes.
        axes: the components of e, in this order.

    Raises:
        FrameNotFoundError: the robot has no such frame.
    """

    class Parameters(Task.Parameters):
        """Which frame, and where it shall be."""

        frame: str = Field(description="frame that shall get there")
        reference: str | None = Field(
            None, description="frame that it is seen from; null: the base frame"
        )
        target: TargetSettings | None = Field(
            None,
            description="where its origin shall be, in that frame; null: where it is at the start",
        )
        axes: tuple[Axis, ...] = Field(
            AXES, min_length=1, description="components of e, in this order; others are left free"
        )
        tolerance_m: ToleranceM = TOLERANCE_M

        @field_validator("axes")
        @classmethod
        def _once(cls, axes: tuple[Axis, ...]) -> tuple[Axis, ...]:
            if len(set(axes)) < len(axes):
                raise ValueError("should name each axis once")
            return axes

    def __init__(
        self,
        kinematics: Kinematics,
        frame: str,
        reference: str,
        target: FloatArray,
        axes: Sequence[Axis] = AXES,
    ) -> None:
        super().__init__(len(axes), kinematics.n)
        self._axes = [AXES.index(axis) for axis in axes]
        self._all = tuple(axes) == AXES
        self._frame, self._reference = kinematics.frame_id(frame), kinematics.frame_id(reference)
        self._twist = np.zeros((6, kinematics.n))
        self._scratch = np.zeros((6, kinematics.n))
        self._rotation = np.zeros((3, 3))
        self.position, self._difference = np.zeros((2, 3))
        if self._all:
            self.error, self.jacobian = self._difference, self._twist[:3]
        self.target, self.target_rate = np.zeros((2, 3))
        self.target[:] = target
        self.tolerance_m = TOLERANCE_M

    @classmethod
    def configured(cls, context: BuildContext, parameters: Parameters) -> TaskFunction:
        """V of this task."""
        frame, axes = parameters.frame, parameters.axes
        reference = parameters.reference or context.description.base_frame
        task = cls(context.kinematics, frame, reference, np.zeros(3), axes)
        task.apply(parameters)
        target = target_of(parameters.target, context.folder)
        tolerances = tolerances_of(parameters.target, target, axes, "m")
        return TaskFunction(task, target, parameters.weights, tolerances)

    def apply(self, parameters: Any) -> None:
        """Read the tolerance."""
        self.tolerance_m = parameters.tolerance_m

    def update(self, kinematics: Kinematics) -> None:
        """Recompute e [m] and J [m/rad]."""
        kinematics.frame(self._frame, self._reference, self.position, self._rotation, self._twist)
        np.subtract(self.position, self.target, out=self._difference)
        if not self._all:
            for row, axis in enumerate(self._axes):
                self.error[row] = self._difference[axis]
                self.jacobian[row] = self._twist[axis]

    def accuracy(self, asked: NDArray[np.bool_]) -> list[TaskError]:
        """Distance to the target, along the axes of e."""
        return length_error(self.error[asked], self.tolerance_m)

    def read(self, kinematics: Kinematics, out: FloatArray) -> None:
        """Write p(q), (3,) [m], all of it: so targets start from there."""
        kinematics.frame(self._frame, self._reference, out, self._rotation, self._scratch)

    def explicit_rate(self, out: FloatArray) -> None:
        """Write ∂e/∂t [m/s]."""
        for row, axis in enumerate(self._axes):
            out[row] = -self.target_rate[axis]
