"""Tasks as a log's config has them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeGuard

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.errors import FrameNotFoundError
from hoap3.protocol.robot.description import COM, RobotDescription
from hoap3.remote_controller.problems.oracles.parameters import UnverifiableError
from hoap3.remote_controller.problems.oracles.robot_oracle import Robot
from hoap3.remote_controller.problems.oracles.tasks.live_oracle import (
    live_of,
    live_orientation_of,
    live_pose_of,
    live_posture_of,
)
from hoap3.remote_controller.problems.oracles.tasks.logarithm_oracle import nearer, rotation_vector
from hoap3.remote_controller.problems.oracles.tasks.target_oracle import (
    Hold,
    Joined,
    Point,
    Target,
    target_of,
)
from hoap3.remote_controller.problems.oracles.tasks.task_oracle import (
    AXES,
    AnyTask,
    PlaceTask,
    PoseTask,
    PostureTask,
    SumTask,
    Task,
)
from hoap3.remote_controller.problems.oracles.tasks.tolerances_oracle import tolerances_of
from hoap3.remote_controller.problems.oracles.tasks.trajectories_oracle import (
    TRAJECTORY,
    trajectory_of,
)

Array = NDArray[np.float64]
Settings = Mapping[str, Any]


def task_of(entry: Settings, robot: Robot) -> AnyTask:
    """The task of an entry `{task: …, parameters: …}`.

    Args:
        entry: of the config; further keys, such as gains, are left alone.
        robot: that it is for; left at any joint positions.

    Raises:
        UnverifiableError: what cannot be recomputed, with the reason.
    """
    name, parameters = entry.get("task"), entry.get("parameters") or {}
    if name in NOT_RECOMPUTED or not isinstance(name, str):
        raise UnverifiableError(f"task {name!r:.60} is not recomputed")
    if name not in BUILDERS:
        from hoap3.remote_controller.problems.oracles.user_code_oracle import UserTask

        return UserTask(entry, robot)
    try:
        return _watching(BUILDERS[name](parameters, robot), name, parameters, robot)
    except UnverifiableError:
        raise
    except (KeyError, TypeError, ValueError, FrameNotFoundError) as error:
        raise UnverifiableError(f"task {name} cannot be read: {error!r:.80}") from error


def default_entry(
    description: RobotDescription,
    point: str | None = None,
    reference: str | None = None,
    place: Sequence[float] | None = None,
) -> Settings:
    """The robot's default task as an entry.

    Args:
        description: of the robot.
        point, reference, place: instead of the task's point, the frame that it is seen from, and
            its target, (3,) [m].

    Raises:
        UnverifiableError: it has no default task, and not all of it is given.
    """
    task = description.default_task
    if task is not None:
        point, reference = point or task.point, reference or task.reference
        place = place or task.target_m
    if point is None or reference is None or (place is None and task is None):
        raise UnverifiableError("the log names no task")
    if place is None and task is not None:
        robot = Robot(description)
        robot.place(description.initial_position)
        at_start = PlaceTask(Hold(3), np.ones(3), point, reference, AXES)
        place = (at_start.present(robot, np.zeros(3)) + np.array(task.move_m)).tolist()
    target = {"kind": "point", "position_m": place}
    if point == COM:
        return {"task": "com", "parameters": {"frame": reference, "target": target}}
    frames = {"frame": point, "reference": reference}
    return {"task": "frame_position", "parameters": {**frames, "target": target}}


def posture_of(description: RobotDescription, name: str | None, values: Sequence[float]) -> Array:
    """Joint positions (n,): the values, else the posture of that name, else the initial one."""
    if len(values):
        return np.array(values, float)
    return np.array(description.postures[name or description.initial_posture], float)


def _weights(given: Settings, dimension: int) -> Array:
    weights = np.array(given.get("weights") or (1.0,), float)
    if not (np.isfinite(weights).all() and (weights >= 0.0).all()):
        raise ValueError("weights")
    return np.broadcast_to(weights, (dimension,)).copy()


def _aim(given: Settings, robot: Robot, *, turns: bool = False) -> Target:
    """Where `target` leads, (3,); (6,) where it `turns` and says so."""
    target = given.get("target")
    if not is_live(target):
        return place_of(target, turns=turns)
    steered = turns and given.get("rotation_rad") is None
    return (live_pose_of if steered else live_of)(target, robot.messages)


def is_live(target: Settings | None) -> TypeGuard[Settings]:
    """Whether a config's `target` is steered."""
    return target is not None and target.get("kind") == "live"


