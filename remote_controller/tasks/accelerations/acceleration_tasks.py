"""Tasks of a robot that ask for accelerations: what each wants, once per sample."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.errors import ConfigError, located, one_of
from hoap3.protocol.messages import FloatArray
from hoap3.protocol.robot.description import RobotDescription
from hoap3.remote_controller.model.frame_dynamics import POSE, POSITION, FrameRows, FramesDynamics
from hoap3.remote_controller.model.kinematics import Kinematics
from hoap3.remote_controller.references.settings import (
    PointSettings,
    TargetSettings,
    target_of,
)
from hoap3.remote_controller.references.trajectories.trajectory_settings import TrajectorySettings
from hoap3.remote_controller.scheduling.changes import Part, part_of, private
from hoap3.remote_controller.tasks import status
from hoap3.remote_controller.tasks.accelerations.by_differences import TaskRows, TasksByDifferences
from hoap3.remote_controller.tasks.accelerations.position_reference import PositionReference
from hoap3.remote_controller.tasks.accelerations.settings import AccelerationTask, Gains
from hoap3.remote_controller.tasks.accelerations.standing import (
    pose_of,
    reference_of,
    stands,
    turned,
)
from hoap3.remote_controller.tasks.accelerations.wrench import (
    Sensed,
    TaskMotion,
    WrenchControl,
    WrenchTask,
)
from hoap3.remote_controller.tasks.accuracy import (
    TOLERANCE_M,
    TaskError,
    angle_error,
    joint_errors,
    length_error,
    prismatic_joints,
)
from hoap3.remote_controller.tasks.frames.frame_pose import FramePoseTask
from hoap3.remote_controller.tasks.frames.frame_position import AXES, FramePositionTask
from hoap3.remote_controller.tasks.lyapunov import LyapunovFunction
from hoap3.remote_controller.tasks.posture import PostureTask, places_of, positions_of
from hoap3.remote_controller.tasks.registry import (
    FollowedTask,
    TaskSettings,
    build_with_error,
    check_parameters,
    find,
    followed_task,
    labels_of,
)

SENSOR = POSE  # rows
NO_ERROR = TaskError(0.0, "m", TOLERANCE_M)  # of a task that takes no part
FIXED = frozenset({"weights"})  # of tasks that the kernel knows: these have none


class AccelerationTasks:
    """Several tasks, their rows under each other in the order of the config.

    Frames whose reference stands, postures and wrenches share one pass over the robot's dynamics
    and one kernel; any other task is followed by differences (`by_differences`).

    Args:
        robot: its description.
        settings: the tasks.
        file: where they stand, under `parameters.tasks`; other files are sought beside it.
        torque_max: greatest torques, (n,), that `load` is relative to.
        compensate_friction: whether viscous friction counts among the torques.

    Attributes:
        names, sizes, rows: of the tasks, how many rows each has, and which.
        kinematics: which updates may leave elsewhere.
        dynamics: M and h, the latter with friction and without what sensors feel.
        jacobian, wanted: J (m, n), and what J·ddq shall be, (m,).
        with_rest: the same, and below it the rows that brake: (m + n, n) and (m + n,).
        error, motion, rate, slope: of each row, (m,), see `desired_accelerations`.
        tasks: (k, 4) kind, first row, rows and frame of each.
        presses: where wrenches are kept, by task.
        load: the greatest |h|/torque_max.
        opposite: how many poses are half a turn away.

    Raises:
        ConfigError: a task that does not fit the robot, that asks for no acceleration, or that has
            the name of another.
    """

    def __init__(
        self,
        robot: RobotDescription,
        settings: Sequence[AccelerationTask],
        file: str,
        torque_max: FloatArray,
        *,
        compensate_friction: bool,
    ) -> None:
        from hoap3.remote_controller.tasks.accelerations import task_acceleration_kernels as kernels
        from hoap3.remote_controller.tasks.accelerations.wrench_kernels import turn_to_root

        self._desired_accelerations, self._add_friction_and_wrenches = (
            kernels.desired_accelerations,
            kernels.add_friction_and_wrenches,
        )
        self._turn_to_root = turn_to_root
        self._robot, self._file = robot, file
        self.names = tuple(labels_of(settings))
        keys = [f"parameters.tasks.{i}" for i in range(len(settings))]
        self._parameters = [
            check_parameters(each, file, key, "acceleration")
            for each, key in zip(settings, keys, strict=True)
        ]
        self._kinds = [
            self._kind_of(find(each.task), parameters)
            for each, parameters in zip(settings, self._parameters, strict=True)
        ]
        self.kinematics = kinematics = Kinematics(robot)
        self._functions = {
            i: build_with_error(settings[i], robot, kinematics, file, keys[i], "acceleration")
            for i in self._of_kind(kernels.GIVEN)
        }
        self._joints: dict[int, list[int]] = {}
        for i in self._of_kind(kernels.POSTURE):
            with self._located(i):
                self._joints[i] = places_of(robot, self._parameters[i].joints)
        self.sizes = [self._size_of(i) for i in range(len(settings))]
        m, k, n = sum(self.sizes), len(settings), robot.n
        edges = np.cumsum([0, *self.sizes])
        self.rows = [slice(start, end) for start, end in pairwise(edges)]
        self._sensors = self._find_sensors()
        self.dynamics = self._dynamics(m)
        self.jacobian = self.dynamics.jacobian[:m]
        self._sensor_rows = self.dynamics.jacobian[m + n :]
        self.error, self.motion, self.rate, self.slope = np.zeros((4, m))
        self.with_rest = self.dynamics.jacobian[: m + n], np.zeros(m + n)
        self.wanted, self._brakes = self.with_rest[1][:m], self.with_rest[1][m:]
        self._braking = 0.0
        self._rows = (self.error, self.motion, self.rate, self.slope, self.wanted)
        self._targets, self._turns = np.zeros((k, 3, 3)), np.zeros((k, 3, 3))
        self._posture, self._of_joint = np.zeros(m), np.zeros(m, np.int64)
        self._turn, self._gains = np.zeros((3, 3)), np.array([each.both for each in settings])
        self._places: list[tuple[int, PositionReference]] = []
        self._moving: list[PositionReference] = []
        self._held: list[tuple[int, int]] = []  # frames that stay as they are at the start
        self.presses: dict[int, WrenchControl] = {}
        self.tasks = np.zeros((k, 4), np.int64)
        frames = iter(range(k))
        for i, kind in enumerate(self._kinds):
            frame = next(frames) if kind in kernels.OF_FRAMES else -1
            self.tasks[i] = kind, edges[i], self.sizes[i], frame
            with self._located(i):
                self._aim(i, frame)
        self._others = TasksByDifferences(
            list(self._functions.values()),
            [self._rows_of(i) for i in self._functions],
            kinematics,
            robot.period_s,
        )
        self._first_sensor = int(next(frames, k))
        self._wrench = np.zeros(SENSOR * len(self._sensors))
        wrenches = [robot.wrench_sensors.index(name) for name in self._sensors]
        self._felt = np.array([6 * place + i for place in wrenches for i in range(6)], np.intp)
        self._views = {i: (self._sensed_by(i), self._motion_of(i)) for i in self.presses}
        self._turned = [self._turned_rows_of(i) for i in self._of_kind(kernels.ROOT_POSE)]
        self._damping = self.dynamics.damping * float(compensate_friction)
        self._torque_max, self._dt = torque_max, robot.period_s
        self.load, self.opposite = 0.0, 0

    def begin(self, q: FloatArray, dq: FloatArray, time_s: float, next_s: float) -> None:
        """Start from where the robot is at a time, as `update`: finite (n,)."""
        dynamics = self.dynamics
        dynamics.update(q, dq)
        if self._functions:
            self._others.begin(q, time_s)
        for i, frame in self._held:
            self._targets[i, 0], self._turns[i] = dynamics.origins[frame], dynamics.rotations[frame]
        for i, place in self._places:
            place.start(dynamics.origins[self.tasks[i, 3]], time_s, next_s)
        for press in self.presses.values():
            press.begin(time_s)

    def update(
        self,
        q: FloatArray,
        dq: FloatArray,
        wrench: FloatArray,
        time_s: float,
        next_s: float,
        absent: FloatArray,
    ) -> None:
        """Take a State.

        Args:
            q, dq: (n,), finite.
            wrench: of all sensors of the robot, (6s,) [N, N m].
            time_s, next_s: of the State and of the next one [s].
            absent: how far each task is out, (k,), from 0 to 1.
        """
        dynamics, presses = self.dynamics, self.presses
        dynamics.update(q, dq)
        if self._braking:
            np.multiply(dq, self._braking, out=self._brakes)
        for place in self._moving:
            place.update(time_s, next_s)
        if self._functions:
            self._others.update(q, dq, time_s, next_s)
        for rows in self._turned:
            self._turn_to_root(*rows)
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
        if self._functions:
            for function in self._functions.values():
                self.opposite += function.status == status.AT_ANTIPODE
        if presses:
            np.take(wrench, self._felt, out=self._wrench)
        self._add_friction(dq)
        for i, press in presses.items():
            sensed, motion = self._views[i]
            press.aim(time_s)
            press.feel(sensed, float(absent[i]))
            if press.touches:
                press.update(dynamics.mass, motion)

    def _add_friction(self, dq: FloatArray) -> None:
        """Have M and h count friction and wrenches, and find the `load`."""
        self.load = self._add_friction_and_wrenches(
            self._sensor_rows,
            self._wrench,
            self._damping,
            dq,
            self._dt,
            self._torque_max,
            self.dynamics.mass,
            self.dynamics.bias,
        )

    @cached_property
    def _watched(self) -> list[LyapunovFunction]:
        return [each for each in self._functions.values() if each.watched]

    @property
    def watched(self) -> bool:
        """Whether any has tolerances."""
        return bool(self._watched)

    def watch(self, q: FloatArray, tick: int, time_s: float) -> bool:
        """Compare errors with tolerances, before `update`; whether one is, or was, violated.

        Args:
            q: (n,), finite.
            tick, time_s: of the State [s].
        """
        self.kinematics.update(q)
        return max(each.watch(self.kinematics, tick, time_s) for each in self._watched)

    def followed(
        self,
        settings: Sequence[TaskSettings],
        absent: FloatArray,
        judged: Callable[[], NDArray[np.bool_]],
    ) -> list[FollowedTask]:
        """Return the tasks without a wrench, each with the rows that are those of its error.

        Args:
            settings: of the tasks.
            absent: how far each is out, (k,), changed in place; one that is has no error.
            judged: which must reach their targets, (k,).
        """

        def of(i: int, each: TaskSettings) -> FollowedTask:
            size = len(self._functions[i].error) if i in self._functions else self.sizes[i]
            rows, none = slice(int(self.rows[i].start), int(self.rows[i].start) + size), [NO_ERROR]
            accuracy = lambda: none if absent[i] >= 1.0 else self.errors_of(i)  # noqa: E731
            must, base = lambda: bool(judged()[i]), self._robot.base_frame
            return followed_task(self.names[i], each, rows, accuracy, base, must)

        return [of(i, each) for i, each in enumerate(settings) if i not in self.presses]

    def errors_of(self, i: int) -> list[TaskError]:
        """Errors of task i at the last `update`, each with its tolerance."""
        if i in self._functions:
            return self._functions[i].accuracy()
        settings, error = self._parameters[i], self.error[self.rows[i]]
        if i in self._joints:
            prismatic = prismatic_joints(self._robot)[self._joints[i]]
            return joint_errors(error, prismatic, settings.tolerance_m, settings.tolerance_deg)
        found = length_error(error[:POSITION], settings.tolerance_m)
        if len(error) == POSE:
            found += angle_error(error[POSITION:], settings.tolerance_deg)
        if i in self.presses:
            found += self.presses[i].errors
        return found

    def gain(self, gains: Sequence[Gains]) -> None:
        """Take gains kp and kd of all tasks."""
        for i, each in enumerate(gains):
            self._gains[i] = each.both

    def tolerate(self, i: int, length_m: float, angle_deg: float) -> None:
        """Take the tolerances of a pose, task i."""
        wanted = {"tolerance_m": length_m, "tolerance_deg": angle_deg}
        self._parameters[i] = self._parameters[i].model_copy(update=wanted)

    def brake(self, braking_per_s: float) -> None:
        """Take d [1/s], no faster than to rest at once."""
        self._braking = -min(braking_per_s, 1.0 / self._robot.period_s)

    def parts(self) -> list[Part]:
        """Parameters of the tasks, as far as they may change."""
        found: list[Part] = []
        for i, (name, parameters) in enumerate(zip(self.names, self._parameters, strict=True)):
            if i in self._functions:
                found += part_of(self._functions[i], ("tasks", name), ("tasks", i))
                continue
            self._parameters[i] = private(parameters)  # what counts is read where it is needed
            path, place = ("tasks", name, "parameters"), ("tasks", i, "parameters")
            found.append(Part(path, place, self._parameters[i], None, FIXED))
        return found

    def _located(self, i: int) -> AbstractContextManager[None]:
        """Errors inside it are those of the parameters of task i."""
        return located(self._file, f"parameters.tasks.{i}.parameters")

    def _of_kind(self, kind: int) -> list[int]:
        return [i for i, each in enumerate(self._kinds) if each == kind]

    def _kind_of(self, task: type, parameters: Any) -> int:
        """How the kernel knows a task."""
        from hoap3.remote_controller.tasks.accelerations import task_acceleration_kernels as kernels

        if task is WrenchTask:
            return kernels.ROOT_POSE if parameters.oriented else kernels.POSITION
        if task not in {FramePositionTask, FramePoseTask, PostureTask} or parameters.weights:
            return kernels.GIVEN
        if task is PostureTask:
            moves = parameters.approach_s or parameters.target is not None
            return kernels.GIVEN if moves else kernels.POSTURE
        if isinstance(parameters.target, TrajectorySettings):
            return kernels.GIVEN
        if parameters.reference and not stands(self._robot, parameters.reference):
            return kernels.GIVEN
        if task is FramePositionTask:
            return kernels.POSITION if parameters.axes == AXES else kernels.GIVEN
        turns = parameters.turn_s or not is_still(parameters.target)
        return kernels.GIVEN if turns else kernels.POSE

    def _size_of(self, i: int) -> int:
        """How many rows a task has."""
        if i in self._functions:
            return len(self._functions[i].followed[0])
        if i in self._joints:
            return len(self._joints[i])
        from hoap3.remote_controller.tasks.accelerations import task_acceleration_kernels as kernels

        return POSITION if self._kinds[i] in {kernels.POSITION, kernels.TURN} else POSE

    def _rows_of(self, i: int) -> TaskRows:
        mine = self.rows[i]
        error, motion, rate, slope, _ = (each[mine] for each in self._rows)
        return TaskRows(error, motion, rate, slope, self.jacobian[mine, -self._robot.n :])

    def _motion_of(self, i: int) -> TaskMotion:
        mine = self.rows[i]
        error, motion, _, slope, wanted = (each[mine] for each in self._rows)
        drift = self.dynamics.drift[mine]
        return TaskMotion(self.jacobian[mine], drift, error, motion, slope, wanted)

    def _turned_rows_of(self, i: int) -> tuple[FloatArray, ...]:
        """What `turn_to_root` takes of task i."""
        dynamics, mine = self.dynamics, self.rows[i]
        rotation = dynamics.rotations[self.tasks[i, 3]]
        return rotation, self.jacobian[mine], dynamics.twist[mine], dynamics.drift[mine]

    def _sensed_by(self, i: int) -> Sensed:
        dynamics, sensor = self.dynamics, self._sensor_of[i]
        frame, place = self.tasks[i, 3], self._first_sensor + sensor
        wrench = self._wrench[SENSOR * sensor : SENSOR * (sensor + 1)]
        origins = dynamics.origins
        return Sensed(dynamics.rotations[place], wrench, origins[place], origins[frame])

    def _find_sensors(self) -> list[str]:
        """Sensors that are felt, each once; `_sensor_of` says which of them is a task's."""
        known, found = self._robot.wrench_sensors, []
        self._sensor_of: dict[int, int] = {}
        for i, each in enumerate(self._parameters):
            if isinstance(each, WrenchTask.Parameters):
                sensor = each.sensor or each.frame
                if sensor not in known:
                    key, remedy = "sensor" if each.sensor else "frame", ", ".join(known) or "none"
                    problem = "the robot has no wrench sensor there"
                    with self._located(i):
                        raise ConfigError("", key, sensor, problem, f"Its sensors: {remedy}")
                if sensor not in found:
                    found.append(sensor)
                self._sensor_of[i] = found.index(sensor)
        return found

    def _dynamics(self, m: int) -> Any:
        """Of the frames of all tasks and sensors, and rows of I for joints."""
        rows = []
        for i, each in enumerate(self._parameters):
            if i in self._functions or i in self._joints:
                continue
            if each.frame not in self._robot.frames:
                remedy = one_of(each.frame, self._robot.frames, "Its frames")
                problem = f"robot {self._robot.name!r} has no such frame"
                with self._located(i):
                    raise ConfigError("", "frame", each.frame, problem, remedy)
            rows.append(self._frame_rows(i))
        n = self._robot.n
        end, sensors = m + n, self._sensors  # rows of I come first
        rows += [FrameRows(name, end + SENSOR * s, SENSOR) for s, name in enumerate(sensors)]
        dynamics = self._dynamics_of(rows, end + SENSOR * len(sensors))
        of_joints = dynamics.jacobian[:, -n:]
        of_joints[m:end] = np.eye(n)
        for i, joints in self._joints.items():
            of_joints[np.arange(len(joints)) + self.rows[i].start, joints] = 1.0
        return dynamics

    def _dynamics_of(self, frames: list[FrameRows], rows: int) -> Any:
        """Of a robot whose root stands."""
        return FramesDynamics(self._robot, frames, rows)

    def _frame_rows(self, i: int) -> FrameRows:
        """Where the motion of what task i moves stands."""
        return FrameRows(self._parameters[i].frame, self.rows[i].start, self.sizes[i])

    def _aim(self, i: int, frame: int) -> None:
        """Where a task shall lead."""
        parameters, mine = self._parameters[i], self.rows[i]
        if i in self._joints:
            joints = self._joints[i]
            self._posture[mine] = positions_of(self._robot, parameters, joints)
            self._of_joint[mine] = joints
        elif frame < 0:
            return
        elif isinstance(parameters, FramePoseTask.Parameters):
            pose = pose_of(self._robot, self.dynamics, parameters)
            if pose is None:
                self._held.append((i, frame))
            else:
                self._targets[i, 0], self._turns[i] = pose
        else:
            self._aim_at_point(i, frame, parameters)

    def _aim_at_point(self, i: int, frame: int, parameters: Any) -> None:
        robot, period, aim = self._robot, self._robot.period_s, parameters.target
        if isinstance(aim, TrajectorySettings) and aim.watched:
            problem = "has tolerances, which a wrench beside it makes no sense of"
            remedy = "Leave path_tolerance and goal_tolerance out"
            raise ConfigError("", "target", None, problem, remedy)
        origin, axes = reference_of(robot, self.dynamics, parameters.reference, "reference")
        target = target_of(parameters.target, Path(self._file).parent)
        place = PositionReference(target, origin, axes, period, self._targets[i])
        self._places.append((i, place))
        if target.rests_after_s > 0.0:
            self._moving.append(place)
        if isinstance(parameters, WrenchTask.Parameters):
            contact = parameters.contact_axes(axes)
            self.presses[i] = WrenchControl(parameters, contact, robot.n, period)
            if isinstance(parameters.rotation_rad, tuple):
                self._turns[i] = turned(axes, parameters.rotation_rad)
            elif parameters.oriented:
                self._held.append((i, frame))


def is_still(target: TargetSettings | None) -> bool:
    """Whether a target stays where it is from the start on."""
    return target is None or (isinstance(target, PointSettings) and not target.approach_s)
