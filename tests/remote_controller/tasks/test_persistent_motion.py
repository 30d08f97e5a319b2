"""Motion along curves: tangent and its sign, both directions, and what is not a curve any more."""

from __future__ import annotations

import numpy as np
import pytest
from task_cases import ARM, HOAP3, kinematics_of

from hoap3.remote_controller.tasks import status
from hoap3.remote_controller.tasks.registry import TaskSettings, build

DT = 1e-3
ELLIPSE = {"joints": ["elbow", "wrist"], "radii_rad": [0.3, 0.2]}
CIRCLE = {"joints": ["elbow", "wrist"], "radii_rad": [0.3, 0.3]}


def made(robot, task, **parameters):
    settings = TaskSettings(task=task, parameters=parameters)
    return build(settings, robot, kinematics_of(robot.name))


def arm_curve(curve="joint_ellipse", speed=0.5, **parameters):
    return made(ARM, "joint_curve", curve=curve, speed_rad_s=speed, **parameters)


def com_ellipse(direction="forward"):
    return made(
        HOAP3,
        "task_curve",
        curve_parameters={"center_m": [0.0, 0.03, 0.27], "radii_m": [0.015, 0.01]},
        speed_m_s=0.05,
        direction=direction,
    )


def see(motion, robot, q, tick=0):
    kinematics = kinematics_of(robot.name)
    kinematics.update(q)
    if tick == 0:
        motion.reset(kinematics, 0.0)
    motion.update(kinematics, tick * DT)


def circulate(motion, robot, ticks, q=None, gain=20.0):
    """Euler steps of (23) with Ψ = gain·V, and what was seen at each: x, V, u, status."""
    q = np.array(robot.initial_position) if q is None else q.copy()
    u, seen = np.zeros(robot.n), []
    for tick in range(ticks):
        see(motion, robot, q, tick)
        decrease = gain * motion.value
        if not motion.velocity(decrease, u):
            assert motion.status != status.OK or motion.value == 0.0
        seen.append((motion.x.copy(), motion.value, u.copy(), motion.status))
        q += u * DT
    return [np.array(each) for each in zip(*seen, strict=True)]


def turns(x, center, first, second):
    """Whole turns round a centre, counted from the first axis to the second."""
    angle = np.unwrap(np.arctan2(x[:, second] - center[second], x[:, first] - center[first]))
    return (angle[-1] - angle[0]) / (2.0 * np.pi)


@pytest.mark.parametrize("direction", ["forward", "backward"])
def test_joints_circulate_a_circle_both_ways(direction):
    start = np.array([0.4, 1.3, -0.2])  # off the circle, and the shoulder off its place
    motion = arm_curve(curve_parameters=CIRCLE, direction=direction)
    x, v, u, statuses = circulate(motion, ARM, 8000, start)
    assert not statuses.any()
    # twice per second of V, at 20/s: after a second there is nothing but Euler's drift
    drift = 0.5**2 * DT / (2 * 0.3)  # of the radius [rad/s]
    assert np.all(v[1500:] <= 0.5 * (drift / 10.0) ** 2 * 1.1)
    assert np.all(np.diff(v[:500]) < 0.0)
    np.testing.assert_allclose(np.linalg.norm(u[1500:], axis=1), 0.5, rtol=1e-4)
    center = np.array(ARM.initial_position) - [0.0, 0.3, 0.0]
    np.testing.assert_allclose(
        turns(x[1500:], center, 1, 2),
        (-1 if direction == "backward" else 1) * 6.499 * 0.5 / 0.3 / (2 * np.pi),
        rtol=1e-3,
    )


@pytest.mark.parametrize("direction", ["forward", "backward"])
def test_the_centre_of_mass_circulates_both_ways(direction):
    motion = com_ellipse(direction)
    x, v, _, statuses = circulate(motion, HOAP3, 2500)
    assert not statuses.any()
    assert v[0] > 1e-5
    drift = 0.05**2 * DT / 2 * 150.0  # its largest curvature is a/b² = 150/m
    assert v[1500:].max() < 0.5 * (drift / 10.0) ** 2
    rounds = turns(x[1000:], np.array([0.0, 0.03, 0.27]), 0, 1)
    assert abs(rounds) == pytest.approx(1.5 * 0.05 / 0.0793, rel=0.05)  # perimeter 0.0793 m
    assert (rounds > 0.0) == (direction == "forward")


