"""M, h, and the motion of a frame in its own axes, against differences and Pinocchio itself."""

from __future__ import annotations

import numpy as np
import pytest

from hoap3.protocol.errors import FrameNotFoundError
from hoap3.protocol.robot.rigid_body_dynamics import Dynamics
from hoap3.remote_controller.model.frame_dynamics import (
    POSE,
    POSITION,
    FrameRows,
    FramesDynamics,
)
from hoap3.remote_controller.tasks.accelerations.se3_pd_kernels import (
    Asked,
    Motion,
    Pose,
    se3_pd,
)
from hoap3.robot_emulator.robots import load

ROBOTS = [
    ("baxter_left_arm", "left_gripper"),
    ("ur5", "tool0"),
    ("humanoid32", "l_hand"),
    ("hoap3", "l_sole"),
]
each_robot = pytest.mark.parametrize(("name", "frame"), ROBOTS)


def states(description, count=20):
    rng = np.random.default_rng(7)
    for _ in range(count):
        yield rng.uniform(description.lower, description.upper), 2 * rng.normal(size=description.n)


def of_frame(description, frame):
    return FramesDynamics(description, [FrameRows(frame, 0, POSE)], POSE)


def pose(dynamics, q, frame):
    return dynamics.placement(q, frame)


def cross_vector(skew):
    return np.array([skew[2, 1], skew[0, 2], skew[1, 0]])


@each_robot
def test_mass_and_bias_are_those_of_the_robot_in_wire_order(name, frame):
    description = load(name)
    dynamics, rigid = of_frame(description, frame), Dynamics(description)
    tau, ddq = np.zeros(description.n), np.random.default_rng(1).normal(size=description.n)
    for q, dq in states(description):
        dynamics.update(q, dq)
        rigid.inverse(q, dq, ddq, tau)
        np.testing.assert_allclose(dynamics.mass @ ddq + dynamics.bias, tau, atol=1e-11)
        np.testing.assert_array_equal(dynamics.mass, dynamics.mass.T)


@each_robot
def test_the_jacobian_is_the_twist_of_the_frame_in_its_own_axes(name, frame):
    description = load(name)
    dynamics, step = of_frame(description, frame), 1e-6
    for q, dq in states(description, 5):
        before, after = (pose(dynamics, q + sign * step * dq, frame) for sign in (-1, 1))
        origin, rotation = pose(dynamics, q, frame)
        linear = rotation.T @ (after[0] - before[0]) / (2 * step)
        angular = cross_vector(rotation.T @ (after[1] - before[1]) / (2 * step))
        dynamics.update(q, dq)
        np.testing.assert_allclose(dynamics.origins[0], origin, atol=1e-14)
        np.testing.assert_allclose(dynamics.twist, [*linear, *angular], atol=1e-7)
        np.testing.assert_allclose(dynamics.jacobian @ dq, dynamics.twist, atol=1e-13)


@each_robot
def test_the_drift_is_the_rate_of_the_twist_without_acceleration(name, frame):
    description = load(name)
    dynamics, step = of_frame(description, frame), 1e-6
    for q, dq in states(description, 5):
        twists = []
        for sign in (-1, 1):
            dynamics.update(q + sign * step * dq, dq)
            twists.append(dynamics.twist.copy())
        dynamics.update(q, dq)
        difference = (twists[1] - twists[0]) / (2 * step)
        np.testing.assert_allclose(dynamics.drift, difference, atol=2e-7)


@pytest.mark.parametrize("gravity", ["full", "compensated", "none"])
def test_gravity_is_what_the_description_says(gravity):
    description = load("ur5").model_copy(update={"gravity": gravity})
    dynamics, weight = of_frame(description, "tool0"), np.zeros(6)
    q = np.array([0.1, -1.0, 0.5, 0.3, 0.2, 0.1])
    dynamics.update(q, np.zeros(6))
    Dynamics(load("ur5")).gravity(q, weight)
    assert np.abs(weight).max() > 10.0
    expected = np.zeros(6) if gravity == "none" else weight
    np.testing.assert_allclose(dynamics.bias, expected, atol=1e-12)
    added = weight if gravity == "compensated" else np.zeros(6)
    np.testing.assert_allclose(dynamics.weight, added, atol=1e-12)


