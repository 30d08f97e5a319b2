"""A robot with mimic joints and endless joints in MuJoCo."""

from __future__ import annotations

import numpy as np
import pytest
from support.robots.following_arm import following

from hoap3.protocol.robot.description import CommandKind, RobotDescription
from hoap3.protocol.robot.pinocchio_model import build_model
from hoap3.protocol.robot.rigid_body_dynamics import Dynamics
from hoap3.robot_emulator.plants.mujoco.gains import rate_limit
from hoap3.robot_emulator.plants.mujoco.plant import MujocoPlant

T = 0.001
GIVES_WAY = 1e-4  # rad and m: MuJoCo's equalities are springs


def body(command: CommandKind, **parameters: object) -> tuple[RobotDescription, MujocoPlant]:
    robot = following().model_copy(update={"command_kinds": (command,)})
    given = {"joint_friction": False, **parameters}
    made = MujocoPlant(robot, MujocoPlant.Parameters.model_validate(given))
    made.reset(robot.initial_position)
    return robot, made


def test_mimic_joints_start_in_their_places_and_keep_them():
    robot, made = body("position")
    for _ in range(1000):
        made.step(made.start + 0.01, T)
    np.testing.assert_allclose(made.q, robot.initial_position + 0.01, atol=0.02)
    mimic_joints = build_model(robot).mimic_joints
    assert mimic_joints is not None
    names = (*robot.joint_names, *mimic_joints.names)
    places = [made.data.joint(name).qpos[0] for name in names]
    np.testing.assert_allclose(places, mimic_joints.positions(made.q), atol=GIVES_WAY)


def test_the_centre_of_mass_of_the_model_is_that_of_the_physics():
    robot, made = body("position")
    model = build_model(robot)
    root = model.root_mass / model.total_mass  # which is the world's in MuJoCo
    moving = (model.com_in("base", made.q) - root * model.root_com) / (1.0 - root)
    assert made.data.subtree_com[0] == pytest.approx(moving, abs=1e-9)


def test_servos_know_what_mimic_joints_weigh():
    robot, made = body("position", servo_rad_s=50.0)
    mass = Dynamics(robot).mass(robot.initial_position)
    np.testing.assert_allclose(made.gains.kp, 50.0**2 * mass.diagonal(), rtol=1e-9)
    np.testing.assert_allclose(made.gains.kv, 2.0 * 50.0 * mass.diagonal(), rtol=1e-9)
    limit = rate_limit(mass, made.gains.kp, made.gains.kv)
    assert made.gains.rate_limit == pytest.approx(limit, rel=1e-6)


def test_it_starts_under_the_torques_that_hold_mimic_joints_too():
    robot, made = body("position")
    weight = np.zeros(robot.n)
    Dynamics(robot).gravity(robot.initial_position, weight)
    np.testing.assert_allclose(made.gains.kp * (made.start - made.q), weight, atol=1e-9)


def test_accelerations_are_met_with_mimic_joints():
    _, made = body("acceleration")
    wanted = np.array([0.05, 1.0, -0.8, 0.6, 1.5])
    before = made.dq.copy()
    for _ in range(100):
        made.step(wanted, T)
    np.testing.assert_allclose(made.dq - before, 100 * T * wanted, rtol=0.02, atol=1e-4)


def test_the_filter_of_torques_knows_what_accelerations_need():
    robot, made = body("torque")
    assert made.torque_model is not None
    wanted, needed, expected = np.array([0.05, 1.0, -0.8, 0.6, 1.5]), *np.zeros((2, robot.n))
    assert made.torque_model.torques(wanted, T, needed) == -1
    Dynamics(robot).inverse(robot.initial_position, np.zeros(robot.n), wanted, expected)
    np.testing.assert_allclose(needed, expected, rtol=0.01, atol=0.01)
