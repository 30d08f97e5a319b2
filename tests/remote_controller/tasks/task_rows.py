"""Tasks as controllers of accelerations have them: cases, and what looks at their rows."""

from __future__ import annotations

from typing import Any

import numpy as np
from registered_tasks import velocity_tasks
from task_cases import ARM, CASES, CIRCLE, FORCES, POINT, POSE, TOOL

from hoap3.protocol.messages import FloatArray
from hoap3.protocol.robot.description import RobotDescription
from hoap3.remote_controller.tasks.accelerations.acceleration_tasks import AccelerationTasks
from hoap3.remote_controller.tasks.accelerations.settings import AccelerationTask
from hoap3.remote_controller.tasks.registry import find, registered
from hoap3.robot_emulator.robots import load

HUMANOID = load("humanoid32")
SHORT = 1e-7  # s: a period so short that what a target does in it is its present acceleration
THERE = {"kind": "point", "position_m": [0.2, 0.1, 0.3]}
PALM = {"frame": "r_palm", "target": {**CIRCLE, "center_m": [0.3, -0.3, 0.2]}}
TURN = {"rotation_rad": [0.4, -1.1, 0.6]}
MORE: dict[str, tuple[RobotDescription, str, dict[str, Any]]] = {
    "tool at a point": (ARM, "frame_position", {**TOOL, "target": THERE}),
    "tool held": (ARM, "frame_position", {"frame": "tool"}),
    "tool comes": (ARM, "frame_position", {**TOOL, "target": POINT, "weights": [2.0]}),
    "tool's y and x": (ARM, "frame_position", {**TOOL, "target": THERE, "axes": ["y", "x"]}),
    "tool in a pose": (ARM, "frame_pose", {**TOOL, **TURN, "target": THERE}),
    "tool in a posture's": (ARM, "frame_pose", {"frame": "tool", "posture": "bent"}),
    "tool's pose held": (ARM, "frame_pose", {"frame": "tool"}),
    "tool turns": (ARM, "frame_orientation", {**TOOL, **POSE}),
    "arm": (ARM, "posture", {"posture": "bent"}),
    "arm, weighed": (ARM, "posture", {"posture": "bent", "weights": [1.0, 2.0, 0.5]}),
    "palm": (HUMANOID, "frame_position", PALM),
    "palm from palm": (HUMANOID, "frame_position", {**PALM, "reference": "l_palm"}),
    "palm's pose": (HUMANOID, "frame_pose", {**PALM, **POSE, "reference": "l_palm"}),
    "head": (HUMANOID, "frame_pose", {"frame": "head"}),
    "humanoid's mass": (HUMANOID, "com", {"frame": "l_sole", "target": POINT}),
}
ROWS = {**CASES, **FORCES, **MORE}


def acceleration_tasks() -> list[str]:
    """Registered tasks that an acceleration can serve."""
    return [name for name in sorted(registered()) if "acceleration" in find(name).levels]


def force_tasks() -> set[str]:
    """Those that no velocity can."""
    return set(acceleration_tasks()) - set(velocity_tasks())


class Rows:
    """Tasks that began at the robot's initial posture at 0 s, and what they say anywhere."""

    def __init__(
        self, robot: RobotDescription, *tasks: tuple[str, dict[str, Any]], period_s: float = SHORT
    ) -> None:
        self.robot = robot.model_copy(update={"period_s": period_s})
        given = [
            AccelerationTask(name=f"task_{i}", task=task, parameters=parameters)
            for i, (task, parameters) in enumerate(tasks)
        ]
        self.tasks = AccelerationTasks(
            self.robot,
            given,
            "config",
            np.array(self.robot.effort),
            compensate_friction=False,
        )
        self.tasks.brake(10.0)
        self._wrench = np.zeros(6 * len(robot.wrench_sensors))
        self._absent = np.zeros(len(given))
        self.begin()

    def begin(self, time_s: float = 0.0, q: FloatArray | None = None) -> None:
        """Start at rest, by default in the initial posture."""
        q = np.array(self.robot.initial_position) if q is None else q
        self.tasks.begin(q, np.zeros(self.robot.n), time_s, time_s + self.robot.period_s)

    def look(self, q: FloatArray, dq: FloatArray, time_s: float) -> AccelerationTasks:
        """The rows there and then; every look rewrites them."""
        next_s = time_s + self.robot.period_s
        self.tasks.update(q, dq, self._wrench, time_s, next_s, self._absent)
        return self.tasks

    def motion(self, q: FloatArray, dq: FloatArray, time_s: float) -> FloatArray:
        """ν, (m,)."""
        return self.look(q, dq, time_s).motion.copy()

    def value(self, q: FloatArray, dq: FloatArray, time_s: float) -> FloatArray:
        """V = ½|e|², as an array."""
        error = self.look(q, dq, time_s).error
        return np.array(0.5 * error @ error)


def rows_of(case: str, period_s: float = SHORT) -> Rows:
    """Rows of one of `ROWS`."""
    robot, task, parameters = ROWS[case]
    return Rows(robot, (task, parameters), period_s=period_s)


def motion_through(robot: RobotDescription, seed: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Random q within its range, q̇ and q̈."""
    rng = np.random.default_rng(seed)
    q = rng.uniform(robot.lower, robot.upper)
    return q, 0.5 * rng.normal(size=robot.n), 2.0 * rng.normal(size=robot.n)


def slope(function: Any, step: float) -> Any:
    """Derivative at 0 by central differences of two steps, to fourth order (Richardson)."""
    near, far = ((function(h) - function(-h)) / (2.0 * h) for h in (step, 2.0 * step))
    return (4.0 * near - far) / 3.0
