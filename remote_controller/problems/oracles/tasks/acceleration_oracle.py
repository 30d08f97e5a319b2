"""Desired accelerations of tasks (Del Prete, IEEE RA-L 2018, (34)).

With the error e = x_d − x, ė = −ν, where ν is the velocity relative to the target and
ν̇ = J·q̈ + ν̇₀. A task desires J·q̈ = kp·e − kd·ν − ν̇₀. Positions and wrenches have rows in the root's
axes, poses in the frame's own.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.robot.description import RobotDescription
from hoap3.remote_controller.problems.oracles.parameters import UnverifiableError, is_number
from hoap3.remote_controller.problems.oracles.robot_oracle import Robot
from hoap3.remote_controller.problems.oracles.tasks.config_oracle import (
    is_live,
    place_of,
    posture_of,
    task_of,
)
from hoap3.remote_controller.problems.oracles.tasks.live_oracle import live_of
from hoap3.remote_controller.problems.oracles.tasks.logarithm_oracle import (
    pose_logarithm,
    rotation_of,
)
from hoap3.remote_controller.problems.oracles.tasks.target_oracle import Target
from hoap3.remote_controller.problems.oracles.tasks.task_oracle import AnyTask
from hoap3.remote_controller.problems.oracles.tasks.trajectories_oracle import TRAJECTORY
from hoap3.remote_controller.problems.statement import Claim

Array = NDArray[np.float64]
Settings = Mapping[str, Any]

AXES = ["x", "y", "z"]
ROUNDING = 64 * np.finfo(float).eps
"""Of a position that is the sum of some ten products, relative to the largest number in it."""
BY_DIFFERENCES = 1e-10  # of a drift that is a difference quotient, relative to what it is of


class TaskRows(NamedTuple):
    """A task in one cycle.

    Attributes:
        jacobian: J, (m, n).
        error: e, (m,) [m, rad].
        motion: ν, (m,) [m/s, rad/s].
        rate: ν̇₀, (m,) [m/s², rad/s²]: ν̇ where q̈ = 0.
        slope: (m,), V̇ = slope·ν of V = ½|e|².
        exact: rounding errors of e, ν and ν̇₀, (3, m).
    """

    jacobian: Array
    error: Array
    motion: Array
    rate: Array
    slope: Array
    exact: Array


class AccelerationTask(ABC):
    """A task; `robot` is placed at q and moved with dq before every call."""

    @abstractmethod
    def begin(self, robot: Robot, time_s: float) -> None:
        """Start from the present configuration at a time [s]."""

    @property
    def watched(self) -> bool:
        """Whether it has tolerances, which `watch` compares."""
        return False

    def watch(self, robot: Robot, time_s: float) -> None:  # noqa: B027 - most have no tolerances
        """Compare with tolerances, once for each State."""

    @property
    def by_differences(self) -> bool:
        """Whether changed parameters make another task of it, which takes over its memory."""
        return False

    def take_over(self, other: AccelerationTask) -> None:  # noqa: B027 - most are never replaced
        """Continue with the memory of a task of which only weights differ."""

    def derivative_claims(self, robot: Robot) -> list[Claim]:
        """As of the tasks of velocity controllers."""
        del robot
        return []

    @abstractmethod
    def at(self, robot: Robot, dq: Array, time_s: float, period_s: float) -> TaskRows:
        """Evaluate the rows at a time [s]."""


class PositionTask(AccelerationTask):
    """The origin of a frame, with a target in a frame that no joint moves: e = x_d − x.

    Without a reference, the target is in the root's axes, of a free base in the world's.
    """

    def __init__(self, target: Target, frame: str, reference: str | None, robot: Robot) -> None:
        self._target, self._frame = target, frame
        self._origin, self._axes = np.zeros(3), np.eye(3)
        if reference is not None:
            robot.place(robot.description.initial_position)
            self._origin, self._axes = root_pose(robot, reference)
        self.acceleration = np.zeros(3)
        """Of the target in this period, in the root's axes [m/s²]."""

    def begin(self, robot: Robot, time_s: float) -> None:
        """Start the target from the frame's origin."""
        p, _ = root_pose(robot, self._frame)
        self._target.start(self._axes.T @ (p - self._origin), time_s)

    def motion(self, robot: Robot) -> tuple[Array, Array, Array, Array]:
        """Return x, J, J·v and J̇·v of what moves."""
        J, twist, drift = (each[:3] for each in robot.frame_motion(self._frame, own_axes=False))
        return root_pose(robot, self._frame)[0], J, twist, drift

    def at(self, robot: Robot, dq: Array, time_s: float, period_s: float) -> TaskRows:
        """Evaluate the rows of the position."""
        p, J, twist, drift = self.motion(robot)
        moves = [self._axes @ each for each in self._target.over(time_s, period_s)]
        self.acceleration = moves[2]
        wanted, error = self._origin + moves[0], self._origin + moves[0] - p
        size = np.abs(wanted).max() + np.abs(p).max()
        speed, gains = np.abs(J) @ np.abs(dq) + np.abs(moves[1]), np.abs(moves[2])
        exact = _exact(size, speed, gains + np.abs(dq).max() * speed + 4.0 * speed * time_s)
        return TaskRows(J, error, twist - moves[1], drift - moves[2], -error, exact)


