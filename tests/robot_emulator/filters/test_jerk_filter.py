"""Whatever stream arrives, the reference keeps position, velocity, acceleration and jerk."""

from __future__ import annotations

import numpy as np
import pytest
import ruckig
from hypothesis import given, settings
from hypothesis import strategies as st
from jerk_attacks import JERK_ATTACKS, JerkAttacked
from setpoint_attacks import N, T

from hoap3.robot_emulator.filters.jerk_block_kernels import WORK
from hoap3.robot_emulator.filters.jerk_kernels import filter_jerk

SEEDS = st.integers(0, 2**32 - 1)


@settings(max_examples=15)
@given(seed=SEEDS, ease=st.floats(0.05, 0.999))
def test_a_wave_within_the_limits_passes_bit_by_bit(seed, ease):
    robot = JerkAttacked(seed)
    lower, upper, speed, A = robot.limits
    room = np.minimum(upper - robot.value, robot.value - lower)
    turn = 10.0 ** robot.rng.uniform(0, 1.5, N)  # rad/s
    half = [room / 2, speed / turn, A / turn**2, robot.jerk / turn**3]
    start, reach = robot.value.copy(), 0.7 * ease * np.minimum.reduce(half)
    for step in range(1, 1000):
        t = turn * step * T
        eased = np.where(t < np.pi, (t - np.sin(t) * np.cos(t)) / np.pi, 1.0)  # 0 to 1
        asked = start + reach * eased * (1.0 - np.cos(t)) / 4.0
        assert robot.ask(asked) == -1
        np.testing.assert_array_equal(robot.value, asked)


@pytest.mark.parametrize("name", ["noise", "greedy", "jumps", "chirps"])
@settings(max_examples=4)
@given(seed=SEEDS)
def test_motions_at_the_very_limits_pass_bit_by_bit(name, seed):
    """What one filter lets through goes as fast as can be, and is no more than another allows."""
    robot = JerkAttacked(seed)
    start = robot.value.copy()
    for step in range(1500):
        robot.ask(JERK_ATTACKS[name](robot, step))
    again = JerkAttacked(seed, start=start)
    for place in robot.places[1:]:
        assert again.ask(place) == -1
        np.testing.assert_array_equal(again.value, place)


def least_times(start, goal, limits, jerk):
    """Of ruckig, from rest to rest, in periods; (N,)."""
    found = np.zeros(N)
    for i in range(N):
        given, trajectory = ruckig.InputParameter(1), ruckig.Trajectory(1)
        given.current_position, given.target_position = [start[i]], [goal[i]]
        given.max_velocity, given.max_acceleration = [limits[2, i]], [limits[3, i]]
        given.max_jerk = [jerk[i]]
        ruckig.Ruckig(1).calculate(given, trajectory)
        found[i] = trajectory.duration / T
    return found


@settings(max_examples=10)
@given(seed=SEEDS)
def test_a_jump_is_reached_in_ruckigs_time_and_never_passed(seed):
    robot = JerkAttacked(seed)
    start, goal = robot.value.copy(), robot.rng.uniform(*robot.limits[:2])
    ticks = 1.05 * least_times(start, goal, robot.limits, robot.jerk) + 3.0
    arrived = np.zeros(N)
    for tick in range(1, int(min(ticks.max(), 3000)) + 1):
        robot.ask(goal)
        arrived[(robot.value == goal) & (arrived == 0)] = tick
    robot.check()
    judged = (ticks <= 3000) & (np.abs(goal - start) > robot.jerk * T**3)
    assert np.all(arrived[judged] > 0)
    assert np.all(arrived[judged] <= ticks[judged])
    np.testing.assert_array_equal(robot.value[judged], goal[judged])  # and stays there
    passed = (np.array(robot.places) - goal) * np.sign(goal - start)
    assert np.all(passed[:, judged] <= 0.0)


@settings(max_examples=10)
@given(seed=SEEDS)
def test_it_catches_up_with_a_motion_and_then_follows_it(seed):
    plain = np.array([np.full(N, limit) for limit in (-2.0, 2.0, 4.0, 100.0)])
    robot = JerkAttacked(seed, plain, np.full(N, 5000.0))
    motion = 0.5 * np.sin(3.0 * T * np.arange(2500))[:, None] * robot.rng.uniform(-1, 1, N)
    for step, asked in enumerate(motion):  # from somewhere else
        assert robot.ask(asked) == -1 or step < 2000
    robot.check()
    np.testing.assert_array_equal(robot.places[-1], motion[-1])


@settings(max_examples=10)
@given(seed=SEEDS)
def test_where_the_setpoint_is_no_number_it_comes_to_rest_and_stays(seed):
    plain = np.array([np.full(N, limit) for limit in (-2.0, 2.0, 4.0, 1000.0)])
    robot = JerkAttacked(seed, plain, np.full(N, 1e5))
    for step in range(50):
        robot.ask(JERK_ATTACKS["greedy"](robot, step))
    for _ in range(80):
        robot.ask(np.full(N, np.nan))
    np.testing.assert_array_equal(robot.velocity, 0.0)
    assert robot.places[-1].tobytes() == robot.places[-2].tobytes()
    robot.check()


def test_a_joint_without_a_limit_of_jerk_moves_as_it_would_without_the_others():
    from setpoint_attacks import ATTACKS, Attacked

    limits = np.array([np.full(N, limit) for limit in (-2.0, 2.0, 4.0, 1000.0)])
    jerk = np.full(N, np.inf)
    jerk[3] = 1e5
    one, other = JerkAttacked(7, limits, jerk), Attacked(7, limits)
    free = np.arange(N) != 3
    for step in range(2000):
        asked = ATTACKS["jumps"](other, step)
        one.ask(asked)
        other.ask(asked)
        np.testing.assert_array_equal(one.value[free], other.value[free])


@pytest.mark.parametrize("name", ["noise", "jumps", "greedy", "extremes"])
def test_a_joint_moves_as_it_would_in_another_company(name):
    """Many joints are worked out together; bit by bit no answer depends on another.

    Some have no limit of jerk, and now and then the last setpoint is asked for again.
    """
    robots = [JerkAttacked(seed) for seed in range(11)]
    for robot in robots[::2]:
        robot.all[4, ::3] = np.inf
    limits = np.ascontiguousarray(np.hstack([robot.all for robot in robots]))
    value = np.hstack([robot.value for robot in robots])
    history, motion = np.tile(value, (3, 1)), np.array([value, *np.zeros((2, value.size))])
    for step in range(300):
        asked = np.hstack([JERK_ATTACKS[name](robot, step) for robot in robots])
        asked = history[0] if step % 5 == 4 else asked  # as a robot does that holds
        apart = np.split(asked.copy(), len(robots))
        filter_jerk(asked, history, limits, T, motion, np.full(WORK, np.nan))
        for robot, own in zip(robots, apart, strict=True):
            robot.ask(own)
        np.testing.assert_array_equal(motion, np.hstack([robot.motion for robot in robots]))
