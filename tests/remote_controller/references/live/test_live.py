"""Live targets: bounded motion whatever comes, exactly on the curve where that is possible."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hoap3.protocol.errors import ConfigError
from hoap3.remote_controller.references.live.live import Live, check_names, collected
from hoap3.remote_controller.references.live.live_plan import Bounds

T = 1e-3
BOUNDS = Bounds(0.25, 1.0, 20.0)
NO_RATES = np.zeros((0, 3))
HOME = np.array([0.3, -0.1, 0.5])


def live(**more) -> Live:
    """One that began at `HOME` at time 0."""
    made = Live("hand", "m", BOUNDS, np.full(3, -2.0), np.full(3, 2.0), **more)
    made.start(HOME, 0.0)
    return made


def eight(time_s: np.ndarray | float) -> np.ndarray:
    """A figure of eight through `HOME`, 0.2 m wide, a round in 8 s."""
    w = 2.0 * np.pi / 8.0
    t = np.asarray(time_s, float)
    return HOME + np.stack([0.1 * np.sin(w * t), 0.05 * np.sin(2.0 * w * t), 0.0 * t], -1)


def motion(target: Live, ticks: range) -> np.ndarray:
    """Its positions, (ticks, 3)."""
    place, speed = np.zeros((2, 3))
    found = np.zeros((len(ticks), 3))
    for row, tick in enumerate(ticks):
        target.at(tick * T, place, speed)
        found[row] = place
    return found


def worst(path: np.ndarray) -> np.ndarray:
    """Greatest speed, acceleration and jerk of any axis, from differences, over their bounds."""
    most = BOUNDS.speed, BOUNDS.acceleration, BOUNDS.jerk
    differences = (np.diff(path, k + 1, axis=0) / T ** (k + 1) for k in range(3))
    return np.array([np.abs(d).max() / b for d, b in zip(differences, most, strict=True)])


def chunk(first: int, step: int, count: int) -> tuple:
    """Arguments of `take` but now: points of the figure of eight."""
    return first * T, step * T, eight((first + step * np.arange(count)) * T), NO_RATES


@settings(max_examples=25)
@given(seed=st.integers(0, 2**32 - 1))
def test_speed_acceleration_and_jerk_are_kept_whatever_comes(seed):
    rng, target = np.random.default_rng(seed), live()
    path, place, speed = [], *np.zeros((2, 3))
    for tick in range(1500):
        if rng.random() < 0.02:
            first = tick + int(rng.integers(-300, 500))
            count, step = int(rng.integers(1, 10)), int(rng.integers(1, 100))
            points = HOME + np.cumsum(rng.normal(scale=0.003, size=(count, 3)), axis=0)
            rates = rng.normal(scale=0.05, size=(count, 3))[: count * int(rng.integers(2))]
            target.take(first * T, step * T, points, rates.reshape(-1, 3), (tick + 1) * T)
        target.at(tick * T, place, speed)
        path.append(place.copy())
    assert (worst(np.array(path)) <= 1.0 + 1e-5).all()


def test_the_velocity_is_the_derivative_of_the_position():
    target = live()
    target.take(*chunk(100, 50, 20), 0.001)
    before, after, speed, scratch = np.zeros((4, 3))
    for tick in range(1, 2500, 7):
        target.at(tick * T, scratch, speed)
        target.at(tick * T - 1e-6, before, scratch)
        target.at(tick * T + 1e-6, after, scratch)
        np.testing.assert_allclose((after - before) / 2e-6, speed, atol=1e-4)


def test_a_point_is_reached_along_a_straight_line_and_held():
    target, aim = live(), HOME + np.array([0.3, 0.1, -0.2])
    assert target.take(0.0, T, aim[None], NO_RATES, 0.001) == 0
    path = motion(target, range(4000))
    np.testing.assert_allclose(path[-1000:], np.tile(aim, (1000, 1)), atol=1e-12)
    way = (aim - HOME) / np.linalg.norm(aim - HOME)
    assert np.abs((path - HOME) - np.outer((path - HOME) @ way, way)).max() < 1e-9


def test_late_chunks_lead_to_the_curve_without_lag():
    target, place, speed = live(), *np.zeros((2, 3))
    errors = []
    for tick in range(6000):
        if tick % 50 == 0 and tick >= 300:  # sent 300 ms ago, reaching 400 ms ahead
            assert target.take(*chunk(tick - 300, 50, 15), (tick + 1) * T) == 7
        target.at(tick * T, place, speed)
        errors.append(np.linalg.norm(place - eight(tick * T)))
    assert max(errors[2000:]) < 1e-5


def test_at_the_end_of_a_chunk_it_comes_to_rest():
    target = live()
    target.take(*chunk(0, 50, 21), 0.001)
    path = motion(target, range(3000))
    assert np.ptp(path[-500:], axis=0).max() == 0.0
    assert np.linalg.norm(path[-1] - eight(1.0)) < 0.05


def test_what_has_not_begun_is_replaced_and_what_has_goes_on_until_then():
    target = live()
    target.take(1.0, T, HOME[None] + 0.5, NO_RATES, 0.001)
    target.take(2.0, T, HOME[None] - 0.1, NO_RATES, 0.002)
    path = motion(target, range(5000))
    np.testing.assert_array_equal(path[:2000], np.tile(HOME, (2000, 1)))
    np.testing.assert_allclose(path[-1], HOME - 0.1, atol=1e-12)


def test_a_stale_target_is_held_or_left_for_home_or_stops():
    aim = HOME[None] + 0.1
    held, returning = live(stale_after_s=1.5), live(stale_after_s=1.5, when_stale="return")
    stopping = live(stale_after_s=1.5, when_stale="stop")
    for target in (held, returning, stopping):
        target.take(0.0, T, aim, NO_RATES, 0.001)
        assert target.stops_at_s == (1.501 if target is stopping else math.inf)
    np.testing.assert_allclose(motion(held, range(4000, 4001))[0], aim[0], atol=1e-12)
    path = motion(returning, range(4000))
    np.testing.assert_allclose(path[1500], aim[0], atol=1e-9)
    np.testing.assert_allclose(path[-1], HOME, atol=1e-12)
    assert (worst(path) <= 1.0 + 1e-5).all()
    stopping.start(HOME, 5.0)
    assert stopping.stops_at_s == math.inf


@pytest.mark.parametrize(
    ("given", "reason"),
    [
        ((0.0, T, HOME[None, :2], np.zeros((0, 2)), 1.0), "wrong_size"),
        ((0.0, T, np.zeros((2, 3)), np.zeros((1, 3)), 1.0), "wrong_size"),
        ((0.0, 0.0, np.zeros((2, 3)), NO_RATES, 1.0), "wrong_size"),
        ((0.0, T, HOME[None] * np.nan, NO_RATES, 1.0), "not_finite"),
        ((0.0, T, HOME[None] + 3.0, NO_RATES, 1.0), "out_of_range"),
        ((0.0, 0.05, np.tile(HOME, (20, 1)), NO_RATES, 1.0), "late"),
        ((12.0, T, HOME[None], NO_RATES, 1.0), "too_far_ahead"),
        ((1.0, 0.01, HOME + 0.01 * np.arange(3)[:, None], NO_RATES, 1.0), "too_fast"),
    ],
)
def test_what_cannot_be_followed_is_refused_and_nothing_moves(given, reason):
    target = live()
    target.take(0.0, T, HOME[None] + 0.2, NO_RATES, 0.001)
    before = motion(target, range(3000))
    assert target.take(*given) == reason
    np.testing.assert_array_equal(motion(target, range(3000)), before)


@pytest.mark.parametrize("size", [1e5, 1e6, 1e12, 1e300, 1.7e308])
@pytest.mark.parametrize("points", [[[1.0, -1.0, 0.0]], np.eye(3), np.ones((3, 3))])
def test_what_is_absurdly_far_is_refused_where_nothing_bounds_it(points, size):
    anywhere = np.full(3, np.inf)
    target = Live("hand", "m", BOUNDS, -anywhere, anywhere)
    target.start(HOME, 0.0)
    target.take(0.0, T, HOME[None] + 0.2, NO_RATES, 0.001)
    before = motion(target, range(1000))
    with np.errstate(over="ignore", invalid="ignore"):
        assert target.take(0.45, 0.05, size * np.array(points), NO_RATES, 0.5) == "too_fast"
    np.testing.assert_array_equal(motion(target, range(1000)), before)


def test_live_targets_are_found_in_their_order_and_two_of_one_name_refused():
    with collected() as found:
        first, second = live(), live()
    assert found == [first, second]
    with pytest.raises(ConfigError, match="hand"):
        check_names(found)
    check_names(found[:1])
