"""Histograms of durations and the jitter of periods, against numpy."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hoap3.protocol.runtime.deadlines import PERCENTILES, TAIL_SAMPLES, Durations, Jitter

PRECISION = 1e-3  # what the docstring promises
HIGHEST = 10_000_000_000
NANOSECONDS = st.one_of(st.integers(0, 2000), st.integers(0, 10**6), st.integers(0, HIGHEST))


def filled(values: list[int]) -> Durations:
    """Durations whose ticks are 0, 1, 2 …"""
    durations = Durations()
    for tick, value in enumerate(values):
        durations.add(value, tick)
    return durations


def assert_percentile(found_us: float, values: list[int], share: float) -> None:
    """Between the two neighbours of the rank, but for the width of a bin."""
    low = np.percentile(values, share, method="lower")
    high = np.percentile(values, share, method="higher")
    assert low * (1 - PRECISION) - 1 <= found_us * 1e3 <= high * (1 + PRECISION) + 1


@settings(max_examples=50)  # each makes a large histogram
@given(values=st.lists(NANOSECONDS, min_size=1, max_size=300))
def test_the_summary_is_what_numpy_says(values):
    summary = filled(values).summary()
    assert summary["n"] == len(values)
    assert summary["min"] == min(values) / 1e3
    assert summary["max"] == max(values) / 1e3
    for name, share in PERCENTILES.items():
        assert_percentile(summary[name], values, share)
        assert summary["min"] <= summary[name] <= summary["max"]
    worst = sorted(values, reverse=True)[:10]
    assert [entry["us"] for entry in summary["worst"]] == [value / 1e3 for value in worst]
    assert all(values[entry["tick"]] == round(entry["us"] * 1e3) for entry in summary["worst"])
    assert len({entry["tick"] for entry in summary["worst"]}) == len(worst)
    assert summary.keys().isdisjoint({"overflows", "negative", "p99_99"})


def test_percentiles_of_many_samples_are_known_to_a_thousandth():
    values = np.random.default_rng(1).lognormal(12.0, 1.5, 20_000).astype(int).tolist()
    summary = filled(values).summary()
    for name, share in PERCENTILES.items():
        expected = np.percentile(values, share) / 1e3
        assert summary[name] == pytest.approx(expected, rel=3 * PRECISION)


def test_the_last_percentile_needs_its_hundred_thousand_samples():
    durations = Durations()
    values = list(range(1000, 1000 + TAIL_SAMPLES - 1))
    for value in values:
        durations.add(value)
    assert "p99_99" not in durations.summary()
    durations.add(0)
    assert_percentile(durations.summary()["p99_99"], [*values, 0], 99.99)


def test_nothing_counted_is_said_so():
    assert Durations().summary() == {"n": 0}


def test_negative_durations_are_counted_apart_and_enter_no_figure():
    durations = filled([-1, -(10**12)])
    assert durations.summary() == {"n": 0, "negative": 2}
    durations.add(1000)
    summary = durations.summary()
    assert (summary["n"], summary["negative"], summary["min"]) == (1, 2, 1.0)


def test_overflows_are_counted_and_keep_their_true_length():
    durations = Durations(highest=1_000_000)
    for tick, value in enumerate([1_000_000, 1_000_001, 5_000_000, 10]):
        durations.add(value, tick)
    summary = durations.summary()
    assert summary["overflows"] == 2
    assert summary["max"] == 5000.0
    assert summary["worst"][0] == {"us": 5000.0, "tick": 2}
    assert summary["p99"] == pytest.approx(1000.0, rel=PRECISION)


def test_of_equal_durations_the_first_ones_are_kept():
    summary = filled([5] * 20).summary()
    assert sorted(entry["tick"] for entry in summary["worst"]) == list(range(10))


@settings(max_examples=30)
@given(
    deviations=st.lists(st.integers(-900_000, 10**8), min_size=2, max_size=100),
    start=st.integers(0, 10**12),
)
def test_jitter_is_what_numpy_says(deviations, start):
    period = 1_000_000
    jitter, stamp = Jitter(period), start
    jitter.start(stamp)
    for deviation in deviations:
        stamp += period + deviation
        jitter.start(stamp)
    summary = jitter.summary()
    sizes = np.abs(deviations)
    assert summary["n"] == len(deviations)
    assert summary["std"] * 1e3 == pytest.approx(np.std(deviations, ddof=1), rel=1e-6, abs=1e-3)
    assert summary["max"] == sizes.max() / 1e3
    low = np.percentile(sizes, 99.9, method="lower") - np.percentile(sizes, 50, method="higher")
    high = np.percentile(sizes, 99.9, method="higher") - np.percentile(sizes, 50, method="lower")
    slack = 2 * PRECISION * sizes.max() + 2
    assert low - slack <= summary["p99_9_minus_p50"] * 1e3 <= high + slack


def test_a_skipped_tick_is_no_jitter():
    jitter = Jitter(1000)
    for stamp in (0, 1000, 2000):
        jitter.start(stamp)
    jitter.skip()
    for stamp in (9000, 10_000):
        jitter.start(stamp)
    assert jitter.summary() == {"n": 3, "std": 0.0, "p99_9_minus_p50": 0.0, "max": 0.0}


def test_one_period_has_no_jitter():
    jitter = Jitter(1000)
    assert jitter.summary() == {"n": 0}
    jitter.start(0)
    jitter.start(1500)
    assert jitter.summary() == {"n": 1}


def test_a_histogram_takes_no_more_memory_however_much_it_counts():
    durations = Durations()
    spread = range(1000, 201_000, 1000)
    for duration in spread:
        durations.add(duration)
    tracemalloc.start()
    for _ in range(260):
        for duration in spread:
            durations.add(duration)
    grown, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert durations.n == 261 * len(spread)
    assert grown < 8 * len(spread)
