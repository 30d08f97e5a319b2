"""An arm with continuous joints, a rolling elbow whose far half follows, and a gripper.

Five joints on the wire, eight that move: `turn` and `roll` turn without end; `far_elbow` follows
`elbow`; `thumb` follows `finger`, and `thumb_tip`, which turns, follows `thumb`.
"""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

from hoap3.protocol.config.settings import parse, parse_yaml
from hoap3.protocol.robot.description import RobotDescription
from hoap3.robot_emulator.robots import load
from hoap3.robot_emulator.robots.yaml_file import RobotFile, describe

Z, Y, X = "0 0 1", "0 1 0", "1 0 0"


def _link(name: str, mass: float, at: str = "0 0 0.1") -> str:
    shape = (
        '<cylinder radius="0.03" length="0.12"/>' if mass > 0.2 else '<box size="0.02 0.03 0.04"/>'
    )
    x, y, z = 0.012 * mass, 0.01 * mass, 0.006 * mass
    return (
        f'<link name="{name}"><inertial><mass value="{mass}"/><origin xyz="{at}" rpy="0.1 0 0.2"/>'
        f'<inertia ixx="{x}" iyy="{y}" izz="{z}" ixy="0" ixz="0" iyz="0"/></inertial>'
        f'<collision><origin xyz="{at}"/><geometry>{shape}</geometry></collision>'
        "</link>"
    )


def _joint(name: str, kind: str, ends: str, at: str, axis: str, more: str = "") -> str:
    parent, child = ends.split()
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{at}"/><axis xyz="{axis}"/>{more}</joint>'
    )


def _limit(lower: float, upper: float, velocity: float, effort: float) -> str:
    return f'<limit lower="{lower}" upper="{upper}" velocity="{velocity}" effort="{effort}"/>'


def _mimic(mimicked: str, multiplier: float, offset: float) -> str:
    return f'<mimic joint="{mimicked}" multiplier="{multiplier}" offset="{offset}"/>'


ROUGH = '<dynamics damping="0.2" friction="0.1"/>'
ENDLESS = '<limit velocity="2" effort="80"/>' + ROUGH
FAR = _mimic("elbow", 0.5, 0.1) + _limit(-1.0, 1.0, 2.0, 40.0) + ROUGH
THUMB, TIP = _mimic("finger", -1.0, 0.02), _mimic("thumb", -8.0, 0.1)

URDF = "".join(
    [
        '<robot name="following">',
        _link("base", 4.0),
        _joint("turn", "continuous", "base shoulder", "0 0 0.1", Z, ENDLESS),
        _link("shoulder", 2.0),
        _joint("lift", "revolute", "shoulder upper", "0 0 0.2", Y, _limit(-1.5, 1.5, 2, 80)),
        _link("upper", 1.5, "0.02 0 0.15"),
        # the mimic joint stands before its mimicked joint in the text, and in the tree
        _joint("far_elbow", "revolute", "upper middle", "0 0 0.3", Y, FAR),
        _link("middle", 0.3, "0 0 0.02"),
        _joint("elbow", "revolute", "middle fore", "0 0 0.05", Y, _limit(-2.5, 2.5, 3, 60)),
        _link("fore", 1.0, "0 0.01 0.12"),
        _joint("roll", "continuous", "fore hand", "0 0 0.25", "0.6 0 0.8", ENDLESS),
        _link("hand", 0.5, "0.01 0 0.05"),
        _joint("finger", "prismatic", "hand left", "0.03 0 0.1", X, _limit(0, 0.05, 0.2, 20)),
        _link("left", 0.1, "0 0 0.03"),
        _joint("thumb", "prismatic", "hand right", "-0.03 0 0.1", X, THUMB + _limit(-1, 1, 1, 1)),
        _link("right", 0.1, "0 0 0.03"),
        _joint("thumb_tip", "revolute", "right tip", "0 0 0.06", Y, TIP + _limit(-2, 2, 1.2, 1)),
        _link("tip", 0.05, "0 0 0.01"),
        _joint("mount", "fixed", "hand tool", "0 0 0.15", Z),
        '<link name="tool"/></robot>',
    ]
)

YAML = """name: following
urdf: arm.urdf
joints: [finger, turn, {name: elbow, armature: 0.05}, lift, {name: roll, armature: 0.02}]
postures: {bent: [0.01, 0.4, 0.7, 0.5, -0.3]}
initial_posture: bent
command_kinds: [position, acceleration, torque]
setpoint_acceleration_max: 200
brake_acceleration: 40
default_task: {point: tool, reference: base, move_m: [0.02, 0.05, -0.04]}
"""


def write(folder: Path, yaml: str = YAML, urdf: str = URDF) -> Path:
    """Put the arm into a folder; returns its YAML file."""
    (folder / "arm.urdf").write_text(urdf, encoding="utf-8")
    file = folder / "robot.yaml"
    file.write_text(yaml, encoding="utf-8")
    return file


def following_arm(folder: Path, yaml: str = YAML, urdf: str = URDF) -> RobotDescription:
    """The arm, through a folder."""
    return load(write(folder, yaml, urdf))


@cache
def following() -> RobotDescription:
    """The arm."""
    return describe(parse(RobotFile, parse_yaml(YAML, "arm"), "arm"), URDF)


@cache
def let_go() -> RobotDescription:
    """The same links with eight independent joints: what followed does as it likes."""
    arm, urdf = following(), re.sub("<mimic[^>]*>", "", URDF)
    names = *arm.joint_names, *arm.structure.mimic_joints
    return describe(RobotFile(name="let_go", urdf="arm.urdf", joints=names), urdf)
