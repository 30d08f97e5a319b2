"""Gradients, Jacobians and rates of every task against difference quotients."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from registered_tasks import velocity_tasks
from support.robots.following_arm import following
from task_cases import ARM, CASES, HOAP3, SEEDS, kinematics_of

from hoap3.protocol.errors import ConfigError
from hoap3.remote_controller.model.kinematics import Kinematics
from hoap3.remote_controller.tasks import status
from hoap3.remote_controller.tasks.frames.frame_pose import FramePoseTask
from hoap3.remote_controller.tasks.registry import TaskSettings, build
from hoap3.testing import posture


def test_every_task_of_ours_is_tried():
    assert {name for _, name, _ in CASES.values()} == set(velocity_tasks())


def pose_task(robot, frame, reference, position, rotation):
    target = np.concatenate([position, pin.log3(rotation)])
    return FramePoseTask(kinematics_of(robot.name), frame, reference, target)


@settings(max_examples=30)
@given(seed=SEEDS, small=st.sampled_from([0.0, 1e-12, 1e-9, 1e-7, 1e-4, 1e-2]), sign=st.booleans())
def test_half_a_turn_is_named_and_finite(seed, small, sign):
    """V is the same on both sides of it, and the angle is right to the last digits."""
    rng, kinematics = np.random.default_rng(seed), kinematics_of(ARM.name)
    kinematics.update(posture(ARM, seed))
    task = FramePoseTask(kinematics, "tool", "base", np.zeros(6))
    task.update(kinematics)
    axis = rng.normal(size=3)
    axis /= np.linalg.norm(axis)
    angle = np.pi - small if sign else np.pi + small
    turn = pin.AngleAxis(angle, axis).matrix()
    task = pose_task(ARM, "tool", "base", task.position + 0.1, task.rotation @ turn.T)
    task.update(kinematics)
    assert np.isfinite(task.error).all()
    assert np.isfinite(task.jacobian).all()
    np.testing.assert_allclose(np.linalg.norm(task.error[3:]), np.pi - small, atol=1e-7)
    assert (task.status == status.AT_ANTIPODE) == (small <= 1e-7)
    if small <= 1e-12:
        # |e|² is even in the rotation vector: no jump of V across half a turn
        other = pin.AngleAxis(2 * np.pi - angle, axis).matrix()
        twin = FramePoseTask(kinematics, "tool", "base", task.target)
        there = task.rotation @ turn.T @ other.T
        np.testing.assert_allclose(there, task.rotation, atol=1e-9)
        twin.update(kinematics)
        assert twin.error @ twin.error == pytest.approx(task.error @ task.error, rel=1e-9)


@settings(max_examples=30)
@given(seed=SEEDS)
def test_what_a_pose_task_reads_it_can_aim_at(seed):
    """Of both rotation vectors it gives the one nearer to the target's, and the error vanishes."""
    kinematics, rng = kinematics_of(HOAP3.name), np.random.default_rng(seed)
    kinematics.update(posture(HOAP3, seed))
    near = 3.0 * rng.normal(size=3)
    task = FramePoseTask(kinematics, "r_forearm", "l_sole", np.array([0, 0, 0, *near]))
    out = np.zeros(6)
    task.read(kinematics, out)
    length = np.linalg.norm(out[3:])
    other = out[3:] * (1.0 - 2.0 * np.pi / length)
    assert np.linalg.norm(out[3:] - near) <= np.linalg.norm(other - near) + 1e-12
    task.target[:] = out
    task.update(kinematics)
    np.testing.assert_allclose(task.error, 0.0, atol=1e-12)


def test_derivatives_are_looked_at_where_joints_have_no_limits_too():
    robot = following()
    for fault in ("", "gradient"):
        settings = TaskSettings(task="own_tasks:Sway", parameters={"fault": fault})
        if not fault:
            assert build(settings, robot, Kinematics(robot)).gradient.shape == (robot.n,)
            continue
        with pytest.raises(ConfigError, match="gradient"):
            build(settings, robot, Kinematics(robot))
