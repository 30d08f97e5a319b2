"""Velocities that let joints stop, and what a robot does with setpoints, by what they mean.

The rule: 1e-10 of the greatest speed, and what the kernels reserve for rounding, in a period. What
is as near as that to the edge of what a robot takes over may be judged either way.
"""

from __future__ import annotations

import numpy as np
import pytest
from stopping_joints import T, asked, limited_joints, rounding

from hoap3.protocol.limits import setpoint_limits_oracle as plain
from hoap3.remote_controller.constraints.joints.viability_kernels import velocity_bounds
from hoap3.remote_controller.model.kinematics_kernels import FOLLOWED, euler_step
from hoap3.robot_emulator.filters.position_kernels import filter_setpoint
from hoap3.robot_emulator.filters.setpoint_filter_reference import filtered, own_motion

JOINTS = 250  # of each seed
SEEDS = [range(20), pytest.param(range(20, 100), marks=pytest.mark.slow)]
many = pytest.mark.parametrize("seeds", SEEDS, ids=["some", "many"])


def test_braking_takes_what_is_written_and_no_more_fits():
    rng = np.random.default_rng(1)
    room, A = 10.0 ** rng.uniform(-6, 0, 300), 10.0 ** rng.uniform(1.5, 3.5, 300)
    w = plain.stopping_speed(room, A, T)
    np.testing.assert_allclose(plain.way(w, A, T), room, rtol=1e-12)
    one = plain.way(np.array([2.5e-3]), np.array([1.0]), T)
    np.testing.assert_allclose(one, T * (2.5e-3 + 1.5e-3 + 0.5e-3), rtol=1e-12)


@many
def test_bounds_of_velocities_are_the_greatest_that_let_joints_stop(seeds):
    for seed in seeds:
        limits, q, v = limited_joints(np.random.default_rng(seed), JOINTS)
        least, most = np.empty((2, JOINTS))
        velocity_bounds(q, v, limits, T, least, most)
        lowest, greatest = plain.velocity_bounds(q, v, limits, T)
        close = rounding(limits, q)
        assert np.all(np.abs(least - lowest) <= close)
        assert np.all(np.abs(most - greatest) <= close)


@many
def test_a_step_is_judged_as_it_can_be_followed(seeds):
    taken = held = 0
    for seed in seeds:
        rng = np.random.default_rng(seed)
        limits, q, v = limited_joints(rng, JOINTS)
        s, before = asked(rng, limits, q, v)
        last = np.clip(before, limits[0], limits[1])
        left = plain.room_left(s, plain.own_start(last, s, limits[2], T), q, v, limits, T)
        for i in np.flatnonzero(np.abs(left) > rounding(limits, q)):
            it, start, u = slice(i, i + 1), np.zeros(1), s[i : i + 1] / T
            earlier, answer = q[it] - v[it] * T, before[it].copy()
            own = np.ascontiguousarray(limits[:, it])
            _, beyond = euler_step(start, u, T, 0.0, FOLLOWED, q[it], own, earlier, answer)
            assert beyond == (left[i] < 0.0)
            taken, held = taken + (left[i] > 0.0), held + beyond
    assert min(taken, held) > 0.1 * JOINTS * len(seeds)
    assert taken + held > 0.95 * JOINTS * len(seeds)


@many
def test_a_robot_goes_to_setpoints_or_approaches_them(seeds):
    taken = held = 0
    for seed in seeds:
        rng = np.random.default_rng(seed)
        limits, q, v = limited_joints(rng, JOINTS)
        setpoint, before = asked(rng, limits, q, v)
        setpoint[rng.random(JOINTS) < 0.02] = before[rng.random(JOINTS) < 0.02] = np.nan
        place, velocity = q.copy(), v.copy()
        first = filter_setpoint(setpoint, before, limits, T, place, velocity)
        assert first == np.flatnonzero(place != setpoint)[0]
        s, start = own_motion(setpoint, before, limits, T, q)
        left, close = plain.room_left(s, start, q, v, limits, T), rounding(limits, q)
        known = np.abs(left) > close
        expected, w = filtered(setpoint, before, limits, T, q, v)
        assert np.all(np.abs(velocity - w)[known] <= close[known])
        assert np.all(np.abs(place - expected)[known] <= close[known] * T)
        there = known & (left > 0.0)
        np.testing.assert_array_equal(place[there], s[there])  # bit by bit
        taken, held = taken + there.sum(), held + (known & ~there).sum()
    assert min(taken, held) > 0.1 * JOINTS * len(seeds)
    assert taken + held > 0.85 * JOINTS * len(seeds)
