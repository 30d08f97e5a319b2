"""Whatever stream of setpoints arrives, the reference keeps all limits, at and between ticks."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from jerk_attacks import JERK_ATTACKS, JerkAttacked
from setpoint_attacks import ATTACKS, Attacked, N, T

SEEDS = st.integers(0, 2**32 - 1)
PLAIN = np.array([np.full(N, limit) for limit in (-2.0, 2.0, 4.0, 1000.0)])
ALL_ATTACKS = [(Attacked, attack) for attack in ATTACKS.values()]
ALL_ATTACKS += [(JerkAttacked, attack) for attack in JERK_ATTACKS.values()]
attacked = pytest.mark.parametrize(("kind", "attack"), ALL_ATTACKS)


@attacked
@settings(max_examples=8)
@given(seed=SEEDS)
def test_no_attack_moves_it_beyond_a_limit(kind, attack, seed):
    robot = kind(seed)
    for step in range(1500):
        robot.ask(attack(robot, step))
    robot.check()
    assert robot.held > 0  # it was one


@pytest.mark.long
@attacked
def test_not_in_a_million_cycles_either(kind, attack):
    for seed in range(100):
        robot = kind(seed)
        for step in range(10_000):
            robot.ask(attack(robot, step))
        robot.check()


@settings(max_examples=20)
@given(seed=SEEDS, ease=st.floats(0.05, 0.999))
def test_a_motion_within_the_limits_passes_bit_by_bit(seed, ease):
    robot = Attacked(seed)
    lower, upper, speed, acceleration = robot.limits
    room = np.minimum(upper - robot.value, robot.value - lower)
    turn = 10.0 ** robot.rng.uniform(0, 1.5, N)  # rad/s
    reach = ease * np.minimum(np.minimum(room / 2, speed / turn), acceleration / turn**2)
    start = robot.value.copy()
    for step in range(1, 1000):
        asked = start + reach * (1.0 - np.cos(turn * step * T))
        assert robot.ask(asked) == -1
        np.testing.assert_array_equal(robot.value, asked)


@settings(max_examples=20)
@given(seed=SEEDS)
def test_euler_steps_at_the_greatest_speed_pass_bit_by_bit(seed):
    """As a controller takes them: from the reference, with u up to the very limit; through 0."""
    rng = np.random.default_rng(seed)
    robot = Attacked(seed, PLAIN, rng.uniform(-0.1, 0.1, N))
    sign = robot.rng.choice([-1.0, 1.0], N)
    for u in (0.9, 1.8, 2.7, 3.6, *[4.0] * 100, 3.1, 2.2, 1.3, 0.4, -0.4, 0.0):
        asked = robot.value + sign * u * T
        assert robot.ask(asked) == -1
        np.testing.assert_array_equal(robot.value, asked)
    robot.check()


@settings(max_examples=20)
@given(seed=SEEDS, back=st.floats(0.01, 1.0))
def test_turning_round_as_fast_as_can_be_passes_bit_by_bit(seed, back):
    """QP12 with a constant γ chatters so, and what HOAP-3 allows is made for it."""
    rng = np.random.default_rng(seed)
    start = rng.uniform(-1.0, 1.0, N) * 10.0 ** rng.uniform(-4, 0, N)
    speed = 0.6 * back
    limits = np.array([np.full(N, limit) for limit in (-2.0, 2.0, 4.76, 2.0 * speed / T)])
    robot = Attacked(seed, limits, start)
    for u in (speed, *[-speed, speed] * 50, 0.0):
        asked = robot.value + u * T
        assert robot.ask(asked) == -1
        np.testing.assert_array_equal(robot.value, asked)
    robot.check()


@settings(max_examples=20)
@example(seed=1056)  # a joint so weak that braking from its greatest speed takes minutes
@given(seed=SEEDS)
def test_a_jump_is_reached_in_the_least_time_and_never_passed(seed):
    robot = Attacked(seed)
    lower, upper, speed, acceleration = robot.limits
    start, goal = robot.value.copy(), robot.rng.uniform(lower, upper)
    way = np.abs(goal - start)
    ramp = np.minimum(speed, np.sqrt(acceleration * way))
    least = np.where(way > 0.0, way / ramp + ramp / acceleration, 0.0)  # of continuous time
    ticks = np.ceil(least / T) + 3
    arrived = np.zeros(N)
    for tick in range(1, int(min(ticks.max(), 4000)) + 1):
        robot.ask(goal)
        arrived[(robot.value == goal) & (arrived == 0)] = tick
    robot.check()
    judged = ticks <= 4000
    assert np.all(arrived[judged] > 0)
    assert np.all(arrived[judged] <= ticks[judged])
    # a joint that is there stays there
    np.testing.assert_array_equal(robot.value[judged], goal[judged])
    passed = (np.array(robot.places) - goal) * np.sign(goal - start)
    assert np.all(passed <= 0.0)


@settings(max_examples=20)
@given(seed=SEEDS)
def test_it_catches_up_with_a_motion_and_then_follows_it(seed):
    robot = Attacked(seed, PLAIN)
    motion = 0.5 * np.sin(3.0 * T * np.arange(2000))[:, None] * robot.rng.uniform(-1, 1, N)
    for step, asked in enumerate(motion):  # from somewhere else
        assert robot.ask(asked) == -1 or step < 1500
    robot.check()
    np.testing.assert_array_equal(robot.places[-1], motion[-1])


@settings(max_examples=20)
@given(seed=SEEDS)
def test_where_the_setpoint_is_no_number_it_comes_to_rest_and_stays(seed):
    robot = Attacked(seed, PLAIN)
    for step in range(50):
        robot.ask(ATTACKS["greedy"](robot, step))
    nothing = np.full(N, np.nan)
    for _ in range(4):  # v / AT, and one for what rounding left over
        robot.ask(nothing)
    robot.ask(nothing)
    np.testing.assert_array_equal(robot.velocity, 0.0)
    assert robot.places[-1].tobytes() == robot.places[-2].tobytes()
    robot.check()


def walls(far: float) -> np.ndarray:
    """Limits of joints, some of which have a wall on one side only."""
    limits = np.array([np.full(N, limit) for limit in (-far, far, 4.0, 1000.0)])
    limits[1, :3] = 2.0
    return limits


@pytest.mark.parametrize("far", [np.inf, 1.7e308, 1e200])
@pytest.mark.parametrize("name", ["noise", "greedy", "near_the_stop", "extremes"])
def test_walls_at_infinity_are_no_limits_of_a_joint_with_a_limit_of_jerk(name, far):
    robot = JerkAttacked(5, walls(far), np.full(N, 1e5), start=np.linspace(-1.0, 1.0, N))
    for step in range(1500):
        robot.ask(JERK_ATTACKS[name](robot, step))
    robot.check()


@pytest.mark.parametrize("far", [np.inf, 1.7e308, 1e200])
@pytest.mark.parametrize("name", ["noise", "greedy", "silence", "at_the_limit"])
def test_walls_at_infinity_are_none_and_speed_is_limited_all_the_same(name, far):
    robot = Attacked(5, walls(far), start=np.linspace(-1.0, 1.0, N))
    for step in range(3000):
        robot.ask(ATTACKS[name](robot, step))
    robot.check()
    assert np.abs(robot.velocities).max() == pytest.approx(4.0)
