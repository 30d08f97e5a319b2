"""Misses and skipped ticks, held against the stalls of the host."""

from __future__ import annotations

import pytest
from support.log_samples import describe

from hoap3.protocol.messages import State
from hoap3.protocol.runtime.shm_ring import Kind, Record
from hoap3.tools.analysis.verdicts import judge_run
from hoap3.tools.machine.stalls import FOREVER, GRID_NS, PATIENCE_NS, OutsideStalls, StallLog
from hoap3.tools.services.run_statistics import RunStatistics

T = 1_000_000
START = 50 * T


def watching(*stalls, runs=True, seen=FOREVER):
    log = StallLog()
    if runs:
        log.begin()
        log.see(seen)
    for start, end in stalls:
        log.note(start, end)
    return OutsideStalls({1: log})


def test_a_failure_is_the_hosts_if_it_overlaps_a_stall_and_ours_if_not():
    stalls = watching((10 * T, 11 * T))
    stalls.take()
    stalls.failed(9 * T, 10 * T + 1, 1)
    stalls.failed(11 * T, 12 * T, 2)
    stalls.failed(10 * T - GRID_NS - T, 10 * T - GRID_NS, 4)
    stalls.failed(10 * T - GRID_NS - T, 10 * T - GRID_NS + 1, 8)
    stalls.attribute(20 * T + PATIENCE_NS)
    assert (stalls.hosts, stalls.outside) == (9, 6)
    assert stalls.figures() == {"n": 1, "total_ms": 1.0, "longest_ms": 1.0, "long": 1, "in_step": 0}


def test_nothing_is_judged_before_the_monitor_had_time_to_tell():
    stalls = watching()
    stalls.failed(0, T, 1)
    stalls.attribute(T + PATIENCE_NS - 1)
    assert (stalls.hosts, stalls.outside) == (0, 0)
    stalls.attribute(T + PATIENCE_NS)
    assert (stalls.hosts, stalls.outside) == (0, 1)


def test_a_cpu_that_is_away_is_waited_for_however_long():
    stalls = watching(seen=T)
    for tick in range(1, 3001):
        stalls.failed(tick * T, (tick + 1) * T, 1)
    stalls.attribute(10_000 * T)
    assert (stalls.hosts, stalls.outside) == (0, 0)
    stalls._logs[1].note(T, 3001 * T)  # it is back, and tells
    stalls._logs[1].see(10_000 * T)
    stalls.take()
    stalls.attribute(10_000 * T)
    assert (stalls.hosts, stalls.outside) == (3000, 0)


def test_stalls_are_forgotten_only_when_they_are_old():
    stalls = watching((T, 2 * T))
    stalls.take()
    for minute in range(1, 4):
        stalls.attribute(minute * 60_000 * T)
    stalls.failed(T, 2 * T, 1)
    stalls.attribute(FOREVER)
    assert (stalls.hosts, stalls.outside) == (0, 1)


def test_it_is_known_only_where_every_cpu_is_watched():
    assert watching().known
    assert not watching(runs=False).known
    assert not OutsideStalls({}).known


class Robot:
    """States of a robot whose ticks fail as the test says."""

    def __init__(self, stalls):
        self.statistics = RunStatistics(T, stalls)
        self.state = State(1)
        self.state.mode = State.ACTIVE

    def tick(self, tick, *, late=0, lost=0, skipped=0, wake=40_000, mode=State.ACTIVE):
        state = self.state
        state.tick, state.stamp_intended = tick, START + tick * T
        state.stamp_actual, state.mode = START + tick * T + wake, mode
        state.late, state.lost = state.late + late, state.lost + lost
        state.skipped += skipped
        self.statistics.add(Record(Kind.STATE, state.stamp_actual, state.dump()))

    def summary(self, in_time):
        count = b'{"asked": 1, "in_time": %d}' % in_time
        self.statistics.add(Record(Kind.SUMMARY, 0, count))
        summary = self.statistics.figures()
        rate = summary["success_rate"]["outside_stalls"]
        return summary["misses_outside_stalls"], rate


def verdict(statistics: RunStatistics) -> str:
    """On the deadlines of a robot alone."""
    figures = statistics.figures()
    return judge_run(figures, statistics.counts, None)["verdicts"]["deadlines"]


