"""Where the target of the shown point was at each State: fixed, moving, or sent during the run."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from hoap3.protocol.messages import Event, FloatArray, Target
from hoap3.protocol.robot.description import COM, RobotDescription
from hoap3.protocol.runtime.shm_ring import Kind
from hoap3.remote_controller.problems.oracles.parameters import UnverifiableError
from hoap3.remote_controller.problems.oracles.robot_oracle import Robot
from hoap3.remote_controller.problems.oracles.tasks.config_oracle import task_of
from hoap3.remote_controller.problems.oracles.tasks.live_oracle import Messages, Taken
from hoap3.remote_controller.problems.oracles.tasks.task_oracle import Task
from hoap3.tools.logs.log import Log

POSITIONS = frozenset({"com", "frame_position", "frame_pose"})
"""Tasks whose target is a position, or begins with one."""
KINDS = frozenset({"point", "circle", "lemniscate", "waypoints", "live"})
"""Targets that need no other file."""
_RESET = Event.schema.constants["RESET"]


@dataclass(frozen=True)
class PositionTask:
    """An entry of a config's tasks that brings a point to a target.

    Attributes:
        point: `com` or a frame.
        frame: that the target is given in.
        entry: as the config has it.
    """

    point: str
    frame: str
    entry: Mapping[str, Any]

    @property
    def is_live(self) -> bool:
        """Whether its target is sent during the run."""
        return bool(self.entry["parameters"]["target"]["kind"] == "live")


def find_position_task(
    parameters: Mapping[str, Any], description: RobotDescription, point: str, frame: str
) -> PositionTask | None:
    """Return the first task with a live target, else the first that moves `point` in `frame`."""
    found = list(_position_tasks(parameters, description))
    live = [task for task in found if task.is_live]
    same = [task for task in found if (task.point, task.frame) == (point, frame)]
    return next(iter(live + same), None)


def _position_tasks(
    parameters: Mapping[str, Any], description: RobotDescription
) -> Iterator[PositionTask]:
    entries = parameters.get("tasks")
    for entry in entries if isinstance(entries, list) else [parameters.get("task")]:
        if not isinstance(entry, Mapping) or str(entry.get("task")) not in POSITIONS:
            continue
        given, is_com = entry.get("parameters"), entry["task"] == COM
        target = given.get("target") if isinstance(given, Mapping) else None
        if not isinstance(given, Mapping) or not isinstance(target, Mapping):
            continue
        if str(target.get("kind")) not in KINDS or given.get("axes"):  # of some axes
            continue
        point = COM if is_com else str(given.get("frame"))
        frame = str(given.get("frame", "r_sole") if is_com else given.get("reference") or "")
        frame = frame or description.base_frame
        if point in (COM, *description.frames) and frame in description.frames:
            yield PositionTask(point, frame, entry)


def target_path(
    task: PositionTask, log: Log, states: Any, every: int, description: RobotDescription
) -> FloatArray:
    """Where a task's target was.

    Args:
        task: whose target.
        log: of the controller.
        states: of one session, in which the robot was active, in the order of their ticks.
        every: one of so many States is evaluated.
        description: of the robot.

    Returns:
        (m, 3) [m]; NaN before the first State from which the log has all that it depends on.

    Raises:
        UnverifiableError: it cannot be computed.
    """
    ticks, session_id = states["tick"].astype(np.int64), int(states["session_id"][0])
    messages = Messages(names=log.names("targets"))
    if task.is_live:
        for taken in _taken(log, session_id, description.period_s):
            messages.add(taken)
    robot = Robot(description, messages)
    followed = task_of(task.entry, robot)
    if not isinstance(followed, Task):
        raise UnverifiableError("its task has no target")
    _, events = log.table(Kind.EVENT)
    resets = events[(events["kind"] == _RESET) & (events["session_id"] == session_id)]["detail"]
    begins = np.flatnonzero(np.isin(ticks, resets.astype(np.int64)))
    shown = np.arange(0, len(ticks), every)
    path = np.full((len(shown), 3), np.nan)
    for begin, end in itertools.pairwise([*begins.tolist(), len(ticks)]):
        robot.place(np.asarray(states[begin]["q"], float))
        followed.begin(robot, float(ticks[begin] * description.period_s))
        for row in np.flatnonzero((shown >= begin) & (shown < end)).tolist():
            time_s = float(ticks[shown[row]] * description.period_s)
            path[row] = followed.target.at(time_s)[0][:3]
    return path


def _taken(log: Log, session_id: int, period_s: float) -> Iterator[Taken]:
    """The messages that a controller took, each with the tick that it had answered before."""
    stamps, answers = log.table(Kind.SETPOINT)
    for record in log.records(Kind.TARGET):
        if Target.scalars(record.payload, "session_id") != (session_id,):
            continue
        answered = int(np.searchsorted(stamps, record.stamp, "right")) - 1
        tick = int(answers["tick"][answered]) if answered >= 0 else -1
        yield Taken.of(record.payload, tick, period_s)
