"""Whatever stream of setpoints arrives, the reference keeps all limits, at and between ticks."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robot_emulator.filter_kernels import filter_setpoint

N, T = 7, 1e-3
SEEDS = st.integers(0, 2**32 - 1)


class Bench:
    """A reference under random limits, whose every step is checked."""

    def __init__(self, seed: int) -> None:
        self.rng = rng = np.random.default_rng(seed)
        middle, half = rng.uniform(-3, 3, N), 10.0 ** rng.uniform(-2, 0.5, N)
        speed, acceleration = 10.0 ** rng.uniform(-1, 1, N), 10.0 ** rng.uniform(0, 3.5, N)
        self.limits = np.ascontiguousarray([middle - half, middle + half, speed, acceleration])
        self.value = rng.uniform(middle - half, middle + half)
        self.velocity = np.zeros(N)
        self.before = self.value.copy()
        self.visited = [self.value.copy()]

    def ask(self, setpoint) -> int:
        asked = np.ascontiguousarray(setpoint, float)
        held = filter_setpoint(asked, self.before, self.limits, T, self.value, self.velocity)
        self.before[:] = asked
        self.visited.append(self.value.copy())
        return int(held)

    def check(self) -> None:
        path = np.array(self.visited)
        lower, upper, speed, acceleration = self.limits
        assert np.all(np.isfinite(path))
        assert np.all((lower <= path) & (path <= upper))
        ulp = np.spacing(np.maximum(np.abs(lower), np.abs(upper)))
        velocity = np.diff(path, axis=0) / T
        assert np.all(np.abs(velocity) <= speed + 2 * ulp / T)
        change = np.diff(np.vstack([np.zeros(N), velocity]), axis=0) / T
        assert np.all(np.abs(change) <= acceleration + 4 * ulp / T**2)


def noise(bench, step):
    return bench.rng.normal(size=N) * 10.0 ** bench.rng.uniform(-3, 3)


def greedy(bench, step):
    """Always away from where it moves, as far as can be; at the walls it pushes on."""
    far = np.where(bench.velocity > 0.0, bench.limits[0], bench.limits[1])
    return np.where(bench.rng.random(N) < 0.02, far, bench.value + np.sign(far) * 1e300)


def silence(bench, step):
    odd = [np.nan, np.inf, -np.inf, 1e308, -1e308]
    asked = bench.rng.uniform(bench.limits[0], bench.limits[1])
    spoiled = bench.rng.random(N) < 0.5
    return np.where(spoiled, bench.rng.choice(odd, N), asked)


def jitter(bench, step):
    return bench.limits[1] + bench.rng.normal(size=N) * 1e-9


def jumps(bench, step):
    if step % 137 == 0:
        bench.goal = bench.rng.uniform(bench.limits[0], bench.limits[1])
    return bench.goal


def mixture(bench, step):
    return bench.rng.choice([noise, greedy, silence, jitter])(bench, step)


ATTACKS = {each.__name__: each for each in (noise, greedy, silence, jitter, jumps, mixture)}


def attacked(name: str, seed: int, cycles: int) -> Bench:
    bench = Bench(seed)
    for step in range(cycles):
        bench.ask(ATTACKS[name](bench, step))
    return bench


@pytest.mark.parametrize("name", ATTACKS)
@settings(max_examples=5)
@given(seed=SEEDS)
def test_no_attack_moves_it_beyond_a_limit(name, seed):
    attacked(name, seed, 2000).check()


@settings(max_examples=10)
@given(seed=SEEDS)
def test_a_motion_within_the_limits_passes_bit_by_bit(seed):
    bench = Bench(seed)
    lower, upper, speed, acceleration = bench.limits
    room = np.minimum(upper - bench.value, bench.value - lower)
    turn = 10.0 ** bench.rng.uniform(0, 1.5, N)  # rad/s
    reach = 0.4 * np.minimum(np.minimum(room, speed / turn), acceleration / turn**2)
    start = bench.value.copy()
    for step in range(1, 2000):
        asked = start + reach * (1.0 - np.cos(turn * step * T))
        assert bench.ask(asked) == -1
        np.testing.assert_array_equal(bench.value, asked)


@settings(max_examples=20)
@given(seed=SEEDS)
def test_a_jump_is_reached_without_passing_it_and_in_the_least_time(seed):
    bench = Bench(seed)
    lower, upper, speed, acceleration = bench.limits
    start, goal = bench.value.copy(), bench.rng.uniform(lower, upper)
    way = np.abs(goal - start)
    ramp = np.minimum(speed, np.sqrt(acceleration * way))
    least = way / ramp + ramp / acceleration  # of continuous time
    ticks = int(np.ceil(least.max() / T)) + 3
    if ticks > 20_000:
        return
    for _ in range(ticks):
        bench.ask(goal)
    bench.check()
    np.testing.assert_allclose(bench.value, goal, rtol=0, atol=1e-9)
    passed = (np.array(bench.visited) - goal) * np.sign(goal - start)
    assert np.all(passed <= 1e-12)


def test_the_joint_that_is_held_back_is_named():
    bench = Bench(1)
    asked = bench.value.copy()
    assert bench.ask(asked) == -1
    asked[3] = bench.limits[1, 3] + 1.0
    assert bench.ask(asked) == 3
