"""A robot with followers and endless joints in MuJoCo."""

from __future__ import annotations

import numpy as np
import pytest
from support.robots.following_arm import following

from hoap3.protocol.robot.pinocchio_model import build_model
from hoap3.robot_emulator.plants.mujoco.plant import MujocoPlant

T = 0.001
GIVES_WAY = 1e-4  # rad and m: MuJoCo's equalities are springs


def test_followers_start_in_their_places_and_keep_them():
    robot = following()
    made = MujocoPlant(robot, MujocoPlant.Parameters())
    made.reset(robot.initial_position)
    wanted = robot.initial_position + 0.01
    for _ in range(1000):
        made.step(made.start + 0.01, T)
    np.testing.assert_allclose(made.q, wanted, atol=0.02)
    followers = build_model(robot).followers
    assert followers is not None
    names = (*robot.joint_names, *followers.names)
    places = [made.data.joint(name).qpos[0] for name in names]
    np.testing.assert_allclose(places, followers.positions(made.q), atol=GIVES_WAY)


def test_the_centre_of_mass_of_the_model_is_that_of_the_physics():
    robot = following()
    made = MujocoPlant(robot, MujocoPlant.Parameters())
    made.reset(robot.initial_position)
    model = build_model(robot)
    root = model.root_mass / model.total_mass  # which is the world's in MuJoCo
    moving = (model.com_in("base", made.q) - root * model.root_com) / (1.0 - root)
    assert made.data.subtree_com[0] == pytest.approx(moving, abs=1e-9)
