"""Robots of random shape: trees of revolute and prismatic joints with slanted axes."""

from __future__ import annotations

import numpy as np

from hoap3.protocol.robot.description import Joint, RobotDescription


def triple(values: np.ndarray) -> str:
    return " ".join(repr(float(value)) for value in values)


def placed(rng: np.random.Generator, distance: float) -> str:
    shift, turn = triple(rng.normal(0, distance, 3)), triple(rng.normal(size=3))
    return f'<origin xyz="{shift}" rpy="{turn}"/>'


def inertial(rng: np.random.Generator) -> str:
    """Of a cuboid that lies at any angle."""
    mass, squares = rng.uniform(0.1, 5.0), rng.uniform(0.02, 0.5, 3) ** 2
    xx, yy, zz = (float(moment) for moment in mass / 12 * (squares.sum() - squares))
    return (
        f'<inertial>{placed(rng, 0.2)}<mass value="{mass!r}"/>'
        f'<inertia ixx="{xx!r}" iyy="{yy!r}" izz="{zz!r}" ixy="0" ixz="0" iyz="0"/></inertial>'
    )


def random_tree(seed: int, n: int) -> RobotDescription:
    """A robot of n joints, in shuffled wire order, some with armature, a fixed link among them."""
    rng = np.random.default_rng(seed)
    parts, joints = ['<link name="root"/>'], []
    links = ["root"]
    for i in range(n):
        kind = "prismatic" if rng.random() < 0.4 else "revolute"
        axis = np.eye(3)[rng.integers(3)] if rng.random() < 0.3 else rng.normal(size=3)
        parts.append(
            f'<link name="link{i}">{inertial(rng)}</link>'
            f'<joint name="joint{i}" type="{kind}"><parent link="{rng.choice(links)}"/>'
            f'<child link="link{i}"/>{placed(rng, 0.3)}<axis xyz="{triple(axis)}"/>'
            '<limit lower="-2" upper="1.5" velocity="3" effort="50"/></joint>'
        )
        links.append(f"link{i}")
        joints.append(
            Joint(
                name=f"joint{i}",
                lower_hard=-2.0,
                upper_hard=1.5,
                lower=-2.0,
                upper=1.5,
                velocity=float(rng.uniform(0.5, 3.0)),
                setpoint_acceleration_max=10.0,
                brake_acceleration=10.0,
                effort=float(rng.uniform(20.0, 90.0)),
                armature=float(rng.choice([0.0, 0.3])),
            )
        )
    parts.append(
        f'<link name="tool">{inertial(rng)}</link><joint name="fixed" type="fixed">'
        f'<parent link="{links[-1]}"/><child link="tool"/><origin xyz="0.1 0 0" rpy="0.5 0 0"/>'
        "</joint>"
    )
    order = rng.permutation(n)
    return RobotDescription(
        name="tree",
        urdf=f'<robot name="tree">{"".join(parts)}</robot>',
        joints=tuple(joints[int(i)] for i in order),
        initial_posture="zero",
        postures={"zero": (0.0,) * n},
        base_frame="root",
    )