class PoseTask(AccelerationTask):
    """A frame with a constant target: e = log(H⁻¹H_d), in the frame's own axes."""

    def __init__(self, frame: str, goal: tuple[Array, Array] | None) -> None:
        self._frame, self._goal, self._held = frame, goal, goal is None

    def begin(self, robot: Robot, time_s: float) -> None:
        """Hold the present pose if the config has no target."""
        del time_s
        if self._held:
            self._goal = root_pose(robot, self._frame)

    def at(self, robot: Robot, dq: Array, time_s: float, period_s: float) -> TaskRows:
        """ė = A·(−v − ω × t, −ω), A of the logarithm at t = Rᵀ(p_d − p) and RᵀR_d."""
        del time_s, period_s
        J, twist, drift = robot.frame_motion(self._frame, own_axes=True)
        p, R = root_pose(robot, self._frame)
        place, turn = self._goal or (p, R)
        t = R.T @ (place - p)
        e, rates = pose_logarithm(t, R.T @ turn)
        away = -np.eye(6)
        away[:3, 3:] = np.cross(np.eye(3), t)  # [t]×
        speed = np.abs(J) @ np.abs(dq)
        stiff = 1.0 + np.abs(rates).max()
        size = stiff * (np.abs(place).max() + np.abs(p).max() + 1.0)
        exact = _exact(size, speed, np.abs(dq).max() * speed)
        return TaskRows(J, e, twist, drift, e @ rates @ away, exact)


class PostureTask(AccelerationTask):
    """Some joints with constant targets: e = q_r − q."""

    def __init__(self, joints: list[int], target: Array, n: int) -> None:
        self._joints, self._target, self._J = joints, target, np.eye(n)[joints]

    def begin(self, robot: Robot, time_s: float) -> None:
        """Nothing to do."""

    def at(self, robot: Robot, dq: Array, time_s: float, period_s: float) -> TaskRows:
        """Evaluate the rows of the joints."""
        del time_s, period_s
        q = robot.positions[self._joints]
        e, none = self._target - q, np.zeros(len(q))
        exact = np.array([np.spacing(np.abs(q) + np.abs(self._target)), none, none])
        return TaskRows(self._J, e, dq[self._joints], none, -e, exact)


class FiniteDifference(AccelerationTask):
    """Any other task, with ν̇₀ by finite differences along the motion."""

    def __init__(self, task: AnyTask) -> None:
        self._task = task

    def begin(self, robot: Robot, time_s: float) -> None:
        """Start the task."""
        self._task.begin(robot, time_s)

    @property
    def by_differences(self) -> bool:
        """Always."""
        return True

    @property
    def watched(self) -> bool:
        """As of the task."""
        return self._task.watched

    def watch(self, robot: Robot, time_s: float) -> None:
        """Compare with the task's tolerances."""
        self._task.watch(robot, time_s)

    def take_over(self, other: AccelerationTask) -> None:
        """Take over the target and the tolerances."""
        if isinstance(other, FiniteDifference):
            self._task.take_over(other._task)

    def derivative_claims(self, robot: Robot) -> list[Claim]:
        """As of the task."""
        return self._task.derivative_claims(robot)

    def at(self, robot: Robot, dq: Array, time_s: float, period_s: float) -> TaskRows:
        """Evaluate ν = ė of the task's e, which has the opposite sign of ours."""
        motion, rate = self._task.motion(robot, robot.positions, dq, time_s, period_s)
        rows = self._task.at(robot, time_s)
        speed = np.abs(rows.jacobian) @ np.abs(dq) + np.abs(rows.rate)
        exact = _exact(1.0 + np.abs(rows.error), speed, np.abs(dq).max() * speed)
        exact[2] += BY_DIFFERENCES * (speed + np.abs(rate) + ROUNDING * speed / period_s)
        return TaskRows(rows.jacobian, -rows.error, motion, rate, rows.error, exact)


