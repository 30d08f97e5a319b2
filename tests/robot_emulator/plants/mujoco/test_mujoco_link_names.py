"""Links whose names mean something to MuJoCo or to an XPath."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from hoap3.robot_emulator.plants.mujoco.plant import MujocoPlant
from hoap3.robot_emulator.robots.yaml_file import RobotFile, describe

T = 0.001


def link(name: str) -> str:
    inertia = '<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/>'
    inertial = f'<inertial><origin xyz="0 0 0.1"/><mass value="1"/>{inertia}</inertial>'
    ball = '<collision><geometry><sphere radius="0.05"/></geometry></collision>'
    return f'<link name="{name}">{inertial}{ball}</link>'


def plant(*names: str, base: str) -> MujocoPlant:
    """A chain of links of these names, 0.3 m apart; a free one in the air."""
    limit = '<limit lower="-1" upper="1" velocity="2" effort="50"/>'
    joints = "".join(
        f'<joint name="j{k}" type="revolute"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="0 0 0.3"/><axis xyz="0 1 0"/>{limit}</joint>'
        for k, (parent, child) in enumerate(pairwise(names))
    )
    urdf = f'<robot name="chain">{"".join(map(link, names))}{joints}</robot>'
    moving = tuple(f"j{k}" for k in range(len(names) - 1))
    robot = describe(RobotFile(name="chain", urdf="chain.urdf", joints=moving), urdf)
    robot = robot.model_copy(update={"state_arrays": {"contact": 18, "base": 13, "imu": 0}})
    given = {"position_m": [0.0, 0.0, 1.0], "imu_frames": ()} if base == "free" else {}
    given |= {"base": base, "contact_frames": names[:3], "collide": names, "kp": 500.0, "kv": 20.0}
    made = MujocoPlant(robot, MujocoPlant.Parameters.model_validate(given))
    made.reset(robot.initial_position)
    return made


@pytest.mark.parametrize("base", ["fixed", "free"])
@pytest.mark.parametrize("names", ["world b c", "a world c", "base's b c", "a b's c"])
def test_links_may_be_called_anything(names: str, base: str):
    odd, plain = plant(*names.split(), base=base), plant("a", "b", "c", base=base)
    for made in (odd, plain):
        for _ in range(100):
            made.step(made.start + 0.1, T)
    np.testing.assert_array_equal(odd.q, plain.q)
    np.testing.assert_array_equal(odd.base, plain.base)
    for frame, ours in zip(names.split(), "abc", strict=True):
        place = odd.data.site_xpos[odd.built.site(frame)]
        np.testing.assert_array_equal(place, plain.data.site_xpos[plain.built.site(ours)])
    np.testing.assert_array_equal(odd.model.geom_contype, plain.model.geom_contype)
    assert odd.model.geom_contype.any()
    assert np.abs(odd.q).max() > 0.01
