"""Clocks, and the schedule that loops keep."""

from __future__ import annotations

import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hoap3.protocol.runtime.clock import MonotonicClock, VirtualClock
from hoap3.protocol.runtime.realtime import Ticker

PERIOD = 1_000_000
START = 5_000_000_000


class Oversleeper(VirtualClock):
    """A clock whose sleeps end late, by what `lateness` gives next."""

    def __init__(self, lateness: list[int]) -> None:
        super().__init__()
        self._lateness = iter(lateness)
        self.slept: list[int] = []

    def sleep_until(self, deadline: int) -> None:
        self.slept.append(deadline)
        super().sleep_until(deadline)
        self.advance(next(self._lateness, 0))


def waited(ticker: Ticker) -> tuple[int, int, int, int]:
    ticker.wait()
    return ticker.tick, ticker.intended - START, ticker.actual - START, ticker.skipped


def test_a_virtual_clock_moves_only_when_somebody_sleeps_and_never_back():
    clock = VirtualClock(10)
    assert (clock.now(), clock.now()) == (10, 10)
    clock.sleep_until(30)
    assert clock.now() == 30
    clock.sleep_until(20)
    assert clock.now() == 30
    clock.advance(5)
    assert clock.now() == 35


def test_the_monotonic_clock_is_the_machines_and_sleeps_until_a_time():
    clock = MonotonicClock()
    before = time.monotonic_ns()
    now = clock.now()
    deadline = now + 2_000_000
    clock.sleep_until(deadline)
    assert before <= now
    assert clock.now() >= deadline - 1000  # the deadline passes through a float of seconds


def test_the_monotonic_clock_does_not_sleep_where_the_time_has_passed(monkeypatch):
    def never(seconds: float) -> None:
        raise AssertionError(seconds)

    monkeypatch.setattr(time, "sleep", never)
    clock = MonotonicClock()
    clock.sleep_until(clock.now())
    clock.sleep_until(0)


@pytest.mark.parametrize(
    ("late", "expected"),
    [
        (0, (3, 3, 0)),
        (1, (3, 3, 0)),
        (PERIOD - 1, (3, 3, 0)),
        (PERIOD, (4, 4, 1)),  # exactly at the next tick: that one can still be kept
        (PERIOD + 1, (4, 4, 1)),
        (2 * PERIOD - 1, (4, 4, 1)),
        (2 * PERIOD, (5, 5, 2)),
        (7 * PERIOD + 123, (10, 10, 7)),
    ],
)
def test_a_late_wake_up_skips_whole_periods_and_keeps_the_phase(late, expected):
    ticker = Ticker(Oversleeper([0, 0, 0, late]), PERIOD, START)
    for k in range(3):
        assert waited(ticker) == (k, k * PERIOD, k * PERIOD, 0)
    tick, intended, skipped = expected
    assert waited(ticker) == (tick, intended * PERIOD, 3 * PERIOD + late, skipped)
    after = tick + 1
    assert waited(ticker) == (after, after * PERIOD, after * PERIOD, 0)


def test_a_start_in_the_past_is_not_made_up_for():
    clock = VirtualClock(START + 10 * PERIOD + 5)
    ticker = Ticker(clock, PERIOD, START)
    assert waited(ticker) == (10, 10 * PERIOD, 10 * PERIOD + 5, 10)


LATENESS = st.one_of(
    st.just(0),
    st.integers(0, PERIOD - 1),
    st.integers(0, 5).map(PERIOD.__mul__),
    st.integers(0, 10**8),
)


@given(lateness=st.lists(LATENESS, min_size=1, max_size=50), work=st.lists(LATENESS, max_size=50))
def test_never_a_burst_however_the_clock_oversleeps(lateness, work):
    clock = Oversleeper(lateness)
    ticker = Ticker(clock, PERIOD, START)
    previous, skipped = -1, 0
    for k in range(len(lateness)):
        ticker.wait()
        skipped += ticker.skipped
        assert ticker.tick == previous + 1 + ticker.skipped
        assert ticker.intended == START + ticker.tick * PERIOD  # the phase is kept
        assert ticker.intended <= ticker.actual < ticker.intended + PERIOD
        assert ticker.tick == k + skipped  # each period was a tick or was skipped
        previous = ticker.tick
        clock.advance(work[k] if k < len(work) else 0)
    assert clock.slept == sorted(set(clock.slept))  # one wake-up for each period at most
