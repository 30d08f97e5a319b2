"""Robots and tasks for the tests of tasks."""

from __future__ import annotations

from functools import cache

from hypothesis import strategies as st
from support.arm3 import describe

from hoap3.protocol.robot.description import RobotDescription
from hoap3.remote_controller.model.kinematics import Kinematics
from hoap3.remote_controller.tasks.lyapunov import LyapunovFunction
from hoap3.remote_controller.tasks.registry import TaskSettings, build
from hoap3.robot_emulator.robots import load

HOAP3, ARM, LWR = load("hoap3"), describe(), load("lwr")
SEEDS = st.integers(0, 2**32 - 1)

LEMNISCATE = {
    "kind": "lemniscate",
    "center_m": [0.01, 0.02, 0.25],
    "half_width_m": 0.02,
    "period_s": 2.0,
    "plane": "yz",
}
CIRCLE = {"kind": "circle", "center_m": [0.2, 0.0, 0.1], "radius_m": 0.05, "period_s": 3.0}
WAYPOINTS = {
    "kind": "waypoints",
    "points_m": [[0.1, 0.0, 0.2], [0.1, 0.1, 0.2]],
    "speed_m_s": 0.1,
    "profile": "trapezoid",
}
POINT = {"kind": "point", "position_m": [0.01, 0.025, 0.28], "approach_s": 1.0}
POSE = {"rotation_rad": [0.4, -1.1, 0.6], "turn_s": 2.0}
HAND = {"frame": "r_forearm", "reference": "l_sole"}
TOOL = {"frame": "tool", "reference": "base"}
SUM = {
    "terms": [
        {"weight": 3.0, "task": "com", "parameters": {"target": POINT}},
        {"task": "posture", "parameters": {"posture": "q0", "weights": [0.01]}},
        {"weight": 0.5, "task": "frame_pose", "parameters": {**HAND, **POSE, "target": CIRCLE}},
    ]
}
CASES: dict[str, tuple[RobotDescription, str, dict]] = {
    "com": (HOAP3, "com", {"frame": "r_sole", "target": LEMNISCATE, "weights": [1.0, 2.0, 0.0]}),
    "hand": (HOAP3, "frame_position", {**HAND, "target": CIRCLE}),
    "tool": (ARM, "frame_position", {**TOOL, "target": WAYPOINTS}),
    "hand's z and x": (
        HOAP3,
        "frame_position",
        {**HAND, "target": CIRCLE, "axes": ["z", "x"], "weights": [1.0, 3.0]},
    ),
    "hand pose": (HOAP3, "frame_pose", {**HAND, **POSE, "target": CIRCLE}),
    "tool pose": (ARM, "frame_pose", {**TOOL, **POSE, "target": WAYPOINTS, "weights": [2.0]}),
    "hand orientation": (HOAP3, "frame_orientation", {**HAND, **POSE, "weights": [1.0, 2.0, 0.5]}),
    "posture": (HOAP3, "posture", {"posture": "walk_ready", "approach_s": 1.0}),
    "some joints": (ARM, "posture", {"joints": ["wrist", "elbow"], "target_rad": [0.2, 1.1]}),
    "sum": (HOAP3, "weighted_sum", SUM),
    "joint curve": (
        ARM,
        "joint_curve",
        {
            "curve_parameters": {"joints": ["elbow", "wrist"], "radii_rad": [0.3, 0.2]},
            "speed_rad_s": 0.4,
        },
    ),
    "task curve": (
        HOAP3,
        "task_curve",
        {
            "curve_parameters": {"center_m": [0.0, 0.03, 0.28], "radii_m": [0.02, 0.01]},
            "speed_m_s": 0.02,
        },
    ),
}
FORCES: dict[str, tuple[RobotDescription, str, dict]] = {
    "press": (
        LWR,
        "wrench",
        {"frame": "ee", "target": CIRCLE, "normal": [0.0, 0.0, 1.0], "force_n": 5.0},
    ),
}
"""Those that no velocity can serve."""


@cache
def kinematics_of(name: str) -> Kinematics:
    return Kinematics(HOAP3 if name == HOAP3.name else ARM)


@cache
def built(case: str) -> tuple[RobotDescription, Kinematics, LyapunovFunction]:
    """The robot and V of one of `CASES`."""
    robot, name, parameters = CASES[case]
    kinematics = kinematics_of(robot.name)
    settings = TaskSettings(task=name, parameters=parameters)
    return robot, kinematics, build(settings, robot, kinematics)
