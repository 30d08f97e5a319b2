"""Tasks of a robot whose base is free: frames and the centre of mass in the world, z up.

`frame_position`, `frame_pose` and `frame_orientation` without a `reference`, and `com`, are in the
world; the target of the latter is given in its `frame` as that is at the start. All other tasks are
seen from a frame of the robot, and no motion of the base changes them.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from hoap3.remote_controller.problems.oracles.free_robot_oracle import BASE, FreeRobot
from hoap3.remote_controller.problems.oracles.parameters import UnverifiableError
from hoap3.remote_controller.problems.oracles.robot_oracle import Robot
from hoap3.remote_controller.problems.oracles.tasks.acceleration_oracle import (
    AXES,
    ROUNDING,
    AccelerationTask,
    Array,
    FiniteDifference,
    PoseTask,
    PositionTask,
    TaskRows,
    acceleration_task_of,
    is_still,
    place_target_of,
    root_pose,
)
from hoap3.remote_controller.problems.oracles.tasks.config_oracle import posture_of, task_of
from hoap3.remote_controller.problems.oracles.tasks.logarithm_oracle import (
    rotation_of,
    rotation_vector,
)
from hoap3.remote_controller.problems.oracles.tasks.target_oracle import Target
from hoap3.remote_controller.problems.statement import Claim

Settings = Mapping[str, Any]


class ComTask(PositionTask):
    """The centre of mass: e = c_d − c, with a target in a frame as that is at the start."""

    def __init__(self, target: Target, reference: str, robot: FreeRobot) -> None:
        super().__init__(target, reference, reference, robot)
        self._reference, self._free = reference, robot

    def begin(self, robot: Robot, time_s: float) -> None:
        """Place the frame of the target, and start the target from the centre of mass."""
        self._origin, self._axes = root_pose(robot, self._reference)
        self._target.start(self._axes.T @ (self.motion(robot)[0] - self._origin), time_s)

    def motion(self, robot: Robot) -> tuple[Array, Array, Array, Array]:
        """Centre of mass, J, ċ and J̇·v."""
        del robot
        return self._free.com_motion()


class TurnTask(AccelerationTask):
    """Axes of a frame that stay: e = φ with exp[φ] = R_d Rᵀ, in the world's axes."""

    def __init__(self, frame: str, goal: Array | None) -> None:
        self._frame, self._goal, self._held = frame, goal, goal is None

    def begin(self, robot: Robot, time_s: float) -> None:
        """Hold the present axes if the config has none."""
        del time_s
        if self._held:
            self._goal = root_pose(robot, self._frame)[1]

    def at(self, robot: Robot, dq: Array, time_s: float, period_s: float) -> TaskRows:
        """½|φ|² changes with −φ·ω."""
        del time_s, period_s
        J, twist, drift = (each[3:] for each in robot.frame_motion(self._frame, own_axes=False))
        _, R = root_pose(robot, self._frame)
        e = rotation_vector((R if self._goal is None else self._goal) @ R.T)
        speed = np.abs(J) @ np.abs(dq)
        exact = ROUNDING * np.array([np.ones(3), speed, np.abs(dq).max() * speed])
        return TaskRows(J, e, twist, drift, -e, exact)


class PosturePose(PoseTask):
    """A frame where a posture has it, with the base as it is at the start."""

    def __init__(self, frame: str, posture: Array, robot: FreeRobot) -> None:
        super().__init__(frame, None)
        self._posture, self._free = posture, robot

    def begin(self, robot: Robot, time_s: float) -> None:
        """Place the posture."""
        present, dq = robot.positions, self._free.v[BASE:]
        robot.place(self._posture)
        super().begin(robot, time_s)
        robot.place(present)
        robot.move(dq)


class JointsOnly(AccelerationTask):
    """A task that is seen from the robot: no motion of the base is part of it."""

    def __init__(self, task: AccelerationTask, robot: FreeRobot) -> None:
        self._task, self._fixed = task, robot.fixed

    def begin(self, robot: Robot, time_s: float) -> None:
        """Start the task."""
        del robot
        self._task.begin(self._fixed, time_s)

    @property
    def watched(self) -> bool:
        """As of the task."""
        return self._task.watched

    def watch(self, robot: Robot, time_s: float) -> None:
        """Compare with the task's tolerances."""
        del robot
        self._task.watch(self._fixed, time_s)

    def take_over(self, other: AccelerationTask) -> None:
        """Take over what the task remembers."""
        if isinstance(other, JointsOnly):
            self._task.take_over(other._task)

    def derivative_claims(self, robot: Robot) -> list[Claim]:
        """As of the task."""
        del robot
        return self._task.derivative_claims(self._fixed)

    @property
    def by_differences(self) -> bool:
        """As of the task."""
        return self._task.by_differences

    def at(self, robot: Robot, dq: Array, time_s: float, period_s: float) -> TaskRows:
        """Evaluate the rows, with columns of 0 for the base."""
        del robot
        rows = self._task.at(self._fixed, dq[BASE:], time_s, period_s)
        J = np.hstack([np.zeros((len(rows.jacobian), BASE)), rows.jacobian])
        return rows._replace(jacobian=J)


def free_task_of(entry: Settings, robot: FreeRobot) -> AccelerationTask:
    """Return the task of an entry of a config.

    Raises:
        UnverifiableError: what cannot be recomputed, with the reason.
    """
    name, given = entry.get("task"), entry.get("parameters") or {}
    if name == "wrench":
        raise UnverifiableError("a wrench of a free base is not recomputed")
    seen = task_of(entry, robot.fixed)  # which validates the parameters
    if name == "posture":
        return JointsOnly(acceleration_task_of(entry, robot.fixed), robot)
    if not given.get("weights"):
        if name == "com":
            target = place_target_of(given.get("target"), robot)
            return ComTask(target, given.get("frame", "r_sole"), robot)
        if given.get("reference") is None:
            found = _in_world(str(name), given, robot)
            if found is not None:
                return found
    return JointsOnly(FiniteDifference(seen), robot)


def _in_world(name: str, given: Settings, robot: FreeRobot) -> AccelerationTask | None:
    """Return the task of a frame without a reference; None where it is not in the world."""
    if name == "frame_position" and list(given.get("axes") or AXES) == AXES:
        target = place_target_of(given.get("target"), robot)
        return PositionTask(target, given["frame"], None, robot)
    turn = given.get("rotation_rad")
    axes = None if turn is None else rotation_of(np.array(turn, float))
    if name == "frame_orientation" and not given.get("turn_s") and given.get("target") is None:
        return TurnTask(given["frame"], axes)
    if name != "frame_pose" or given.get("turn_s") or not is_still(given.get("target")):
        return None
    if given.get("target") is not None:
        place = np.array(given["target"]["position_m"], float)
        return PoseTask(given["frame"], (place, np.eye(3) if axes is None else axes))
    if given.get("posture") is None and not given.get("posture_rad"):
        return PoseTask(given["frame"], None)
    wanted = given.get("posture"), given.get("posture_rad") or ()
    return PosturePose(given["frame"], posture_of(robot.description, *wanted), robot)
