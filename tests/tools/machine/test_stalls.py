"""Stalls of the host: noted, merged, and held against the times of ticks."""

from __future__ import annotations

import os
import signal
from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st

from hoap3.protocol.runtime.clock import VirtualClock
from hoap3.tools.machine.stalls import (
    CAPACITY,
    GRID_NS,
    THRESHOLD_NS,
    Stall,
    StallLog,
    StallMonitor,
    main,
    overlapping,
    watch,
)


def disjoint(gaps):
    """Stalls that do not overlap, from pairs of a pause and a length."""
    stalls, at = [], 0
    for pause, length in gaps:
        start = at + pause
        at = start + length
        stalls.append(Stall(start, at))
    return stalls


@given(
    st.lists(st.tuples(st.integers(1, 3 * GRID_NS), st.integers(1, GRID_NS)), max_size=8),
    st.integers(0, 20 * GRID_NS),
    st.integers(1, 3 * GRID_NS),
)
def test_overlap_equals_a_search_through_all_from_when_the_cpu_was_last_seen(gaps, start, length):
    stalls, end = disjoint(gaps), start + length
    expected = any(s.start - GRID_NS < end and s.end > start for s in stalls)
    assert overlapping(stalls, start, end) == expected


def test_a_log_is_shared_and_each_stall_is_taken_once():
    log = StallLog()
    other = StallLog(log.fd)
    assert not other.runs
    log.begin()
    log.note(1, 2)
    log.note(5, 9)
    assert other.runs
    assert other.take() == [Stall(1, 2), Stall(5, 9)]
    assert other.take() == []
    log.note(20, 21)
    assert other.take() == [Stall(20, 21)]


def test_all_memory_of_a_log_is_there_from_the_start():
    log = StallLog()
    file = os.fstat(log.fd).st_ino
    maps = Path("/proc/self/smaps").read_text(encoding="utf-8")
    _, _, ours = maps.partition(f" {file} ")
    pairs = (line.split(":", 1) for line in ours.splitlines()[1:8])
    facts = {key: value.split() for key, value in pairs}
    assert facts["Rss"] == facts["Size"]


def test_of_more_stalls_than_there_is_room_for_the_newest_are_kept():
    log = StallLog()
    for at in range(CAPACITY + 5):
        log.note(10 * at, 10 * at + 1)
    found = log.take()
    assert len(found) == CAPACITY
    assert found[0] == Stall(50, 51)
    assert found[-1] == Stall(10 * (CAPACITY + 4), 10 * (CAPACITY + 4) + 1)


def test_without_rights_there_is_no_monitor(monkeypatch):
    def refuse(*_):
        raise PermissionError

    log = StallLog()
    order = {"fd": log.fd, "cpu": 0, "awake": True}
    monkeypatch.setattr("hoap3.tools.machine.stalls.read_order", lambda: order)
    monkeypatch.setattr(signal, "signal", lambda *_: None)
    monkeypatch.setattr(os, "sched_setaffinity", lambda *_: None)
    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    assert main() == 3
    assert not log.runs


def test_a_cpu_that_cannot_be_watched_is_told():
    monitor = StallMonitor([1023])  # no such CPU
    try:
        monitor._processes[1023].wait()
        assert monitor.refused() == [1023]
        assert not monitor.logs[1023].runs
    finally:
        monitor.stop()


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
    assert log.take() == [
        Stall(3 * GRID_NS, 3 * GRID_NS + THRESHOLD_NS + 1),
        Stall(5 * GRID_NS, 8 * GRID_NS + 200_000),
    ]