@pytest.mark.parametrize(("rule", "delay"), [("next_tick", 2), ("after_receipt", 1)])
def test_with_a_delay_a_miss_belongs_to_the_time_until_it_was_judged(rule, delay):
    stalls = watching((START + 5 * T + 200_000, START + 5 * T + 300_000))
    stalls.take()
    robot = Robot(stalls)
    told = describe(1).model_copy(update={"deadline": rule, "delay_ticks": delay})
    robot.statistics.add(Record(Kind.DESCRIPTION, 0, told.to_json()))
    for tick in range(8):
        robot.tick(tick)
    robot.tick(8, lost=1, mode=State.STOPPING)  # tick 5: from 5 to 8 ms, in the stall
    robot.tick(9, lost=1, mode=State.STOPPING)  # tick 6: from 6 to 9 ms, ours
    assert robot.summary(in_time=2) == (1, pytest.approx(2 / 3))
    found = robot.statistics.figures()
    assert (found["deadline"], found["delay_ticks"]) == (rule, delay)


def test_a_miss_belongs_to_the_time_of_the_tick_that_asked():
    stalls = watching((START + 2 * T + 600_000, START + 2 * T + 900_000))
    stalls.take()
    robot = Robot(stalls)
    robot.tick(0)
    robot.tick(1)
    robot.tick(2, late=1)  # tick 1: from 1 to 2 ms, ours
    robot.tick(3, lost=1)  # tick 2: from 2 to 3 ms, in the stall
    robot.tick(4)
    assert robot.summary(in_time=2) == (1, pytest.approx(2 / 3))


def test_skipped_ticks_count_as_misses_unless_a_stall_covers_them():
    stalls = watching((START + 7 * T, START + 9 * T))
    stalls.take()
    robot = Robot(stalls)
    robot.tick(0)
    robot.tick(4, skipped=3)  # ours
    robot.tick(5)
    robot.tick(9, skipped=3)  # the host's
    robot.tick(10)
    assert robot.summary(in_time=3) == (3, 0.5)


def test_a_short_stall_does_not_excuse_a_long_sleep():
    stalls = watching((START + 2000 * T + 600_000, START + 2000 * T + 800_000))
    stalls.take()
    robot = Robot(stalls)
    robot.tick(0)
    robot.tick(5001, skipped=5000)
    assert robot.summary(in_time=1)[0] == 4999


def test_skipped_ticks_count_in_the_verdict():
    robot = Robot(watching())
    robot.tick(0)
    robot.tick(20, skipped=19)
    count = b'{"asked": 100, "in_time": 100, "run_rate": 1.0}'
    robot.statistics.add(Record(Kind.SUMMARY, 0, count))
    summary = robot.statistics.figures()
    assert summary["success_rate"]["run"] == 1.0
    assert verdict(robot.statistics) == "fail"  # 100 of 119


@pytest.mark.parametrize(("safe_stops", "expected"), [(0, "not judged"), (1, "fail")])
def test_where_nothing_was_asked_there_is_nothing_to_judge(safe_stops, expected):
    robot = Robot(watching())
    robot.tick(0, mode=State.IDLE)
    count = b'{"asked": 0, "in_time": 0, "safe_stops": %d}' % safe_stops
    robot.statistics.add(Record(Kind.SUMMARY, 0, count))
    assert verdict(robot.statistics) == expected


def test_a_robot_that_never_told_its_count_is_unfit():
    assert verdict(RunStatistics(T, watching())) == "fail"


def test_only_stalls_of_the_motion_are_counted():
    stalls = watching(
        (START - 3 * T, START - 2 * T),
        (START - T, START + 1),  # into the motion
        (START + 2 * T, START + 3 * T),
        (START + 3 * T - 1, START + 5 * T),  # out of it
        (START + 3 * T, START + 5 * T),
    )
    robot = Robot(stalls)
    for tick in (0, 1, 2):
        robot.tick(tick)
    robot.tick(3, mode=State.STOPPED)
    robot.tick(4, mode=State.STOPPED)
    stalls.take()
    assert stalls.n == 3
    robot.tick(5)  # it was recovered, and moves again
    stalls._logs[1].note(START + 5 * T, START + 6 * T)
    stalls.take()
    assert stalls.n == 4


def test_what_is_skipped_while_nothing_is_asked_is_no_miss():
    robot = Robot(watching())
    robot.tick(0, mode=State.IDLE)
    robot.tick(5, skipped=4, mode=State.IDLE)
    robot.tick(6)
    robot.tick(7)
    robot.tick(8, mode=State.IDLE)
    robot.tick(5000, skipped=4991, mode=State.IDLE)  # a night
    assert robot.summary(in_time=1) == (0, 1.0)
    assert robot.statistics.figures()["skipped"] == 0
    assert verdict(robot.statistics) != "fail"


def test_without_a_monitor_nothing_is_said():
    robot = Robot(watching(runs=False))
    robot.tick(0)
    robot.tick(1, late=1)
    assert robot.summary(in_time=0) == (None, None)
