"""What joints with a limit of jerk can do, and what a robot does with setpoints, by what it means.

The rule: 1e-7 of what the acceleration may change by in a period, for each period that a stop
takes, as an approach keeps 1e-8 of A and J in reserve; and what is kept for rounding. What is as
near as that to the edge of what a robot takes over may be judged either way. So may an approach
whose stop goes either way within the accelerations of one period: where it turns, its end jumps, so
that there is no acceleration after which it ends at the setpoint.
"""

from __future__ import annotations

import numpy as np
import pytest
from braking_joints import T, asked_of, braking_joints, rounding

from hoap3.protocol.limits import jerk_limits_oracle as plain
from hoap3.protocol.limits.jerk_limits import kept_acceleration
from hoap3.robot_emulator.filters.jerk_block_kernels import WORK
from hoap3.robot_emulator.filters.jerk_filter_reference import filtered, own_motion, room_left
from hoap3.robot_emulator.filters.jerk_kernels import brake_ends, filter_jerk, steer

JOINTS = 700  # of each seed
SEEDS = [range(1), pytest.param(range(1, 8), marks=pytest.mark.slow)]
many = pytest.mark.parametrize("seeds", SEEDS, ids=["some", "many"])


def test_the_maximal_brake_and_its_release_are_what_is_written():
    one = np.ones(1)
    # from 2 m/s, accelerating by 1: 2 + 0, 2 - 1, 1 - 2 of T = J = 1 and A = 2
    np.testing.assert_allclose(plain.brake_peak(2 * one, one, 2 * one, one, 1.0), [3.0])
    np.testing.assert_allclose(plain.release(3.5 * one, one, 1.0), [2.5 + 1.5 + 0.5])
    # brakes by 1, 2 and 1: 4 - 1, 3 - 2, 1 - 1
    np.testing.assert_allclose(plain.stop_end(4 * one, 0 * one, 2 * one, one, 1.0), [4.0])


@many
def test_brakes_end_where_the_sums_of_their_steps_do(seeds):
    for seed in seeds:
        limits, (q, v, a), _ = braking_joints(np.random.default_rng(seed), JOINTS)
        lowest, highest = np.empty((2, q.size))
        brake_ends(limits, T, np.array([q, v, a]), lowest, highest)
        A, J = limits[3], limits[4]
        np.testing.assert_allclose(highest - q, plain.brake_peak(v, a, A, J, T), atol=1e-12)
        np.testing.assert_allclose(q - lowest, plain.brake_peak(-v, -a, A, J, T), atol=1e-12)


@many
def test_there_always_is_an_acceleration_that_keeps_all_limits_and_steering_takes_it(seeds):
    """The interval is not empty, and `steer` has its ends where more is wanted."""
    for seed in seeds:
        limits, at, _ = braking_joints(np.random.default_rng(seed), JOINTS)
        q, v, a = at
        least, most = plain.acceleration_bounds(q, v, a, limits, T)
        close = rounding(limits, at)
        assert np.all(least <= most + close)
        for end, wanted in ((least, -1e9), (most, 1e9)):
            inside = np.clip(v + T * np.where(wanted > 0, np.inf, -np.inf), -1e9, 1e9)
            motion = np.array([q, v, a])
            steer(inside, limits, T, motion)
            _, velocity, acceleration = motion
            assert np.all(acceleration <= most + close)
            assert np.all(acceleration >= least - close)
            within = v + T * (end + 1.001 * np.copysign(close, -wanted))
            fits = most - least > 4.0 * close
            motion = np.array([q, v, a])
            steer(within, limits, T, motion)
            _, velocity, acceleration = motion
            np.testing.assert_array_equal(velocity[fits], within[fits])


def turns(setpoint, history, limits, at):
    """Whether a stop beside a setpoint ends on either side within one period, (n,)."""
    _, v, a = at
    A, J = limits[3:]
    _, r, c = own_motion(setpoint, history, limits, T)
    sides = []
    for step in (-J * T, J * T):
        x = np.clip(a + step, -A, A) - c
        w = v - r + c * T + x * T
        sides.append(w + np.sign(x) * plain.release(x, J, T) >= 0.0)
    return sides[0] != sides[1]


@many
def test_a_robot_goes_to_setpoints_or_approaches_them(seeds):
    taken = held = 0
    for seed in seeds:
        rng = np.random.default_rng(seed)
        limits, at, history = braking_joints(rng, JOINTS)
        setpoint = asked_of(rng, limits, at, history)
        q, v, a = at
        motion = np.array([q, v, a])
        place, _, acceleration = motion
        work = np.full(WORK, np.nan)
        filter_jerk(setpoint, history.copy(), limits, T, motion, work)
        close = rounding(limits, at)
        left = room_left(setpoint, history, limits, T, at)
        known = np.abs(left) > close
        expected = filtered(setpoint, history, limits, T, at)
        error = np.abs(acceleration - expected) / close
        least, most = plain.acceleration_bounds(q, v, a, limits, T)
        assert np.all((acceleration >= least - close) & (acceleration <= most + close))
        known &= (left > 0.0) | ~turns(setpoint, history, limits, at)
        assert np.all(error[known] <= 1.0)
        there = known & (left > 0.0)
        np.testing.assert_array_equal(place[there], setpoint[there])  # bit by bit
        taken, held = taken + there.sum(), held + (known & ~there).sum()
    assert min(taken, held) > 0.1 * JOINTS * len(seeds)
    assert taken + held > 0.6 * JOINTS * len(seeds)  # a stop turns in three of ten


def test_less_acceleration_is_let_have_where_range_or_speed_are_too_small_for_it():
    A, J = np.full(4, 10.0), np.array([100.0, 100.0, 100.0, np.inf])
    lower, upper = np.zeros(4), np.array([9.0, 0.01, 9.0, 0.01])
    speed = np.array([9.0, 9.0, 0.2, 0.2])
    kept = kept_acceleration(lower, upper, speed, A, J, T)
    assert kept[0] == kept[3] == 10.0
    np.testing.assert_allclose(kept[1], np.cbrt(1.5 * 0.01 * 100.0**2), rtol=1e-8)
    np.testing.assert_allclose(kept[2], np.sqrt(2 * 0.2 * 100.0) + 0.5 * 100.0 * T, rtol=1e-4)
