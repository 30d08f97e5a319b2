"""Which links of a robot push each other: those that are apart, as joints and at the start."""

from __future__ import annotations

from itertools import pairwise

import mujoco
import numpy as np
import pytest

from hoap3.protocol.robot.description import RobotDescription
from hoap3.robot_emulator.plants.mujoco.plant import MujocoPlant
from hoap3.robot_emulator.robots.yaml_file import RobotFile, describe

INERTIA = '<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/>'
LIMIT = '<limit lower="-4" upper="4" velocity="9" effort="50"/>'


def link(name: str, radius: float = 0.0, height: float = 0.0) -> str:
    """A link, with a ball at a height where it has a radius."""
    inertial = f'<inertial><origin xyz="0 0 0.1"/><mass value="1"/>{INERTIA}</inertial>'
    shape = f'<origin xyz="0 0 {height}"/><geometry><sphere radius="{radius}"/></geometry>'
    collision = f"<collision>{shape}</collision>" if radius else ""
    return f'<link name="{name}">{inertial}{collision}</link>'


def chain(*links: str, mimic_joints: str = "") -> RobotDescription:
    """Links a, b, c, … each 0.2 m above the one before, all turning about y; b may follow a's."""
    joints, names = "", "oabcd"[: len(links)]
    for parent, child in pairwise(names):
        more = mimic_joints if child == "b" else ""
        joints += (
            f'<joint name="to_{child}" type="revolute"><parent link="{parent}"/>'
            f'<child link="{child}"/><origin xyz="0 0 0.2"/><axis xyz="0 1 0"/>{LIMIT}{more}'
            "</joint>"
        )
    moving = [f"to_{name}" for name in names[1:] if not (mimic_joints and name == "b")]
    urdf = f'<robot name="chain">{"".join(links)}{joints}</robot>'
    return describe(RobotFile(name="chain", urdf="chain.urdf", joints=tuple(moving)), urdf)


def contacts(robot: RobotDescription, turned: float = 0.0) -> int:
    """How many there are, with the last joint turned from the start posture."""
    made = MujocoPlant(robot, MujocoPlant.Parameters(collide="all"))
    q = robot.initial_position.copy()
    q[-1] += turned
    made.built.pose(made.data, q)
    mujoco.mj_forward(made.model, made.data)
    return int(made.data.ncon)


@pytest.mark.parametrize(("near", "height", "found"), [("a", 0.6, 1), ("b", 0.4, 0)])
def test_links_three_joints_apart_touch_and_nearer_ones_do_not(near, height, found):
    """The ball of d, folded back, lies on that of a or of b."""
    radii = {near: 0.05}
    robot = chain(*(link(name, radii.get(name, 0.0)) for name in "oabc"), link("d", 0.05, height))
    assert contacts(robot) == 0
    assert contacts(robot, np.pi - 0.1) == found


def test_links_that_overlap_at_the_start_never_touch():
    robot = chain(link("o"), link("a", 0.15, 0.4), link("b"), link("c"), link("d", 0.15, -0.1))
    assert contacts(robot) == contacts(robot, 0.3) == 0


def test_mimic_joints_are_in_their_places_where_the_start_is_looked_at():
    """Only where b is folded back does the last ball lie on the first one."""
    follows = '<mimic joint="to_a" multiplier="1" offset="3.14159"/>'
    links = link("o", 0.08), link("a"), link("b"), link("c"), link("d", 0.08, 0.05)
    assert contacts(chain(*links, mimic_joints=follows), 0.1) == 0