def test_a_frame_that_stands_is_known_from_one_that_moves():
    dynamics = of_frame(load("ur5"), "tool0")
    assert dynamics.stands(load("ur5").base_frame)
    assert not dynamics.stands("tool0")
    with pytest.raises(FrameNotFoundError):
        of_frame(load("ur5"), "tool1")


def aimed(origin, rotation, goal, turn, twist, drift=None, kp=0.0, kd=0.0):
    error, wanted, slope = np.zeros((3, 6))
    drift = np.zeros(6) if drift is None else drift
    arrays = [np.array(each, order="C") for each in (origin, rotation, goal, turn)]
    frame, target = Pose(*arrays[:2]), Pose(*arrays[2:])
    out = Asked(error, wanted, slope)
    V, where = se3_pd(frame, target, Motion(twist, drift), kp, kd, np.zeros((3, 3)), out)
    return V, where, error, wanted, slope


def test_half_a_turn_is_told():
    near, at = (np.diag([1.0, np.cos(a), np.cos(a)]) for a in (3.0, np.pi))
    near[1, 2], near[2, 1] = -np.sin(3.0), np.sin(3.0)
    origin = np.zeros(3)
    assert aimed(origin, np.eye(3), origin, near, np.zeros(6))[1] == 0
    assert aimed(origin, np.eye(3), origin, at, np.zeros(6))[1] == 1


SEVERAL = {
    "humanoid32": ("l_hand", "head", "l_hand", "r_sole", "pelvis"),
    "baxter_left_arm": ("left_gripper", "left_upper_elbow", "left_gripper"),
}


@pytest.mark.parametrize("name", SEVERAL)
def test_several_frames_at_once_are_as_each_of_them_alone(name):
    description, frames = load(name), SEVERAL[name]
    rows = [FrameRows(frame, 2 + 6 * place, POSE) for place, frame in enumerate(frames)]
    together = FramesDynamics(description, rows, 3 + 6 * len(frames))
    alone = [of_frame(description, frame) for frame in frames]
    for q, dq in states(description, 3):
        together.update(q, dq)
        for place, each in enumerate(alone):
            each.update(q, dq)
            start = rows[place].start
            mine = slice(start, start + 6)
            np.testing.assert_array_equal(together.jacobian[mine], each.jacobian)
            np.testing.assert_array_equal(together.twist[mine], each.twist)
            np.testing.assert_array_equal(together.drift[mine], each.drift)
            np.testing.assert_array_equal(together.origins[place], each.origins[0])
            np.testing.assert_array_equal(together.rotations[place], each.rotations[0])
        np.testing.assert_array_equal(together.mass, alone[0].mass)
    for row in (0, 1, -1):  # nobody's
        assert not together.jacobian[row].any()


@each_robot
def test_the_rows_of_a_position_are_its_velocity_and_acceleration_in_the_root(name, frame):
    description, step = load(name), 1e-6
    dynamics = FramesDynamics(description, [FrameRows(frame, 1, POSITION)], 4)
    for q, dq in states(description, 5):
        places, velocities = [], []
        for sign in (-1, 1):
            dynamics.update(q + sign * step * dq, dq)
            places.append(dynamics.origins[0].copy())
            velocities.append(dynamics.twist[1:].copy())
        dynamics.update(q, dq)
        velocity = (places[1] - places[0]) / (2 * step)
        drift = (velocities[1] - velocities[0]) / (2 * step)
        np.testing.assert_allclose(dynamics.twist[1:], velocity, atol=1e-7)
        np.testing.assert_allclose((dynamics.jacobian @ dq)[1:], dynamics.twist[1:], atol=1e-13)
        np.testing.assert_allclose(dynamics.drift[1:], drift, atol=2e-7)
