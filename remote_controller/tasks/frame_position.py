"""A frame's origin at a point."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from protocol.messages import FloatArray
from remote_controller.kinematics import Kinematics
from remote_controller.tasks.lyapunov import Site
from remote_controller.tasks.targets.settings import TargetSettings
from remote_controller.tasks.task import Task
from remote_controller.tasks.task_function import TaskFunction


class FramePositionTask(Task):
    """e = p(q) − p_d: origin of a frame as seen from a reference frame, less its target [m].

    J is exact: the velocity of the origin relative to the reference, in the reference's axes.

    Args:
        kinematics: of the robot.
        frame, reference: names.
        target: p_d, (3,) [m], in the reference's axes.

    Raises:
        FrameNotFoundError: the robot has no such frame.
    """

    class Parameters(Task.Parameters):
        """Which frame, and where it shall be."""

        frame: str = Field(description="frame that shall get there")
        reference: str = Field(description="frame that it is seen from")
        target: TargetSettings = Field(description="where its origin shall be, in that frame")

    def __init__(
        self, kinematics: Kinematics, frame: str, reference: str, target: FloatArray
    ) -> None:
        super().__init__(3, kinematics.n)
        self._frame, self._reference = kinematics.frame_id(frame), kinematics.frame_id(reference)
        self._twist = np.zeros((6, kinematics.n))
        self._scratch = np.zeros((6, kinematics.n))
        self._rotation = np.zeros((3, 3))
        self.jacobian = self._twist[:3]
        self.position = np.zeros(3)
        self.target[:] = target

    @classmethod
    def configured(cls, site: Site, parameters: Parameters) -> TaskFunction:
        """V of this task."""
        task = cls(site.kinematics, parameters.frame, parameters.reference, np.zeros(3))
        return TaskFunction(task, parameters.target.build(site.folder), parameters.weights)

    def update(self, kinematics: Kinematics) -> None:
        """Recompute e [m] and J [m/rad]."""
        kinematics.frame(self._frame, self._reference, self.position, self._rotation, self._twist)
        np.subtract(self.position, self.target, out=self.error)

    def read(self, kinematics: Kinematics, out: FloatArray) -> None:
        """Write p(q), (3,) [m]."""
        kinematics.frame(self._frame, self._reference, out, self._rotation, self._scratch)
