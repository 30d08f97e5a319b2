"""A force along a normal, in place of a position along it, from the first touch on."""

from __future__ import annotations

import math
from typing import Any, Self

import numpy as np
from pydantic import Field, model_validator

from hoap3.protocol.messages import FloatArray
from hoap3.remote_controller.tasks.accuracy import TaskError
from hoap3.remote_controller.tasks.frames.frame_position import FramePositionTask

TOLERANCE, LEAST_TOLERANCE_N = 0.05, 0.5  # of the wanted force, and at least
MOST = 1.0  # of the wanted force: what the integral adds to it or takes from it


class WrenchTask(FramePositionTask):
    """The origin of a frame at a target, until it touches; then along a normal a force.

    Both in one task of three rows: two tasks without priority over each other would each feed into
    the rows of the other. What it asks for says `WrenchControl`.
    """

    levels = ("acceleration",)

    class Parameters(FramePositionTask.Parameters):
        """Where to touch, in which direction, and how firmly."""

        normal: tuple[float, float, float] = Field(
            description="of the surface, towards the robot, in the reference; of any length"
        )
        force_n: float = Field(gt=0, description="with which it shall press")
        tolerance_n: float | None = Field(
            None,
            gt=0,
            description="error of the force at the end that counts as reached [N]; null: 5 % of "
            "`force_n`, at least 0.5",
        )
        sensor: str | None = Field(None, description="frame of the wrench sensor; null: `frame`")
        force_kp: float = Field(0.0, ge=0, description="of the error of the force")
        force_ki_per_s: float = Field(
            5.0, ge=0, description="of its integral, which adds or takes at most force_n"
        )
        force_kd: float = Field(
            0.0, ge=0, description="of the velocity along the normal while it touches [1/s]"
        )
        touch_n: float = Field(
            0.5,
            gt=0,
            description="force from which on it touches, until it is removed or begins anew",
        )

        @model_validator(mode="after")
        def _a_direction(self) -> Self:
            if not 1e-6 <= math.hypot(*self.normal) <= 1e6:
                raise ValueError("should have a normal that points somewhere, of a length near 1")
            return self


class WrenchControl:
    """Asks for the acceleration with which a point keeps a force.

    Liu, Tan and Padois (2015), (3), with the measured force f, of the surface on the robot, in the
    equation of motion: along the normal a = Λ⁻¹·(f − w), Λ⁻¹ = nᵀ J M⁻¹ Jᵀ n, where what the robot
    presses with is w = f_d + kp·(f_d − f) + ki·∫(f_d − f), less a damping kd·v. It touches from
    the first force of `touch_n` on; if the surface then goes away, it follows.

    The integral counts only while the task takes part in full and feels `touch_n` or more: of a
    force that it may not, or cannot, have it learns nothing. A task that is out forgets it, and
    that it touched: put in again, it comes to its target as at first.

    Args:
        settings: of the task.
        normal: n, of the surface towards the robot, in the root's axes, (3,), of length 1.
        joints: n.
        period_s: [s].

    Attributes:
        touches: whether it does.
        force: measured along the normal [N]; positive where the surface pushes.
    """

    def __init__(
        self, settings: WrenchTask.Parameters, normal: FloatArray, joints: int, period_s: float
    ) -> None:
        from hoap3.remote_controller.tasks.accelerations import (
            task_acceleration_kernels as kernels,
        )

        self._inverse_task_inertia, self._push = kernels.inverse_task_inertia, kernels.push
        self._settings, self._normal, self._period = settings, normal, period_s
        self._factor, self._row, self._scratch = (
            np.zeros((joints, joints)),
            np.zeros(joints),
            np.zeros(joints),
        )
        self.touches, self.force, self._integral, self._learns = False, 0.0, 0.0, False

    @property
    def error(self) -> TaskError:
        """How far the measured force is from the wanted one."""
        wanted, tolerance = self._settings.force_n, self._settings.tolerance_n
        if tolerance is None:
            tolerance = max(TOLERANCE * wanted, LEAST_TOLERANCE_N)
        return TaskError(abs(wanted - self.force), "N", tolerance)

    def reset(self) -> None:
        """Nothing touches yet."""
        self.touches, self.force, self._integral = False, 0.0, 0.0

    def feel(self, force: FloatArray, absent: float) -> None:
        """Take what the surface does to the robot.

        Args:
            force: (3,) [N] in the root's axes.
            absent: how far the task is out, from 0 to 1: α_ii.
        """
        if absent >= 1.0:
            self.reset()
        self.force = float(self._normal @ force)
        felt = self.force >= self._settings.touch_n
        self.touches, self._learns = self.touches or felt, felt and absent <= 0.0

    def update(
        self, mass: FloatArray, jacobian: FloatArray, ahead: FloatArray, rows: list[Any]
    ) -> None:
        """Change what the task asks for.

        Args:
            mass: M (n, n).
            jacobian: of the point, (3, n), in the root's axes.
            ahead: a_d of its target, (3,).
            rows: error, motion, rate, slope and wish of the task, (3,) each.
        """
        wanted = self._settings
        missing = wanted.force_n - self.force
        most = MOST * wanted.force_n
        if self._learns:
            grown = self._integral + wanted.force_ki_per_s * self._period * missing
            self._integral = min(max(grown, -most), most)
        pressing = wanted.force_n + wanted.force_kp * missing + self._integral
        mobile = self._inverse_task_inertia(
            mass, jacobian, self._normal, self._factor, self._row, self._scratch
        )
        speed = float(self._normal @ rows[1])
        acceleration = mobile * (self.force - pressing) - wanted.force_kd * speed
        self._push(self._normal, acceleration, ahead, *rows)
