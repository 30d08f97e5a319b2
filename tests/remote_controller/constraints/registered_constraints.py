"""Which constraints the property suite runs over.

Every registered constraint is a case: ours with the parameters below, those of installed packages
with their defaults. `HOAP3_TEST_CONSTRAINTS` names others instead: files with `constraint` and
`parameters`, `package.module:Class`, or registered names, separated by commas;
`HOAP3_TEST_ROBOT` another robot than HOAP-3 for them.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

from support.constraint_bench import PERIOD, entry, hoap3, small

from hoap3.protocol.config.settings import load_yaml, parse
from hoap3.protocol.description import RobotDescription
from hoap3.remote_controller.constraints.registry import ConstraintSettings, build, registered
from hoap3.remote_controller.constraints.stack import ConstraintStack
from hoap3.remote_controller.model.kinematics import Kinematics
from hoap3.robot_emulator.robots import load


def within_a_ball(q):
    """A user's function: |q|² ≤ 40."""
    return [40.0 - q @ q], [-2.0 * q]


BALL = {"name": "ball", "shape": "sphere", "center_m": [0.25, 0.05, 0.35], "radius_m": 0.04}
OURS = {
    "joint_velocity": {"limit_rad_s": 0.5},
    "joint_position": {"margin_rad": 0.01},
    "joint_acceleration": {"limit_rad_s2": 20.0},
    "viability": {},
    "support_polygon": {"margin_m": 0.002},
    "zmp": {},
    "friction_cone": {},
    "user_function": {"function": f"{__name__}:within_a_ball"},
    "distance": {"rows": 800, "activation_m": 2.0},  # so that all pairs have rows
    "fixed_frame": {"frame": "l_sole", "axes": ["x", "y", "rz"]},
    "half_space": {"frame": "r_forearm", "normal": [0, 1, 1], "offset_m": -0.5},
    "minimum_speed": {"joints": {"waist_pitch": 1.0}, "speed": 0.1},
    "pfaffian": {"matrix": [[1.0] * 21]},
}
SMALL = {
    "half_space": {"frame": "hand", "normal": [0, 0, 1], "offset_m": 0.2},
    "distance": {"obstacles": [BALL], "activation_m": 0.5, "joints_apart": 1},
    "support_polygon": {},
}


def _file(name: str) -> tuple[ConstraintSettings, str]:
    """A constraint that a file or a name says, and where that stands."""
    if Path(name).suffix not in {".yaml", ".yml"}:
        return ConstraintSettings(constraint=name), f"constraint {name}"
    folder = str(Path(name).resolve().parent)
    if folder not in sys.path:
        sys.path.append(folder)
    return parse(ConstraintSettings, load_yaml(Path(name)), name), name


def _cases() -> dict[str, tuple[RobotDescription, ConstraintSettings, str]]:
    named = [name.strip() for name in os.environ.get("HOAP3_TEST_CONSTRAINTS", "").split(",")]
    named = [name for name in named if name]
    found: dict[str, tuple[RobotDescription, ConstraintSettings, str]] = {}
    if not named:
        for suffix, robot, given in (("", hoap3(), OURS), (" of an arm", small(), SMALL)):
            for name, parameters in given.items():
                settings = entry({"constraint": name, **parameters})
                found[name + suffix] = (robot, settings, name)
        named = sorted(set(registered()) - set(OURS) - {"joint_torque"})  # says nothing about u
    robot = load(os.environ.get("HOAP3_TEST_ROBOT", "hoap3")) if named else hoap3()
    return {**found, **{name: (robot, *_file(name)) for name in named}}


CASES = _cases()


def make(case: str) -> tuple[RobotDescription, Kinematics, ConstraintStack]:
    """The robot, kinematics of its own, and a stack of this constraint alone."""
    robot, settings, file = CASES[case]
    kinematics = Kinematics(robot)
    return robot, kinematics, build([settings], robot, kinematics, PERIOD, file)
