"""Where links are drawn is forward kinematics, as plain Pinocchio has it."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import hoap3
from hoap3.protocol.description import RobotDescription
from hoap3.tools.view.picture.kinematics import Poses

ROBOTS = ("hoap3", "ur5", "lwr", "baxter_left_arm", "humanoid32")


def plain(robot: RobotDescription, q: np.ndarray) -> tuple[pin.Model, pin.Data]:
    """The model of its URDF at q, which is in wire order, by joint names alone."""
    model = pin.buildModelFromXML(robot.urdf)
    data, ours = model.createData(), np.zeros(model.nq)
    for name, angle in zip(robot.joint_names, q, strict=True):
        ours[model.joints[model.getJointId(name)].idx_q] = angle
    pin.framesForwardKinematics(model, data, ours)
    pin.centerOfMass(model, data, ours)
    return model, data


def some_q(robot: RobotDescription, seed: int = 3) -> np.ndarray:
    lower, upper = robot.sampling_range
    return np.random.default_rng(seed).uniform(lower, upper)


def placed(model: pin.Model, data: pin.Data, link: str) -> pin.SE3:
    return data.oMf[model.getFrameId(link, pin.FrameType.BODY)]


@pytest.mark.parametrize("name", ROBOTS)
def test_a_fixed_robot_stands_with_its_base_frame_at_the_origin(name):
    robot = hoap3.load_robot(name)
    q = some_q(robot)
    model, data = plain(robot, q)
    poses = Poses(robot)
    poses.update(q)
    base = placed(model, data, robot.base_frame)
    for link, pose in zip(poses.links, poses.poses, strict=True):
        expected = base.actInv(placed(model, data, link))
        assert np.allclose(pin.XYZQUATToSE3(np.array(pose)).homogeneous, expected.homogeneous)
    assert np.allclose(poses.pose(robot.base_frame), [0, 0, 0, 0, 0, 0, 1])


def test_a_free_base_is_where_its_state_says():
    robot = hoap3.load_robot("hoap3")
    q = some_q(robot)
    base = pin.SE3(pin.rpy.rpyToMatrix(0.3, -0.2, 1.1), np.array([0.4, -0.7, 0.35]))
    told = np.zeros(13)
    told[:7] = pin.SE3ToXYZQUAT(base)
    model, data = plain(robot, q)
    poses = Poses(robot)
    poses.update(q, told)
    for link in ("pelvis", "l_sole", "r_sole"):
        expected = base * placed(model, data, link)
        found = pin.XYZQUATToSE3(np.array(poses.pose(link)))
        assert np.allclose(found.homogeneous, expected.homogeneous)


def test_the_centre_of_mass_is_that_of_all_links():
    robot = hoap3.load_robot("hoap3")
    q = some_q(robot)
    base = np.r_[0.1, 0.2, 0.3, np.array([0.1, -0.3, 0.2, 0.9]) / np.sqrt(0.95), np.zeros(6)]
    poses = Poses(robot)
    poses.update(q, base)
    model, data = plain(robot, q)
    masses = [each.mass for each in model.inertias]  # joint 0 is the root link
    places = [data.oMi[i].act(each.lever) for i, each in enumerate(model.inertias)]
    com = np.average(places, axis=0, weights=masses)
    assert np.allclose(poses.com, pin.XYZQUATToSE3(base[:7]).act(com), atol=1e-12)
    seen = placed(model, data, "r_sole").actInv(com)
    assert np.allclose(poses.com_from("r_sole"), seen, atol=1e-12)


def test_a_link_is_seen_from_another():
    robot = hoap3.load_robot("ur5")
    q = some_q(robot)
    poses = Poses(robot)
    poses.update(q)
    model, data = plain(robot, q)
    expected = placed(model, data, "base").actInv(placed(model, data, "tool0"))
    found = pin.XYZQUATToSE3(np.array(poses.seen_from("tool0", "base")))
    assert np.allclose(found.homogeneous, expected.homogeneous)
