"""`tsid`: tasks and a posture of little weight (Del Prete, IEEE RA-L 2018, (33) and (34)).

min Σ ω_i |J_i q̈ − b_i|² + w|q̈_p − q̈|² within the bounds of accelerations and torques.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from hoap3.remote_controller.problems.acceleration import TINY, AccelerationProblems, Wish
from hoap3.remote_controller.problems.acceleration_claims import Cycle
from hoap3.remote_controller.problems.oracles import acceleration_bounds_oracle as bounds
from hoap3.remote_controller.problems.oracles.parameters import UnverifiableError
from hoap3.remote_controller.problems.oracles.robot_oracle import Robot
from hoap3.remote_controller.problems.oracles.tasks.acceleration_oracle import root_pose
from hoap3.remote_controller.problems.oracles.tasks.config_oracle import default_entry, posture_of
from hoap3.remote_controller.problems.oracles.tasks.logarithm_oracle import rotation_vector
from hoap3.remote_controller.problems.schedule import Weights
from hoap3.remote_controller.problems.statement import Array, Flags
from hoap3.remote_controller.problems.weighted import LeastSquares, WeighedProblems, roots

Settings = Mapping[str, Any]

DEFAULTS: dict[str, Any] = {
    "tasks": None,
    "constraints": None,
    "bounds": bounds.HIERARCHY_DEFAULTS,
    "compensate_friction": True,
    "frame": None,
    "goal": None,
    "task": {"kp": 10.0, "kd": None},
    "posture": {"kp": 10.0, "kd": None, "posture": None, "posture_rad": (), "weight": 1e-3},
    "priorities": {"weights": None, "timeline": None},
}
POSE, REST = "pose", "rest"
LEAST_WEIGHT = 1e-9  # of the posture


class TasksOfTsid(AccelerationProblems):
    """Tasks and weights of `tsid`, with a fixed or a free base."""

    def entries(self, settings: Settings) -> list[Settings]:
        """Return the tasks, or one pose, and last the posture."""
        description, rest = self.history.description, settings["posture"]
        target = posture_of(description, rest["posture"], rest["posture_rad"]).tolist()
        gains = {"kp": rest["kp"], "kd": rest["kd"]}
        posture = {"name": REST, "task": "posture", "parameters": {"target_rad": target}, **gains}
        tasks = list(settings["tasks"] or ()) or [_pose(self._robot, settings)]
        return [*tasks, posture]

    def schedule(self, settings: Settings) -> Weights:
        """Return the weights, that of the posture last."""
        given = settings["priorities"]
        weights = {**(given["weights"] or {}), REST: settings["posture"]["weight"]}
        return Weights(self.names, {**given, "weights": weights})

    def tops(self, importance: Array) -> Flags:
        """Return the tasks with weight, without the posture."""
        tops = importance > 0.0
        tops[-1] = False
        return tops


class TsidProblems(TasksOfTsid, WeighedProblems):
    """The problems of `tsid`; arguments as of every `ProblemBuilder`."""

    defaults: ClassVar[Settings] = DEFAULTS

    def cost(self, cycle: Cycle) -> LeastSquares:
        """Return (33)."""
        weights = np.append(cycle.importance[:-1], max(cycle.importance[-1], LEAST_WEIGHT))
        scale = roots(weights, self.edges)
        J = scale[:, None] * cycle.rows.jacobian
        return LeastSquares(J, scale * cycle.desired, scale * cycle.desired_error)

    def wish(self, cycle: Cycle) -> Wish:
        """Return the same cost; where the solver gives up, the wish is that of the posture."""
        cost, ddq = self.cost(cycle), cycle.desired[self.edges[-2] :]
        span = max(TINY, float(np.abs(cycle.ddq).max()), float(np.abs(ddq).max()))
        return Wish(cost.R, cost.r, ddq, float(cost.error().max()) / span)


def _pose(robot: Robot, settings: Settings) -> Settings:
    """Return the one task of `goal`, or of the default task with its orientation at the start."""
    description, frame, goal = robot.description, settings["frame"], settings["goal"]
    entry = {"name": POSE, "task": "frame_pose", **settings["task"]}
    if goal is not None and frame is not None:
        given = {key: goal.get(key) for key in ("posture", "posture_rad", "reference")}
        if goal.get("position_m"):
            given["target"] = {"kind": "point", "position_m": goal["position_m"]}
            given["rotation_rad"] = goal.get("rotation_rad")
        return {**entry, "parameters": {"frame": frame, **given}}
    usual = default_entry(description)
    default = usual["parameters"]
    if usual["task"] != "frame_position" or frame not in {None, default["frame"]}:
        raise UnverifiableError("the robot's default task is for another point")
    robot.place(description.initial_position)
    seen_from, shown = (root_pose(robot, default[key])[1] for key in ("reference", "frame"))
    turn = rotation_vector(seen_from.T @ shown).tolist()
    return {**entry, "parameters": {**default, "rotation_rad": turn}}