def stack_rows(rows: Sequence[TaskRows]) -> TaskRows:
    """Stack the rows of several tasks."""
    whole = [np.concatenate(part) for part in zip(*(each[:5] for each in rows), strict=True)]
    jacobian, error, motion, rate, slope = whole
    exact = np.hstack([each.exact for each in rows])
    return TaskRows(jacobian, error, motion, rate, slope, exact)


def acceleration_task_of(entry: Settings, robot: Robot) -> AccelerationTask:
    """Return the task of an entry of a config.

    Raises:
        UnverifiableError: what cannot be recomputed, with the reason.
    """
    name, given, n = entry.get("task"), entry.get("parameters") or {}, robot.description.n
    task = task_of(entry, robot)  # which validates the parameters
    if given.get("weights"):
        return FiniteDifference(task)
    if (given.get("target") or {}).get("kind") == TRAJECTORY:
        return FiniteDifference(task)
    if name == "posture" and not given.get("approach_s") and given.get("target") is None:
        joints = [*robot.description.joint_names]
        named = [joints.index(joint) for joint in given.get("joints") or joints]
        values = given.get("target_rad") or ()
        if len(values) != len(named):
            values = posture_of(robot.description, given.get("posture"), values)[named]
        return PostureTask(named, np.array(values, float), n)
    reference = given.get("reference") or robot.description.base_frame
    if name not in {"frame_position", "frame_pose"} or not stands(robot.description, reference):
        return FiniteDifference(task)
    if name == "frame_position":
        whole = list(given.get("axes") or AXES) == AXES
        target = place_target_of(given.get("target"), robot)
        return (
            PositionTask(target, given["frame"], reference, robot)
            if whole
            else FiniteDifference(task)
        )
    if given.get("turn_s") or not is_still(given.get("target")):
        return FiniteDifference(task)
    return PoseTask(given["frame"], _goal(given, reference, robot))


def place_target_of(given: Settings | None, robot: Robot) -> Target:
    """Return the target of a position, (3,)."""
    return live_of(given, robot.messages) if is_live(given) else place_of(given)


def stands(description: RobotDescription, frame: str) -> bool:
    """Return whether no joint moves a frame."""
    parents = {joint.child: joint for joint in description.structure.joints}
    while frame in parents and parents[frame].name not in description.structure.moved:
        frame = parents[frame].parent
    return frame not in parents


def root_pose(robot: Robot, frame: str) -> tuple[Array, Array]:
    """Return copies of a frame's origin (3,) and axes (3, 3) in the root."""
    p, R, _ = robot.in_root(frame)
    return p.copy(), R.copy()


def is_still(target: Settings | None) -> bool:
    """Return whether a target stays where it is from the start on."""
    return target is None or (
        target.get("kind", "point") == "point" and not target.get("approach_s")
    )


def _goal(given: Settings, reference: str, robot: Robot) -> tuple[Array, Array] | None:
    """Return the target of a pose in the root's axes; None: the pose at the start."""
    target = given.get("target")
    if target is not None:
        robot.place(robot.description.initial_position)
        origin, axes = root_pose(robot, reference)
        turn = np.array(given.get("rotation_rad") or np.zeros(3), float)
        return origin + axes @ np.array(target["position_m"]), axes @ rotation_of(turn)
    if given.get("posture") is None and not given.get("posture_rad"):
        return None
    wanted = given.get("posture"), given.get("posture_rad") or ()
    robot.place(posture_of(robot.description, *wanted))
    return root_pose(robot, given["frame"])


def gains_of(entry: Settings) -> tuple[float, float]:
    """Return the gains kp [1/s²] and kd [1/s], by default those of critical damping."""
    kp, kd = entry.get("kp", 10.0), entry.get("kd")
    if not is_number(kp) or kp < 0.0 or not (kd is None or is_number(kd)):
        raise UnverifiableError(f"gains are {kp!r:.40} and {kd!r:.40}")
    return float(kp), 2.0 * math.sqrt(kp) if kd is None else float(kd)


def _exact(size: Any, speed: Array, acceleration: Array) -> Array:
    """Return rounding errors of e, ν and ν̇₀, (3, m), from the sizes of their terms."""
    return ROUNDING * np.array([np.broadcast_to(size, speed.shape), speed, acceleration])
