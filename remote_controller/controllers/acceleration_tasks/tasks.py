"""Tasks of a hierarchy, of a robot: what they ask for, once per sample."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from hoap3.protocol.description import RobotDescription
from hoap3.protocol.errors import ConfigError, one_of
from hoap3.protocol.messages import FloatArray
from hoap3.remote_controller.controllers.acceleration_tasks.force import ForceTask
from hoap3.remote_controller.controllers.acceleration_tasks.frame_goals import pose_of, reference_of
from hoap3.remote_controller.controllers.acceleration_tasks.positions import PositionReference
from hoap3.remote_controller.controllers.acceleration_tasks.settings import (
    AnyTask,
    ForceSettings,
    PoseSettings,
    PositionSettings,
    PostureTaskSettings,
)
from hoap3.remote_controller.model.frame_dynamics import POSE, POSITION, FrameRows, FramesDynamics
from hoap3.remote_controller.references.postures import posture_of
from hoap3.remote_controller.references.settings import PointSettings
from hoap3.remote_controller.tasks.accuracy import (
    TaskError,
    angle_error,
    joint_errors,
    length_error,
    prismatic_joints,
)

AnyPoint = PositionSettings | ForceSettings
SENSOR = POSE  # rows


class AccelerationTasks:
    """Several tasks, their rows under each other in the order of the config.

    Args:
        robot: its description.
        settings: the tasks.
        folder: where other files are sought.
        torque_max: greatest torques, (n,), that `load` is relative to.
        compensate_friction: whether viscous friction counts among the torques.
        braking_per_s: d; rows of I stand below the tasks', and ask for −d·dq.

    Attributes:
        names, sizes, rows: of the tasks, how many rows each has, and which.
        dynamics: M and h, the latter with friction and without what sensors feel.
        jacobian, wanted: J (m, n), and what J·ddq shall be, (m,).
        with_rest: the same, and below it the rows that brake: (m + n, n) and (m + n,).
        error, motion, rate, slope: of each row, (m,), see `desired_accelerations`.
        tasks: (k, 4) kind, first row, rows and frame of each.
        presses: where forces are kept, by task.
        load: the greatest |h|/torque_max.
        opposite: how many poses are half a turn away.

    Raises:
        ConfigError: a task that does not fit the robot.
    """

    def __init__(
        self,
        robot: RobotDescription,
        settings: Sequence[AnyTask],
        folder: Path,
        torque_max: FloatArray,
        *,
        compensate_friction: bool,
        braking_per_s: float,
    ) -> None:
        from hoap3.remote_controller.controllers.acceleration_tasks import (
            task_acceleration_kernels as kernels,
        )

        self._desired_accelerations, self._load = kernels.desired_accelerations, kernels.load
        self._robot, self._folder = robot, folder
        self.names = tuple(each.name for each in settings)
        self._settings = tuple(settings)
        self._joints = [self._joints_of(each, i) for i, each in enumerate(settings)]
        self.sizes = [
            len(joints) or (POSE if isinstance(each, PoseSettings) else POSITION)
            for each, joints in zip(settings, self._joints, strict=True)
        ]
        m, k, n = sum(self.sizes), len(settings), robot.n
        edges = np.cumsum([0, *self.sizes])
        self.rows = [slice(start, end) for start, end in pairwise(edges)]
        self._sensors = self._sensors_of(settings)
        self.dynamics = self._dynamics(settings, edges, m)
        self.jacobian = self.dynamics.jacobian[:m]
        self._sensor_rows = self.dynamics.jacobian[m + n :]
        self.error, self.motion, self.rate, self.slope = np.zeros((4, m))
        self.with_rest = self.dynamics.jacobian[: m + n], np.zeros(m + n)
        self.wanted, self._brakes = self.with_rest[1][:m], self.with_rest[1][m:]
        self._braking = -min(braking_per_s, 1.0 / robot.period_s)  # no faster than to rest at once
        self._rows = (self.error, self.motion, self.rate, self.slope, self.wanted)
        self._targets, self._turns = np.zeros((k, 3, 3)), np.zeros((k, 3, 3))
        self._posture, self._of_joint = np.zeros(m), np.zeros(m, np.int64)
        self._turn, self._gains = np.zeros((3, 3)), np.array([each.both for each in settings])
        self._places: list[tuple[int, PositionReference]] = []
        self._moving: list[PositionReference] = []
        self._held: list[tuple[int, int]] = []  # poses that stay where they are at the start
        self.presses: dict[int, ForceTask] = {}
        self.tasks = np.zeros((k, 4), np.int64)
        kinds = {PoseSettings: kernels.POSE, PostureTaskSettings: kernels.POSTURE}
        frames = iter(range(k))
        for i, each in enumerate(settings):
            frame = -1 if isinstance(each, PostureTaskSettings) else next(frames)
            kind = kinds.get(type(each), kernels.POSITION)
            self.tasks[i] = kind, edges[i], self.sizes[i], frame
            self._aim_at(i, each, frame)
        self._first_sensor = int(next(frames, k))
        self._wrench = np.zeros(SENSOR * len(self._sensors))
        wrenches = [robot.wrench_sensors.index(name) for name in self._sensors]
        self._felt = np.array([6 * place + i for place in wrenches for i in range(6)], np.intp)
        self._damping = self.dynamics.damping * float(compensate_friction)
        self._torque_max, self._dt = torque_max, robot.period_s
        self.load, self.opposite = 0.0, 0

    def begin(self, q: FloatArray, dq: FloatArray, time_s: float) -> None:
        """Start from where the robot is at a time [s]: finite (n,)."""
        dynamics = self.dynamics
        dynamics.update(q, dq)
        for i, place in self._places:
            place.start(dynamics.origins[self.tasks[i, 3]], time_s)
        for i, frame in self._held:
            self._targets[i, 0], self._turns[i] = dynamics.origins[frame], dynamics.rotations[frame]
        for press in self.presses.values():
            press.reset()

    def update(
        self, q: FloatArray, dq: FloatArray, wrench: FloatArray, time_s: float, absent: FloatArray
    ) -> None:
        """Take a State.

        Args:
            q, dq: (n,), finite.
            wrench: of all sensors of the robot, (6s,) [N, N m].
            time_s: of the State [s].
            absent: how far each task is out, (k,), from 0 to 1.
        """
        dynamics, presses = self.dynamics, self.presses
        dynamics.update(q, dq)
        np.multiply(dq, self._braking, out=self._brakes)
        for place in self._moving:
            place.update(time_s)
        self.opposite = self._desired_accelerations(
            self.tasks,
            dynamics.origins,
            dynamics.rotations,
            dynamics.twist,
            dynamics.drift,
            self._targets,
            self._turns,
            self._posture,
            self._of_joint,
            self._gains,
            q,
            dq,
            self._turn,
            *self._rows,
        )
        if presses:
            np.take(wrench, self._felt, out=self._wrench)
        self.load = self._load(
            self._sensor_rows,
            self._wrench,
            self._damping,
            dq,
            self._dt,
            self._torque_max,
            dynamics.mass,
            dynamics.bias,
        )
        for i, press in presses.items():
            sensor = self._sensor_of[i]
            turned = dynamics.rotations[self._first_sensor + sensor]
            felt = turned @ self._wrench[SENSOR * sensor : SENSOR * sensor + 3]
            press.feel(felt, float(absent[i]))
            if press.touches:
                _, start, size, _ = self.tasks[i]
                mine = slice(start, start + size)
                press.update(
                    dynamics.mass,
                    self.jacobian[mine],
                    self._targets[i, 2],
                    [each[mine] for each in self._rows],
                )

    def errors_of(self, i: int) -> list[TaskError]:
        """Errors of task i at the last `update`, each with its tolerance."""
        settings, error = self._settings[i], self.error[self.rows[i]]
        if isinstance(settings, PostureTaskSettings):
            prismatic = prismatic_joints(self._robot)[self._joints[i]]
            return joint_errors(error, prismatic, settings.tolerance_m, settings.tolerance_deg)
        found = length_error(error[:POSITION], settings.tolerance_m)
        if isinstance(settings, PoseSettings):
            found += angle_error(error[POSITION:], settings.tolerance_deg)
        elif isinstance(settings, ForceSettings):
            found.append(self.presses[i].error)
        return found

    def _joints_of(self, each: AnyTask, number: int) -> list[int]:
        """Places of the joints of a posture; none of another task."""
        if not isinstance(each, PostureTaskSettings):
            return []
        known = list(self._robot.joint_names)
        for name in each.joints:
            if name not in known or each.joints.count(name) > 1:
                problem = "is named twice" if name in known else "is no joint of this robot"
                remedy = f"Its joints: {', '.join(known)}"
                raise ConfigError("", f"tasks.{number}.joints", name, problem, remedy)
        return [known.index(name) for name in each.joints or known]

    def _sensors_of(self, settings: Sequence[AnyTask]) -> list[str]:
        """Sensors that are felt, each once; `_sensor_of` says which of them is a task's."""
        known, found = self._robot.wrench_sensors, []
        self._sensor_of: dict[int, int] = {}
        for i, each in enumerate(settings):
            if isinstance(each, ForceSettings):
                sensor = each.sensor or each.frame
                if sensor not in known:
                    remedy = f"Its sensors: {', '.join(known) or 'none'}"
                    where = f"tasks.{i}.{'sensor' if each.sensor else 'frame'}"
                    problem = "the robot has no wrench sensor there"
                    raise ConfigError("", where, sensor, problem, remedy)
                if sensor not in found:
                    found.append(sensor)
                self._sensor_of[i] = found.index(sensor)
        return found

    def _dynamics(
        self, settings: Sequence[AnyTask], edges: np.ndarray[Any, Any], m: int
    ) -> FramesDynamics:
        rows = []
        for i, each in enumerate(settings):
            if isinstance(each, PostureTaskSettings):
                continue
            if each.frame not in self._robot.frames:
                remedy = one_of(each.frame, self._robot.frames, "Its frames")
                where = f"tasks.{i}.frame"
                problem = f"robot {self._robot.name!r} has no such frame"
                raise ConfigError("", where, each.frame, problem, remedy)
            rows.append(FrameRows(each.frame, int(edges[i]), self.sizes[i]))
        end, sensors = m + self._robot.n, self._sensors  # rows of I come first
        rows += [FrameRows(name, end + SENSOR * s, SENSOR) for s, name in enumerate(sensors)]
        dynamics = FramesDynamics(self._robot, rows, end + SENSOR * len(sensors))
        dynamics.jacobian[m:end] = np.eye(self._robot.n)
        for i, joints in enumerate(self._joints):
            dynamics.jacobian[np.arange(len(joints)) + edges[i], joints] = 1.0
        return dynamics

    def _aim_at(self, i: int, each: AnyTask, frame: int) -> None:
        """Where a task shall lead."""
        robot, key = self._robot, f"tasks.{i}"
        start = self.tasks[i, 1]
        if isinstance(each, PostureTaskSettings):
            rows = slice(start, start + self.sizes[i])
            whole = posture_of(robot, each.posture, each.posture_rad, f"{key}.posture")
            self._posture[rows], self._of_joint[rows] = whole[self._joints[i]], self._joints[i]
        elif isinstance(each, PoseSettings):
            if each.goal is None:
                self._held.append((i, frame))
                return
            self._targets[i, 0], self._turns[i] = pose_of(
                robot, self.dynamics, each.frame, each.goal, f"{key}.goal"
            )
        else:
            self._aim_at_point(i, each, key)

    def _aim_at_point(self, i: int, each: AnyPoint, key: str) -> None:
        robot, dt = self._robot, self._robot.period_s
        origin, axes = reference_of(robot, self.dynamics, each.reference, f"{key}.reference")
        target = None if each.target is None else each.target.build(self._folder)
        still = each.target is None or (
            isinstance(each.target, PointSettings) and not each.target.approach_s
        )
        place = PositionReference(target, origin, axes, dt, self._targets[i])
        self._places.append((i, place))
        if not still:
            self._moving.append(place)
        if isinstance(each, ForceSettings):
            normal = axes @ np.array(each.normal)
            normal /= np.linalg.norm(normal)
            self.presses[i] = ForceTask(each, normal, robot.n, dt)
