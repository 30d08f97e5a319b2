"""A robot with a limit of jerk: what it follows, how it stops, and how it comes in from outside."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.small_arm import arm

from hoap3.protocol.robot.description import RobotDescription
from hoap3.robot_emulator.filters.jerk import JerkFilter, jerk_notes, limits_jerk
from hoap3.robot_emulator.filters.position import PositionFilter

T = 1e-3
A, B, J = 150.0, 40.0, 5000.0


def smooth(**changes: object) -> RobotDescription:
    """The small arm, whose joints have a limit of jerk."""
    limits = {"setpoint_acceleration_max": A, "setpoint_jerk_max": J, **changes}
    return arm(joints=tuple(joint.model_copy(update=limits) for joint in arm().joints))


def at_start(robot: RobotDescription) -> JerkFilter:
    found = JerkFilter(robot, T)
    found.reset(robot.initial_position)
    return found


def moving(robot: RobotDescription, goal: np.ndarray, ticks: int) -> tuple[JerkFilter, list]:
    """On the way to a goal, and where it was, from three periods of rest on."""
    reference = at_start(robot)
    places = [reference.value.copy()] * 3
    for tick in range(ticks):
        reference.follow(goal, tick)
        places.append(reference.value.copy())
    return reference, places


def excess(places: list, order: int, most: float) -> float:
    """By how much differences of places exceed a limit, in ulp."""
    seen = np.abs(np.diff(np.array(places), order, axis=0))
    return float(((seen - most * T**order) / np.spacing(4.0)).max())


goals = st.lists(st.floats(-2.0, 2.0), min_size=3, max_size=3).map(np.array)


@settings(max_examples=40)
@given(goal=goals, ticks=st.integers(1, 400))
def test_a_stop_keeps_all_limits_and_ends_at_rest_with_no_acceleration(goal, ticks):
    robot = smooth()
    reference, places = moving(robot, goal, ticks)
    rates = [reference.rate.copy()]
    reference.begin_stop()
    while not reference.brake():
        places.append(reference.value.copy())
        rates.append(reference.rate.copy())
        assert len(rates) < 2000
    places += [reference.value.copy()] * 4  # brakes hold it
    np.testing.assert_array_equal(reference.rate, 0.0)
    assert excess(places, 3, J) <= 12
    assert excess(places, 2, A) <= 12
    assert reference.held_back == -1


@settings(max_examples=20)
@given(goal=goals, ticks=st.integers(100, 400))
def test_a_stop_takes_no_longer_than_it_is_said_to(goal, ticks):
    reference, places = moving(smooth(), goal, ticks)
    v, a = reference.rate.copy(), (np.diff(places[-3:], 2, axis=0)[0]) / T**2
    reference.begin_stop()
    periods = 1
    while not reference.brake():
        periods += 1
    left = np.abs(v + np.sign(a) * a**2 / J).max()
    long = left / B + 2 * B / J if left > 2 * B**2 / J else 2 * np.sqrt(2 * left / J)
    assert periods * T <= max(long, 2 * np.abs(a).max() / J) + 3 * T


@settings(max_examples=20)
@given(speeds=st.lists(st.floats(0.1, 2.0), min_size=3, max_size=3).map(np.array))
def test_joints_without_acceleration_stop_in_a_straight_line(speeds):
    reference = at_start(smooth())
    place = reference.value.copy()
    for tick in range(150):
        share = min(1.0, tick / 100.0)
        place = place + speeds * T * share * share * (3.0 - 2.0 * share) / 10.0
        assert reference.follow(place, tick) == -1
    before = reference.rate.copy()
    reference.begin_stop()
    for _ in range(10):
        reference.brake()
        np.testing.assert_allclose(
            reference.rate / before, reference.rate[0] / before[0], rtol=1e-9
        )


def test_a_stop_ends_at_a_limit_that_is_nearer_with_all_limits_kept():
    robot = smooth(brake_acceleration=2.0)
    goal = np.array([9.0, 9.0, 9.0])
    reference, places = moving(robot, goal, 1)
    while (reference.value < robot.upper - 0.2).all():
        reference.hold()
        places.append(reference.value.copy())
    reference.begin_stop()
    while not reference.brake():
        places.append(reference.value.copy())
    assert (np.array(places) <= robot.upper).all()
    assert excess(places, 3, J) <= 12
    assert reference.interventions > 0


def test_a_stop_that_is_broken_off_leaves_no_jump_behind():
    """Recovered at once, the robot follows again, with accelerations and jerks within limits."""
    robot = smooth()
    reference, places = moving(robot, robot.initial_position + 1.0, 150)
    for _ in range(3):
        reference.begin_stop()
        while not reference.brake():
            places.append(reference.value.copy())
        places.append(reference.value.copy())
        reference.forget()
        for tick in range(130):
            reference.follow(robot.initial_position - 1.0, tick)
            places.append(reference.value.copy())
    assert excess(places, 3, J) <= 12


def test_a_robot_that_starts_outside_its_usable_range_comes_in_and_stays_in():
    robot = smooth()
    outside = robot.model_copy(update={"postures": {"start": (2.05, -2.1, 0.0)}})
    reference, places = moving(outside, np.array([2.2, -2.2, 0.0]), 50)
    np.testing.assert_array_equal(reference.value, outside.initial_position)
    furthest = reference.value.copy()
    for tick in range(600):
        inwards = tick % 100 < 60
        reference.follow(
            np.array([1.9, -1.9, 0.0]) if inwards else np.array([9.0, -9.0, 0.0]), tick
        )
        places.append(reference.value.copy())
    assert (np.array(places)[:, 0] <= furthest[0]).all()
    assert (np.array(places)[:, 1] >= furthest[1]).all()
    for tick in range(600):
        reference.follow(np.zeros(3), tick)
        places.append(reference.value.copy())
    for tick in range(1500):
        reference.follow(np.array([9.0, -9.0, 0.0]), tick)
        places.append(reference.value.copy())
    np.testing.assert_array_equal(reference.value[:2], [2.0, -2.0])
    assert excess(places, 3, J) <= 12


def test_a_limit_that_accelerations_keep_is_none():
    robot = smooth(setpoint_jerk_max=2.0 * A / T)
    assert not limits_jerk(robot)
    assert limits_jerk(smooth())
    assert not limits_jerk(arm())


@pytest.mark.parametrize("name", ["lower", "velocity"])
def test_a_joint_that_cannot_use_its_acceleration_is_named(name):
    little = {"lower": {"lower": -0.01, "upper": 0.01}, "velocity": {"velocity": 0.5}}[name]
    joints = list(smooth().joints)
    joints[1] = joints[1].model_copy(update=little)
    robot = smooth().model_copy(update={"joints": tuple(joints), "postures": {"start": (0, 0, 0)}})
    (note,) = jerk_notes(robot)
    assert joints[1].name in note
    assert jerk_notes(smooth(setpoint_jerk_max=1e5)) == []


def test_it_extrapolates_within_the_limits_as_the_filter_without_does():
    reference = at_start(smooth())
    plain = PositionFilter(arm(), T)
    plain.reset(arm().initial_position)
    for each in (reference, plain):
        place = each.value.copy()
        for tick in range(100):
            place = place + 1e-6 * np.minimum(tick, 50) / 50.0
            assert each.follow(place, tick) == -1
        for _ in range(5):
            assert each.extrapolate() == -1
    np.testing.assert_array_equal(reference.value, plain.value)
