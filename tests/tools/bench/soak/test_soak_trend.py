"""How fast something grows, and how sure that is."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.stats import linregress, t

from hoap3.tools.bench.soak.judge import HOUR_S, block_means, trend


def correlated(rng: np.random.Generator, n: int, alike: float) -> np.ndarray:
    """Noise each of whose values is `alike` times the one before, and new noise."""
    noise = np.zeros(n)
    noise[0] = rng.normal() / math.sqrt(1.0 - alike**2)
    for place in range(1, n):
        noise[place] = alike * noise[place - 1] + rng.normal()
    return noise


@pytest.mark.parametrize("n", [3, 10, 81])
def test_of_independent_values_the_bounds_are_those_of_a_plain_regression(n):
    times = 60.0 * np.arange(n)
    values = 2.5 * times / HOUR_S + 7.0 + np.resize([1.0, -1.0], n)  # each unlike the next
    plain = linregress(times / HOUR_S, values)
    margin = t.ppf(0.95, n - 2) * plain.stderr
    found = trend(times, values)
    assert found.slope == pytest.approx(plain.slope)
    assert found.upper == pytest.approx(plain.slope + margin)
    assert found.lower == pytest.approx(plain.slope - margin)


def test_what_grows_evenly_has_its_slope_for_a_bound():
    times = np.arange(0.0, 4800.0, 60.0)
    found = trend(times, 3.0 * times / HOUR_S)
    assert found.slope == pytest.approx(3.0)
    assert found.upper == pytest.approx(3.0, abs=1e-6)


@pytest.mark.parametrize("value", [31.105024, 31.006, 235.3, 0.1])
def test_what_stays_has_no_slope_and_no_doubt(value):
    times = np.arange(0.0, 330.0, 5.1)
    still = trend(*block_means(times, np.full(len(times), value), 20.0))
    assert (still.lower, still.slope, still.upper) == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("alike", [0.0, 0.5, 0.8])
def test_the_bound_holds_nine_times_in_ten_however_alike_neighbours_are(alike):
    rng = np.random.default_rng(7)
    times = 60.0 * np.arange(80)
    held = [trend(times, correlated(rng, 80, alike)).upper >= 0.0 for _ in range(1000)]
    assert np.mean(held) > 0.88


@pytest.mark.parametrize("n", [16, 80])
@pytest.mark.parametrize("slope", [0.0, 1.0, 2.5, 4.0])
def test_the_bound_of_what_is_of_one_piece_holds_of_what_keeps_all_it_ever_took(n, slope):
    rng = np.random.default_rng(7)
    times = np.linspace(0.0, HOUR_S, n)
    walks = np.cumsum(rng.normal(size=(2000, n)), axis=1) / math.sqrt(n)
    found = [trend(times, walk + slope * times / HOUR_S) for walk in walks]
    of_one_piece = [each for each in found if each.lower == -each.upper]
    assert len(of_one_piece) > 50
    assert np.mean([each.upper >= slope for each in of_one_piece]) > 0.95


def test_what_is_of_one_piece_is_bounded_by_its_range():
    times = 60.0 * np.arange(81)
    found = trend(times, 235.0 + 0.005 * np.sin(times / 800.0))
    assert abs(found.slope) < found.upper
    assert found.upper == pytest.approx(2.0 * 0.01 / (80 * 60 / HOUR_S), rel=0.05)
    assert found.lower == -found.upper


def test_a_step_has_a_wider_bound_than_a_plain_regression_gives_it():
    times = 60.0 * np.arange(12)
    step = np.repeat([0.0, 1.0], 6)
    plain = linregress(times / HOUR_S, step)
    found = trend(times, step)
    assert found.upper - found.slope > 1.2 * t.ppf(0.95, 10) * plain.stderr


def test_of_fewer_than_three_values_nothing_is_known():
    found = trend(np.array([0.0, 60.0]), np.zeros(2))
    assert math.isnan(found.slope)
    assert found[1:] == (-math.inf, math.inf)


def test_blocks_are_of_equal_length_and_leave_out_what_is_no_number():
    times = np.arange(0.0, 26.0)
    values = times.copy()
    values[3] = np.nan
    middles, means = block_means(times, values, 5.0)
    assert means == pytest.approx([(0 + 1 + 2 + 4) / 4, 7.0, 12.0, 17.0, 22.5])
    assert middles == pytest.approx(means)
    assert len(block_means(times, np.full(26, np.nan), 5.0)[0]) == 0
    assert len(block_means(times[:1], values[:1], 5.0)[0]) == 1
