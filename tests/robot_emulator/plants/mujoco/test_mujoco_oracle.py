"""Two independent simulators of one URDF: accelerations, and the frames of a turned-round tree."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from hoap3.protocol.robot.description import RobotDescription
from hoap3.protocol.robot.pinocchio_model import build_model as pinocchio_model
from hoap3.protocol.robot.rigid_body_dynamics import Dynamics
from hoap3.robot_emulator.plants.mujoco.model import build_model
from hoap3.robot_emulator.plants.mujoco.rerooted_urdf import rerooted
from hoap3.robot_emulator.plants.mujoco.settings import MujocoParameters
from hoap3.robot_emulator.robots import load

ROBOTS = ("baxter_left_arm", "baxter_right_arm", "hoap3", "humanoid32", "lwr", "ur5")
NO_SERVOS = 1 << 1


def described(name: str, **changes: object) -> RobotDescription:
    return load(name).model_copy(update={"command_kinds": ("torque",), **changes})


@pytest.mark.parametrize("name", ROBOTS)
def test_accelerations_are_those_of_our_rigid_body(name: str):
    """1,000 random states in free space, relative to the greatest acceleration: 1e-9."""
    robot, parameters = described(name), MujocoParameters(joint_friction=False, collide="none")
    built = build_model(robot, parameters)
    built.model.opt.disableactuator = NO_SERVOS
    data, random = mujoco.MjData(built.model), np.random.default_rng(1)
    ours = Dynamics(robot.model_copy(update={"urdf": built.urdf}))
    expected = np.zeros(robot.n)
    for _ in range(1000):
        q = random.uniform(robot.lower, robot.upper)
        dq = random.uniform(-1.0, 1.0, robot.n) * robot.velocity
        tau = random.uniform(-1.0, 1.0, robot.n) * robot.effort
        data.qpos[built.q_at], data.qvel[built.v_at], data.ctrl[::2] = q, dq, tau
        mujoco.mj_forward(built.model, data)
        ours.forward(q, dq, tau, np.zeros(ours.n), expected)
        found = data.qacc[built.v_at]
        assert np.abs(found - expected).max() <= 1e-9 * np.abs(expected).max()


@pytest.mark.parametrize("name", ROBOTS)
def test_inertias_are_as_the_urdf_has_them(name: str):
    """MuJoCo altered none: M(q) of both agree, also where the base may move."""
    robot = described(name)
    built = build_model(robot, MujocoParameters(base="free", collide="none"))
    data, random = mujoco.MjData(built.model), np.random.default_rng(2)
    whole = np.zeros((built.model.nv, built.model.nv))
    for q in random.uniform(robot.lower, robot.upper, (20, robot.n)):
        data.qpos[built.q_at] = q
        mujoco.mj_forward(built.model, data)
        mujoco.mj_fullM(built.model, data, whole)
        expected = Dynamics(robot).mass(q)
        np.testing.assert_allclose(
            whole[np.ix_(built.v_at, built.v_at)], expected, atol=1e-12 * np.abs(expected).max()
        )
    assert whole[0, 0] == pytest.approx(pinocchio_model(robot).total_mass, rel=1e-12)


@pytest.mark.parametrize(("name", "link"), [("hoap3", "r_sole"), ("hoap3", "trunk"), ("lwr", "ee")])
def test_a_urdf_hung_from_another_link_is_the_same_robot(name: str, link: str):
    import pinocchio as pin

    robot = described(name)
    turned = robot.model_copy(update={"urdf": rerooted(robot.urdf, link)})
    models = [pinocchio_model(each) for each in (robot, turned)]
    random = np.random.default_rng(3)
    for q in random.uniform(robot.lower, robot.upper, (50, robot.n)):
        seen = []
        for found in models:
            ours = np.zeros(robot.n)
            ours[found.order] = q
            pin.framesForwardKinematics(found.model, found.data, ours)
            origin = found.data.oMf[found.frame_id(link)]
            seen.append(
                [origin.actInv(found.data.oMf[found.frame_id(f)]).homogeneous for f in robot.frames]
            )
        np.testing.assert_allclose(seen[1], seen[0], atol=1e-13)
        coms = [found.com_in(link, q) for found in models]
        np.testing.assert_allclose(coms[1], coms[0], atol=1e-13)
