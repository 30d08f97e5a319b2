"""Stalls of the host: noted, merged, and held against the times of ticks."""

from __future__ import annotations

import io
import itertools
import json
import os
import signal
import sys

import pytest
from hypothesis import given
from hypothesis import strategies as st

from protocol.clock import VirtualClock
from tools.stalls import (
    CAPACITY,
    GRID_NS,
    THRESHOLD_NS,
    Stall,
    StallLog,
    figures,
    main,
    merged,
    overlapping,
    watch,
)

times = st.integers(0, 200)


def stall_logs(groups):
    logs = []
    for group in groups:
        log = StallLog()
        for start, length in group:
            log.note(start, start + length)
        logs.append(log)
    return logs


@given(st.lists(st.lists(st.tuples(times, st.integers(1, 20)), max_size=8), max_size=3))
def test_merging_keeps_exactly_the_covered_time(groups):
    whole = merged(stall_logs(groups))
    covered = {
        t for group in groups for start, length in group for t in range(start, start + length)
    }
    assert {t for stall in whole for t in range(stall.start, stall.end)} == covered
    assert all(one.end < other.start for one, other in itertools.pairwise(whole))
    assert figures(whole)["total_ms"] == pytest.approx(len(covered) / 1e6)


@given(st.lists(st.tuples(times, st.integers(1, 20)), max_size=8), times, st.integers(1, 30))
def test_overlap_equals_a_search_through_all(group, start, length):
    whole = merged(stall_logs([group]))
    end = start + length
    expected = any(stall.start < end and stall.end > start for stall in whole)
    assert overlapping(whole, start, end) == expected


def test_a_log_is_shared_and_its_capacity_is_not_exceeded():
    log = StallLog()
    other = StallLog(log.fd)
    assert not other.runs
    log.begin()
    for at in range(CAPACITY + 5):
        log.note(10 * at, 10 * at + 1)
    assert other.runs
    assert len(other.stalls()) == CAPACITY
    assert other.stalls()[-1] == Stall(10 * (CAPACITY - 1), 10 * (CAPACITY - 1) + 1)


def test_without_rights_there_is_no_monitor(monkeypatch):
    def refuse(*_):
        raise PermissionError

    log = StallLog()
    order = {"fd": log.fd, "cpu": 0, "parent": 0}
    monkeypatch.setattr(sys, "stdin", io.StringIO(json.dumps(order)))
    monkeypatch.setattr(signal, "signal", lambda *_: None)
    monkeypatch.setattr(os, "sched_setaffinity", lambda *_: None)
    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    assert main() == 3
    assert not log.runs


class Sleeper(VirtualClock):
    """Oversleeps by what the test says, one sleep after the other."""

    def __init__(self, late: list[int]) -> None:
        super().__init__()
        self.late = late

    def sleep_until(self, deadline: int) -> None:
        super().sleep_until(deadline)
        if self.late:
            self.advance(self.late.pop(0))


def test_what_is_slept_through_is_noted_and_the_grid_is_kept():
    log = StallLog()
    late = [0, THRESHOLD_NS, THRESHOLD_NS + 1, 0, 3 * GRID_NS + 200_000, 0, 10]
    rounds = iter([True, False])
    watch(log, lambda: next(rounds), Sleeper(late))
    assert log.stalls() == [
        Stall(3 * GRID_NS, 3 * GRID_NS + THRESHOLD_NS + 1),
        Stall(5 * GRID_NS, 8 * GRID_NS + 200_000),
    ]
