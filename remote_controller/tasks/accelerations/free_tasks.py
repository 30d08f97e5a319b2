"""Tasks of a robot whose base is free: frames and the centre of mass in the world."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from hoap3.protocol.errors import ConfigError
from hoap3.protocol.messages import FloatArray, State
from hoap3.protocol.robot.description import COM
from hoap3.remote_controller.model.frame_dynamics import POSE, FrameRows
from hoap3.remote_controller.model.free_dynamics import BASE, FreeDynamics
from hoap3.remote_controller.references.live.live_settings import (
    LiveOrientationSettings,
    LivePoseSettings,
)
from hoap3.remote_controller.references.postures import posture_of
from hoap3.remote_controller.references.settings import PointSettings, target_of
from hoap3.remote_controller.tasks.accelerations.acceleration_tasks import (
    AccelerationTasks,
    is_still,
)
from hoap3.remote_controller.tasks.accelerations.position_reference import PositionReference
from hoap3.remote_controller.tasks.accelerations.standing import turned
from hoap3.remote_controller.tasks.accelerations.wrench import WrenchTask
from hoap3.remote_controller.tasks.accuracy import TaskError, angle_error
from hoap3.remote_controller.tasks.com import ComTask
from hoap3.remote_controller.tasks.frames.frame_orientation import FrameOrientationTask
from hoap3.remote_controller.tasks.frames.frame_pose import FramePoseTask
from hoap3.remote_controller.tasks.frames.frame_position import AXES, FramePositionTask
from hoap3.remote_controller.tasks.posture import PostureTask

NO_ROTATION = np.eye(3)


class FreeTasks(AccelerationTasks):
    """The same for a free base: all Jacobians have 6 columns of the base before the joints'.

    `frame_position`, `frame_pose` and `frame_orientation` without a `reference` are in the world,
    whose z is up. `com`
    is, too: its target is given in its `frame` as that stands when the controller begins. All else
    is seen from a frame of the robot, as ever, and no motion of the base changes it.

    Below the rows that brake stand those of the soles, 6 each: `sole_rows`.

    Attributes:
        coms: tasks of the centre of mass.
    """

    dynamics: FreeDynamics

    def __init__(self, *args: Any, **options: Any) -> None:
        self.coms: list[int] = []
        self._given: list[tuple[str, FloatArray, FloatArray]] = []  # references to be placed
        self._postures: list[tuple[int, str, FloatArray]] = []
        super().__init__(*args, **options)
        first = sum(self.sizes) + self._robot.n
        self.sole_rows = slice(first, first + POSE * len(self._robot.soles))
        dynamics = self.dynamics
        self.soles = dynamics.jacobian[self.sole_rows]
        frames = slice(len(dynamics.origins) - len(self._robot.soles), None)
        self.sole_origins, self.sole_axes = dynamics.origins[frames], dynamics.rotations[frames]

    def take(self, state: State) -> None:
        """Take the base of a State, before `begin` and `update`."""
        self.dynamics.base[:] = state.base

    def begin(self, q: FloatArray, dq: FloatArray, time_s: float, next_s: float) -> None:
        """Start from where the robot is; references and postures are placed from here."""
        dynamics = self.dynamics
        for frame, origin, axes in self._given:
            origin[:], axes[:] = dynamics.placement(q, frame)
        for i, frame, posture in self._postures:
            self._targets[i, 0], self._turns[i] = dynamics.placement(posture, frame)
        super().begin(q, dq, time_s, next_s)

    def errors_of(self, i: int) -> list[TaskError]:
        """Errors of task i at the last `update`, each with its tolerance."""
        parameters = self._parameters[i]
        if i in self._functions or not isinstance(parameters, FrameOrientationTask.Parameters):
            return super().errors_of(i)
        return angle_error(self.error[self.rows[i]], parameters.tolerance_deg)

    def _kind_of(self, task: type, parameters: Any) -> int:
        from hoap3.remote_controller.tasks.accelerations import task_acceleration_kernels as kernels

        if task is WrenchTask:
            problem, remedy = "presses from a base that stands", "Leave it out with a free base"
            raise ConfigError(self._file, "parameters.tasks", "wrench", problem, remedy)
        if task in {FrameOrientationTask, FramePoseTask} and parameters.reference is None:
            self._check_stays(parameters.target)
        if task is ComTask and not parameters.weights:
            return kernels.POSITION
        if task is PostureTask:
            return super()._kind_of(task, parameters)
        if task is FrameOrientationTask:
            turns = parameters.turn_s or parameters.target is not None
            other = parameters.weights or parameters.reference or turns
            return kernels.GIVEN if other else kernels.TURN
        if task not in {FramePositionTask, FramePoseTask} or parameters.weights:
            return kernels.GIVEN
        if parameters.reference is not None:
            return kernels.GIVEN
        if task is FramePositionTask:
            return kernels.POSITION if parameters.axes == AXES else kernels.GIVEN
        turns = parameters.turn_s or not is_still(parameters.target)
        return kernels.GIVEN if turns else kernels.POSE

    def _check_stays(self, target: Any) -> None:
        """Refuse to steer an orientation in the world.

        Raises:
            ConfigError: somebody would.
        """
        if isinstance(target, LivePoseSettings | LiveOrientationSettings):
            problem = "orientations in the world, as of a free base, stay"
            remedy = "Give the task a `reference`, or steer a `frame_position`"
            raise ConfigError(self._file, "parameters.tasks", target.name, problem, remedy)

    def _dynamics_of(self, frames: list[FrameRows], rows: int) -> FreeDynamics:
        soles = self._robot.soles
        below = [FrameRows(sole.frame, rows + POSE * i, POSE) for i, sole in enumerate(soles)]
        return FreeDynamics(self._robot, [*frames, *below], rows + POSE * len(soles))

    def _frame_rows(self, i: int) -> FrameRows:
        parameters, found = self._parameters[i], super()._frame_rows(i)
        if isinstance(parameters, ComTask.Parameters):
            return found._replace(frame=COM)
        return found._replace(turns=isinstance(parameters, FrameOrientationTask.Parameters))

    def _add_friction(self, dq: FloatArray) -> None:
        """Viscous friction, taken at the end of the period; what holds the load is not known."""
        dynamics, damping = self.dynamics, self._damping
        diagonal = np.einsum("ii->i", dynamics.mass)  # a view
        diagonal[BASE:] += self._dt * damping
        dynamics.bias[BASE:] += damping * dq

    def _aim(self, i: int, frame: int) -> None:
        parameters = self._parameters[i]
        if i in self._joints or frame < 0:
            super()._aim(i, frame)
        elif isinstance(parameters, FramePoseTask.Parameters):
            self._aim_at_pose(i, frame, parameters)
        elif isinstance(parameters, FrameOrientationTask.Parameters):
            if parameters.rotation_rad is None:
                self._held.append((i, frame))
            else:
                self._turns[i] = turned(NO_ROTATION, parameters.rotation_rad)
        else:
            self._aim_at_point(i, frame, parameters)

    def _aim_at_pose(self, i: int, frame: int, wanted: FramePoseTask.Parameters) -> None:
        if isinstance(wanted.target, PointSettings):
            self._targets[i, 0] = wanted.target.position_m
            self._turns[i] = turned(NO_ROTATION, wanted.rotation)
        elif wanted.posture is None and not wanted.posture_rad:
            self._held.append((i, frame))
        else:
            posture = posture_of(self._robot, wanted.posture, wanted.posture_rad, "posture")
            self._postures.append((i, wanted.frame, posture))

    def _aim_at_point(self, i: int, frame: int, parameters: Any) -> None:
        origin, axes = np.zeros(3), np.eye(3)
        if isinstance(parameters, ComTask.Parameters):
            self.coms.append(i)
            self._given.append((parameters.frame, origin, axes))
        del frame
        target = target_of(parameters.target, Path(self._file).parent)
        place = PositionReference(target, origin, axes, self._robot.period_s, self._targets[i])
        self._places.append((i, place))
        if target.rests_after_s > 0.0:
            self._moving.append(place)
