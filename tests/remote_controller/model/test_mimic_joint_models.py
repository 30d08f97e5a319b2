"""Models with mimic and continuous joints, against plain Pinocchio and q = Gq + g₀.

Robots are random trees; the reference has a coordinate for each moving joint, and its G is made
from the URDF by hand.
"""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.robots.following_arm import following_arm
from support.robots.following_trees import following_tree, state
from support.robots.full_model import FullModel

from hoap3.protocol.robot.rigid_body_dynamics import Dynamics
from hoap3.remote_controller.model.frame_dynamics import (
    POSE,
    POSITION,
    FrameRows,
    FramesDynamics,
)
from hoap3.remote_controller.model.kinematics import Kinematics

STEP = 1e-6  # s: of central differences, whose error is about 1e-9 of the numbers
trees = given(
    seed=st.integers(0, 2**32 - 1), n=st.integers(1, 4), f=st.integers(0, 4), at=st.integers(0, 99)
)
some = settings(max_examples=15)


def cross_vector(skew):
    return np.array([skew[2, 1], skew[0, 2], skew[1, 0]])


def rate(plain, q, dq, seen):
    """d/dt of what `seen` says of the model, by a central difference."""
    plain.place(q + STEP * dq)
    ahead = seen(plain)
    plain.place(q - STEP * dq)
    return (ahead - seen(plain)) / (2 * STEP)


@trees
@some
def test_frames_and_centre_of_mass_stand_and_move_as_the_full_model_says(seed, n, f, at):
    robot = following_tree(seed, n, f)
    plain, ours, (q, dq) = FullModel(robot), Kinematics(robot), state(robot, at)
    rng = np.random.default_rng(at)
    frame, reference = (str(name) for name in rng.choice(robot.frames, 2))
    numbers = ours.frame_id(frame), ours.frame_id(reference)
    p, R, J = np.zeros(3), np.zeros((3, 3)), np.zeros((6, n))
    com, J_com, joints = np.zeros(3), np.zeros((3, n)), np.zeros(n)
    ours.update(q)
    ours.frame(*numbers, p, R, J)
    ours.com(numbers[1], com, J_com)
    ours.joints(joints)
    plain.place(q)
    size = 1.0 + np.abs(plain.g0).max() + np.abs(plain.data.com[0]).max()
    np.testing.assert_array_equal(joints, q)
    np.testing.assert_allclose(p, plain.pose(frame, reference)[0], atol=1e-13 * size)
    np.testing.assert_allclose(R, plain.pose(frame, reference)[1], atol=1e-13)
    np.testing.assert_allclose(com, plain.com(reference), atol=1e-13 * size)

    near = 1e-7 * size * (1.0 + np.abs(plain.G).max()) ** 2
    seen = rate(plain, q, dq, lambda it: it.pose(frame, reference)[0])
    np.testing.assert_allclose(J[:3] @ dq, seen, atol=near)
    turning = rate(plain, q, dq, lambda it: it.pose(frame, reference)[1])
    np.testing.assert_allclose(J[3:] @ dq, cross_vector(turning @ R.T), atol=near)
    np.testing.assert_allclose(
        J_com @ dq, rate(plain, q, dq, lambda it: it.com(reference)), atol=near
    )


@trees
@some
def test_the_drift_is_what_the_full_model_accelerates_by_where_no_joint_does(seed, n, f, at):
    robot = following_tree(seed, n, f)
    ours, (q, dq) = Kinematics(robot), state(robot, at)
    ours.load_drift()
    frame, reference = (str(name) for name in np.random.default_rng(at).choice(robot.frames, 2))
    numbers = ours.frame_id(frame), ours.frame_id(reference)
    J, J_com, ignored = np.zeros((6, n)), np.zeros((3, n)), (np.zeros(3), np.zeros((3, 3)))

    def twist(q):
        ours.update(q)
        ours.frame(*numbers, *ignored, J)
        ours.com(numbers[1], ignored[0], J_com)
        return np.concatenate([J @ dq, J_com @ dq])

    by_differences = (twist(q + STEP * dq) - twist(q - STEP * dq)) / (2 * STEP)
    size = 1.0 + np.abs(twist(q)).max()
    drift, drift_com = np.zeros(6), np.zeros(3)
    ours.frame_drift(*numbers, dq, drift)
    ours.com_drift(numbers[1], dq, drift_com)
    found = np.concatenate([drift, drift_com])
    np.testing.assert_allclose(found, by_differences, atol=1e-7 * size**2)