def test_the_sign_is_continuous_when_the_basis_flips():
    """α_2 and its gradient change sign every other tick; the set {α = 0} does not."""
    still, flipping = (
        arm_curve("own_tasks:Eight", curve_parameters={"flips": flips}) for flips in (False, True)
    )
    flipping.curve.calls = 1  # it begins with the one that the other has
    q = ARM.initial_position + np.array([0.01, 0.35, 0.15])
    steady = circulate(still, ARM, 300, q)
    flipped = circulate(flipping, ARM, 300, q)
    assert not flipped[3].any()
    np.testing.assert_allclose(flipped[0], steady[0], atol=1e-12)


def test_where_the_gradients_become_dependent_motion_fades_and_is_named():
    """Into the middle of an eight, where it crosses itself: no NaN, no jump, no way through."""
    motion = arm_curve("own_tasks:Eight", speed=0.4)
    q = ARM.initial_position + np.array([0.0, 0.2, 0.2 * np.sqrt(1 - 0.25)])
    x, _, u, statuses = circulate(motion, ARM, 2500, q)
    assert np.isfinite(u).all()
    assert np.isfinite(x).all()
    assert statuses[0] == status.OK
    assert statuses[-1] == status.DEPENDENT_GRADIENTS
    assert np.linalg.norm(u[-1]) < 0.02  # of 0.4
    assert np.max(np.linalg.norm(np.diff(u, axis=0), axis=1)) < 0.01
    away = np.linalg.norm(x[-1] - ARM.initial_position)
    assert 1e-4 < away < 5e-3


def test_in_the_centre_of_a_circle_nothing_moves():
    motion = arm_curve(curve_parameters=CIRCLE)
    center = np.array(ARM.initial_position) - [0.0, 0.3, 0.0]
    see(motion, ARM, center)
    u = np.full(3, np.nan)
    assert motion.status == status.DEPENDENT_GRADIENTS
    assert not motion.velocity(1.0, u)
    assert motion.velocity(0.0, u)
    np.testing.assert_array_equal(u, 0.0)
    assert motion.speed == 0.0
    for array in (motion.tangent, motion.motion_row, motion.gradient, motion.jacobian):
        assert np.isfinite(array).all()


def test_a_tangent_that_turns_too_fast_is_held_until_it_turns_back():
    motion = arm_curve("own_tasks:Turning")
    q, u = np.array([0.1, 1.0, -0.5]), np.zeros(3)
    see(motion, ARM, q, 0)
    tangent = motion.tangent.copy()
    motion.curve.axis = 1
    for tick in (1, 2):
        see(motion, ARM, q, tick)
        assert motion.status == status.TANGENT_TURNED
        assert motion.speed == 0.0
        np.testing.assert_array_equal(motion.tangent, tangent)
        motion.velocity(0.0, u)
        np.testing.assert_array_equal(u, 0.0)
    motion.curve.axis = 0
    see(motion, ARM, q, 3)
    assert motion.status == status.OK
    assert motion.speed == 0.5
    np.testing.assert_array_equal(motion.tangent, tangent)


def test_a_curve_sets_its_own_pace():
    motion = arm_curve("own_tasks:Helix", speed=0.4)
    see(motion, ARM, np.array([0.1, 0.2, 0.5]))
    assert motion.speed == pytest.approx(0.4 * (1.0 + 0.5 * np.sin(0.5)))


def test_a_run_repeats_bit_by_bit_after_a_reset():
    motion = arm_curve(curve_parameters=ELLIPSE)
    first, second = (circulate(motion, ARM, 200) for _ in range(2))
    for one, other in zip(first, second, strict=True):
        np.testing.assert_array_equal(one, other)