def _com(given: Settings, robot: Robot) -> PlaceTask:
    reference = given.get("frame", "r_sole")
    target = _aim(given, robot)
    return PlaceTask(target, _weights(given, 3), COM, robot.known(reference), AXES)


def _frame_position(given: Settings, robot: Robot) -> PlaceTask:
    axes = list(given.get("axes") or AXES)
    target, weights = _aim(given, robot), _weights(given, len(axes))
    return PlaceTask(target, weights, *_frames(given, robot), axes)


def _frame_orientation(given: Settings, robot: Robot) -> PoseTask:
    steered = given.get("target")
    aim: Target = Hold(3) if given.get("rotation_rad") is None else _turn(given)
    if is_live(steered):
        aim = live_orientation_of(steered, robot.messages)
    return PoseTask(aim, _weights(given, 3), *_frames(given, robot))


def _frame_pose(given: Settings, robot: Robot) -> PoseTask:
    frame, reference = _frames(given, robot)
    aim: Target = Hold(6)
    if given.get("target") is not None:
        aim = _aim(given, robot, turns=True)
        if aim.dimension == len(AXES):
            aim = Joined(aim, _turn(given))
    elif given.get("posture") is not None or given.get("posture_rad"):
        wanted = given.get("posture"), given.get("posture_rad") or ()
        robot.place(posture_of(robot.description, *wanted))
        p, R, _ = robot.frame(frame, reference)
        aim = Point(np.concatenate([p, nearer(rotation_vector(R), np.zeros(3))]))
    return PoseTask(aim, _weights(given, 6), frame, reference)


def _posture(given: Settings, robot: Robot) -> PostureTask:
    known = list(robot.description.joint_names)
    joints = [known.index(name) for name in given.get("joints") or known]
    steered = given.get("target")
    if steered is not None:
        names = [known[i] for i in joints]
        aim: Target = (
            live_posture_of(steered, robot.messages, len(joints))
            if is_live(steered)
            else trajectory_of(steered, names)
        )
        return PostureTask(aim, _weights(given, len(joints)), joints)
    values = given.get("target_rad") or ()
    if len(values) == len(joints):
        target = np.array(values, float)
    else:
        target = posture_of(robot.description, given.get("posture"), values)[joints]
    aim = Point(target, float(given.get("approach_s", 0.0)))
    return PostureTask(aim, _weights(given, len(joints)), joints)


def _weighted_sum(given: Settings, robot: Robot) -> SumTask:
    terms = given["terms"]
    weights = [float(term.get("weight", 1.0)) for term in terms]
    return SumTask([task_of(term, robot) for term in terms], weights)


def place_of(given: Settings | None, *, turns: bool = False) -> Target:
    """The target of a position, (3,), or of a pose, (6,), where `turns` and it has turns."""
    if given is not None and given.get("kind") == TRAJECTORY:
        return trajectory_of(given, AXES, turns=turns)
    return target_of(given)


def _watching(task: AnyTask, name: str, given: Settings, robot: Robot) -> AnyTask:
    """The task with the tolerances of its trajectory, if it has any."""
    aim = given.get("target")
    if isinstance(task, Task) and isinstance(aim, Mapping) and aim.get("kind") == TRAJECTORY:
        task.tolerances = tolerances_of(aim, _components(name, given, robot), task.target)
    return task


def _components(name: str, given: Settings, robot: Robot) -> list[str]:
    """What the components of a task's error are called."""
    if name == "posture":
        return list(given.get("joints") or robot.description.joint_names)
    if name == "frame_pose":
        return [*AXES, "rx", "ry", "rz"]
    return list(given.get("axes") or AXES)


def _frames(given: Settings, robot: Robot) -> tuple[str, str]:
    reference = given.get("reference") or robot.description.base_frame
    return robot.known(given["frame"]), robot.known(reference)


def _turn(given: Settings) -> Point:
    turn = np.array(given.get("rotation_rad") or np.zeros(3), float)
    return Point(turn, float(given.get("turn_s", 0.0)))


BUILDERS: dict[str, Callable[[Settings, Robot], AnyTask]] = {
    "com": _com,
    "frame_orientation": _frame_orientation,
    "frame_pose": _frame_pose,
    "frame_position": _frame_position,
    "posture": _posture,
    "weighted_sum": _weighted_sum,
}
"""What makes a task, by its registered name."""
NOT_RECOMPUTED = frozenset({"joint_curve", "task_curve", "wrench"})
"""Ours that have no error of this kind; all others are users' own."""