@trees
@some
def test_inertia_bias_and_gravity_are_those_of_the_full_model(seed, n, f, at):
    robot = following_tree(seed, n, f)
    plain, ours, (q, dq) = FullModel(robot), Dynamics(robot), state(robot, at)
    ddq = np.random.default_rng(at).normal(size=n)
    M, h = plain.mass(q), plain.torques(q, dq, np.zeros(n))
    tau, weight, found = np.zeros(n), np.zeros(n), np.zeros(n)
    size = np.abs(M).max() + np.abs(h).max()
    np.testing.assert_allclose(ours.mass(q), M, atol=1e-13 * size)
    ours.inverse(q, dq, ddq, tau)
    np.testing.assert_allclose(tau, plain.torques(q, dq, ddq), atol=1e-12 * size)
    ours.gravity(q, weight)
    still = plain.torques(q, np.zeros(n), np.zeros(n))
    np.testing.assert_allclose(weight, still, atol=1e-12 * size)

    added, error = np.full(n, 0.1), np.linalg.cond(M + 0.1 * np.eye(n)) * 1e-13
    ours.forward(q, dq, tau, added, found)
    wanted = np.linalg.solve(M + 0.1 * np.eye(n), tau - h)
    np.testing.assert_allclose(found, wanted, atol=error * (1.0 + np.abs(wanted).max()))
    ours.forward(q, dq, tau, np.zeros(ours.n), found)  # undoes `inverse`
    np.testing.assert_allclose(found, ddq, atol=1e-12 * size * np.linalg.cond(M))


@trees
@some
def test_rows_of_frames_are_those_of_the_full_model(seed, n, f, at):
    robot = following_tree(seed, n, f)
    frames = [FrameRows(robot.frames[-1], 1, POSE), FrameRows(robot.frames[n // 2], 7, POSITION)]
    ours, lone, (q, dq) = FramesDynamics(robot, frames, 10), Kinematics(robot), state(robot, at)
    ours.jacobian[0] = 7.0  # a row that is somebody else's
    ours.update(q, dq)
    plain = FullModel(robot)
    M, h = plain.mass(q), plain.torques(q, dq, np.zeros(n))
    size = np.abs(M).max() + np.abs(h).max() + 1.0
    np.testing.assert_allclose(ours.mass, M, atol=1e-13 * size)
    np.testing.assert_array_equal(ours.mass, ours.mass.T)
    np.testing.assert_allclose(ours.bias, h, atol=1e-12 * size)
    np.testing.assert_array_equal(ours.jacobian[0], 7.0)
    np.testing.assert_allclose(ours.twist[1:], ours.jacobian[1:] @ dq, atol=1e-12 * size)

    J, R, root = np.zeros((6, n)), np.zeros((3, 3)), lone.frame_id("root")
    lone.load_drift()
    lone.update(q)
    drift = np.zeros(6)
    lone.frame(lone.frame_id(robot.frames[n // 2]), root, np.zeros(3), R, J)
    lone.frame_drift(lone.frame_id(robot.frames[n // 2]), root, dq, drift)
    np.testing.assert_allclose(ours.jacobian[7:], J[:3], atol=1e-12 * size)
    np.testing.assert_allclose(ours.drift[7:], drift[:3], atol=1e-11 * size**2)
    lone.frame(lone.frame_id(robot.frames[-1]), root, np.zeros(3), R, J)
    np.testing.assert_allclose(ours.jacobian[1:4], R.T @ J[:3], atol=1e-12 * size)
    np.testing.assert_allclose(ours.jacobian[4:7], R.T @ J[3:], atol=1e-12 * size)


def test_friction_of_mimic_joints_counts_as_the_mimicked_joint_feels_it(tmp_path):
    """far_elbow turns half as fast as elbow and has d = 0.2, c = 0.1; elbow itself has none."""
    dynamics = Dynamics(following_arm(tmp_path))
    np.testing.assert_allclose(dynamics.damping, [0.0, 0.2, 0.05, 0.0, 0.2], atol=1e-16)
    np.testing.assert_allclose(dynamics.friction, [0.0, 0.1, 0.05, 0.0, 0.1], atol=1e-16)


@pytest.mark.parametrize("robot_seed", range(3))
def test_a_robot_without_mimic_joints_has_no_detour(robot_seed):
    robot = following_tree(robot_seed, 4, 0)
    assert Kinematics(robot).mimic_joints is None
    assert Dynamics(robot).mimic_joints is None
