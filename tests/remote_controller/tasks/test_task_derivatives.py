"""Gradients, Jacobians and rates of every task against difference quotients."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from registered_tasks import velocity_tasks
from support.robots.following_arm import following
from task_cases import ARM, CASES, HOAP3, SEEDS, built, kinematics_of

from hoap3.protocol.errors import ConfigError
from hoap3.remote_controller.model.kinematics import Kinematics
from hoap3.remote_controller.tasks import status
from hoap3.remote_controller.tasks.frames.frame_pose import FramePoseTask
from hoap3.remote_controller.tasks.registry import TaskSettings, build
from hoap3.remote_controller.tasks.task_function import TaskFunction
from hoap3.testing import posture, quotient

TIMES = st.floats(0.0, 4.0)
KINK = 2e-2  # rad from half a turn, where V has one
SMALL = (
    2e-2  # rad: below, pin.Jlog6 loses digits to 1e-16/angle³, 4e-5 at 1.5e-4, before its series
)


def started(case):
    """V of a case, reset at the initial posture, and what evaluates it anywhere."""
    robot, kinematics, function = built(case)
    kinematics.update(robot.initial_position)
    function.reset(kinematics, 0.0)

    def evaluate(q, time_s):
        kinematics.update(q)
        function.update(kinematics, time_s)
        return function

    return robot, function, evaluate


def test_every_task_of_ours_is_tried():
    assert {name for _, name, _ in CASES.values()} == set(velocity_tasks())


@pytest.mark.parametrize("case", CASES)
@settings(max_examples=8)
@given(seed=SEEDS, time_s=TIMES)
def test_gradient_and_rate_are_the_derivatives_of_v(case, seed, time_s):
    robot, function, evaluate = started(case)
    q = posture(robot, seed)
    evaluate(q, time_s)
    gradient, rate, value = function.gradient.copy(), function.rate, function.value
    assume(not near_half_a_turn(function))
    assert value >= 0.0
    tolerance = 1e-8 * max(1.0, value, np.max(np.abs(gradient)))
    slopes = quotient(lambda at: np.array(evaluate(at, time_s).value), q)
    np.testing.assert_allclose(gradient, slopes, rtol=0, atol=tolerance)
    slope = quotient(lambda at: np.array(evaluate(q, at[0]).value), np.array([time_s]))
    np.testing.assert_allclose(rate, slope[0], rtol=0, atol=1e-5)  # a trapezoid has corners


@pytest.mark.parametrize("case", CASES)
@settings(max_examples=4)
@given(seed=SEEDS, time_s=TIMES)
def test_v_is_half_the_square_of_its_error(case, seed, time_s):
    robot, function, evaluate = started(case)
    q = posture(robot, seed)
    evaluate(q, time_s)
    assume(not near_half_a_turn(function))
    error, jacobian = function.error.copy(), function.jacobian.copy()
    np.testing.assert_allclose(function.value, 0.5 * error @ error, rtol=1e-12)
    np.testing.assert_allclose(function.gradient, jacobian.T @ error, rtol=0, atol=1e-12)
    slopes = quotient(lambda at: evaluate(at, time_s).error.copy(), q)
    scale = max(1.0, np.max(np.abs(jacobian)))
    np.testing.assert_allclose(jacobian, slopes, rtol=0, atol=1e-7 * scale)


def near_half_a_turn(function):
    terms = [term for term, *_ in getattr(function, "_terms", [(function,)])]
    tasks = [term.task for term in terms if isinstance(term, TaskFunction)]
    return any(
        isinstance(task, FramePoseTask) and np.linalg.norm(task.error[3:]) > np.pi - KINK
        for task in tasks
    )


def pose_task(robot, frame, reference, position, rotation):
    target = np.concatenate([position, pin.log3(rotation)])
    return FramePoseTask(kinematics_of(robot.name), frame, reference, target)


@settings(max_examples=40)
@given(seed=SEEDS, angle=st.one_of(st.floats(0.0, np.pi - 1e-4), st.sampled_from([0.0, 0.2, 3.1])))
def test_the_pose_error_is_pinocchios_logarithm(seed, angle):
    """From no turn at all to nearly half a one; the last two figures are where series end."""
    compare_with_pinocchio(seed, angle)


@pytest.mark.parametrize("angle", [1e-6, 1e-4, 1.25e-4, 2e-4, 1e-3, 0.019, 0.021, 0.199, 0.201])
def test_its_jacobian_is_right_where_pinocchios_loses_digits(angle):
    for seed in range(5):
        compare_with_pinocchio(seed, angle)


def compare_with_pinocchio(seed, angle):
    rng, kinematics = np.random.default_rng(seed), kinematics_of(ARM.name)
    axis = rng.normal(size=3)
    q = posture(ARM, seed)
    task = FramePoseTask(kinematics, "tool", "base", np.zeros(6))
    kinematics.update(q)
    task.update(kinematics)
    here = pin.SE3(task.rotation.copy(), task.position.copy())
    away = pin.SE3(pin.exp3(angle * axis / np.linalg.norm(axis)), rng.normal(size=3))
    goal = here * away.inverse()  # so that goal⁻¹ here = away
    task = pose_task(ARM, "tool", "base", goal.translation, goal.rotation)
    task.update(kinematics)
    np.testing.assert_allclose(task.error, pin.log6(away).vector, rtol=0, atol=1e-9)
    twist = np.zeros((6, ARM.n))
    numbers = kinematics.frame_id("tool"), kinematics.frame_id("base")
    kinematics.frame(*numbers, np.zeros(3), np.zeros((3, 3)), twist)
    body = np.kron(np.eye(2), here.rotation.T) @ twist
    np.testing.assert_allclose(task.jacobian, log6_slopes(away, angle) @ body, rtol=0, atol=1e-7)


def log6_slopes(away, angle):
    """Derivative of the logarithm by a twist in its own axes; pinocchio's, where it is accurate."""
    if angle >= SMALL:
        return pin.Jlog6(away)

    def log(twist):
        return pin.log6(away * pin.exp6(twist)).vector

    fine, coarse = (
        np.stack([(log(h * axis) - log(-h * axis)) / (2 * h) for axis in np.eye(6)], axis=-1)
        for h in (1e-3, 2e-3)
    )
    return (4 * fine - coarse) / 3


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
