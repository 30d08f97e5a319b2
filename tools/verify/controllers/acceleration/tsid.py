"""`tsid`: tasks beside a posture of little weight (Del Prete, IEEE RA-L 2018, (33) and (34)).

min Σ ω_i |J_i q̈ − b_i|² + w|q̈_p − q̈|² within the bounds of accelerations and torques.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.robot.description import COM
from hoap3.remote_controller.problems.oracles import acceleration_bounds_oracle as bounds
from hoap3.remote_controller.problems.oracles.parameters import UnverifiableError
from hoap3.remote_controller.problems.oracles.robot_oracle import Robot
from hoap3.remote_controller.problems.oracles.tasks.acceleration_oracle import ROUNDING, root_pose
from hoap3.remote_controller.problems.oracles.tasks.config_oracle import default_entry, posture_of
from hoap3.remote_controller.problems.oracles.tasks.logarithm_oracle import rotation_vector
from hoap3.remote_controller.problems.schedule import Weights
from hoap3.tools.verify.claims import Claims
from hoap3.tools.verify.controller_log import ControllerRun
from hoap3.tools.verify.controllers.acceleration.certificate import Solution
from hoap3.tools.verify.controllers.acceleration.fallbacks import Soft
from hoap3.tools.verify.controllers.acceleration.family import Family, check_family
from hoap3.tools.verify.controllers.acceleration.hierarchy import Cycles, Hierarchy
from hoap3.tools.verify.controllers.acceleration.quadratic import optimum_of

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
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


class Tsid(Family):
    """The QP of (33) with the torques eliminated: H = Σ ω JᵀJ + w·I, f = −Σ ω Jᵀb − w·q̈_p."""

    defaults, proves = DEFAULTS, True

    def entries(self, run: ControllerRun, settings: Settings) -> list[Settings]:
        """The tasks, or one pose, and the posture."""
        robot, rest = run.description, settings["posture"]
        entries = list(settings["tasks"] or ())
        if not entries:
            entries = [_pose(run, settings)]
        target = posture_of(robot, rest["posture"], rest["posture_rad"]).tolist()
        gains = {"kp": rest["kp"], "kd": rest["kd"]}
        posture = {"name": REST, "task": "posture", "parameters": {"target_rad": target}, **gains}
        return [*entries, posture]

    def schedule(self, names: list[str], settings: Settings) -> Weights:
        """The weights, that of the posture last."""
        given = settings["priorities"]
        weights = {**(given["weights"] or {}), REST: settings["posture"]["weight"]}
        return Weights(names, {**given, "weights": weights})

    def tops(self, numbers: Array) -> Flags:
        """All tasks with weight, but not the posture."""
        tops = numbers > 0.0
        tops[:, -1] = False
        return tops

    def solution(self, cycles: Cycles, hierarchy: Hierarchy, settings: Settings) -> Solution:
        """The largest deviation: of q̈ relative to its span, of τ to the greatest torque."""
        del settings
        problem = _problem(cycles, hierarchy)
        return Solution(*optimum_of(*problem, cycles, hierarchy.torque_max), self.proves)

    def soft(self, cycles: Cycles, hierarchy: Hierarchy, settings: Settings) -> list[Soft]:
        """The same QP; the wish is that of the posture."""
        del settings
        H, f, _ = _problem(cycles, hierarchy)
        wishes = cycles.wanted[:, hierarchy.spans[-1]]
        return [Soft(*each) for each in zip(H, f, wishes, strict=True)]


def _problem(cycles: Cycles, hierarchy: Hierarchy) -> tuple[Array, Array, Array]:
    """H (N, n, n), f (N, n), and how exactly that is known."""
    weights = cycles.numbers.copy()
    weights[:, -1] = np.maximum(weights[:, -1], LEAST_WEIGHT)
    each = np.repeat(weights, hierarchy.sizes, axis=1)
    J, y = cycles.rows.jacobian, cycles.wanted
    weighted = np.swapaxes(each[..., None] * J, 1, 2)
    f = -(weighted @ y[..., None])[..., 0]
    doubt = cycles.wanted_exact + ROUNDING * np.abs(y)
    f_exact = (np.abs(weighted) @ doubt[..., None])[..., 0]
    return weighted @ J, f, f_exact


def check(run: ControllerRun, parameters: Settings, claims: Claims) -> None:
    """Everything that an answer of `tsid` says."""
    check_family(Tsid(), run, parameters, claims)


def _pose(run: ControllerRun, settings: Settings) -> Settings:
    """The one task of `goal`, or of the robot's default task with the orientation of the start."""
    robot, frame, goal = run.description, settings["frame"], settings["goal"]
    gains = {"kp": settings["task"]["kp"], "kd": settings["task"]["kd"]}
    if goal is not None and frame is not None:
        given = {key: goal.get(key) for key in ("posture", "posture_rad", "reference")}
        if goal.get("position_m"):
            given["target"] = {"kind": "point", "position_m": goal["position_m"]}
            given["rotation_rad"] = goal.get("rotation_rad")
        return {
            "name": POSE,
            "task": "frame_pose",
            "parameters": {"frame": frame, **given},
            **gains,
        }
    default = default_entry(robot)["parameters"]
    if default.get("frame") == COM or frame not in {None, default["frame"]}:
        raise UnverifiableError("the robot's default task is for another point")
    placed = Robot(robot)
    placed.place(robot.initial_position)
    seen_from, shown = (root_pose(placed, default[key])[1] for key in ("reference", "frame"))
    turn = rotation_vector(seen_from.T @ shown).tolist()
    return {
        "name": POSE,
        "task": "frame_pose",
        "parameters": {**default, "rotation_rad": turn},
        **gains,
    }
