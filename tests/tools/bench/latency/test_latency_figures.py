"""Figures of ticks: against numpy, and against those that the robot counts as it runs."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.tick_story import MS, START, US, Story

from hoap3.protocol.runtime.deadlines import Deadlines, Durations, Jitter
from hoap3.tools.analysis.cycles import NEVER
from hoap3.tools.analysis.numbers import summary
from hoap3.tools.analysis.tick_metrics import (
    jitter,
    longest_run,
    percentiles,
    response,
    tick_figures,
    worst_window,
)
from hoap3.tools.analysis.ticks import IN_TIME, LATE, LOST, STAGES, TickTable
from hoap3.tools.machine.stalls import OutsideStalls, StallLog
from hoap3.tools.services.run_statistics import RunStatistics

durations = st.lists(st.integers(1, 20_000_000_000), min_size=1, max_size=100)
FIGURES = {"n", "min", "p50", "p90", "p99", "p99_9", "max"}


@pytest.fixture
def table(tmp_path):
    def read(story):
        folder = tmp_path / f"{len(list(tmp_path.iterdir()))}"
        folder.mkdir()
        return TickTable.from_run(story.write(folder))

    return read


@given(durations)
def test_percentiles_are_values_that_were_measured(values):
    found = percentiles(np.array([math.nan, *values, math.nan]), np.arange(len(values) + 2))
    ordered = sorted(values)
    for name, share in (("p50", 50), ("p90", 90), ("p99", 99), ("p99_9", 99.9)):
        rank = max(1, math.ceil(share / 100 * len(values) - 1e-9))
        assert found[name] == ordered[rank - 1] / 1e3
    assert (found["n"], found["min"], found["max"]) == (
        len(values),
        ordered[0] / 1e3,
        ordered[-1] / 1e3,
    )
    assert "p99_99" not in found
    assert [each["us"] for each in found["worst"]] == [v / 1e3 for v in ordered[::-1][:10]]
    assert all(values[each["tick"] - 1] / 1e3 == each["us"] for each in found["worst"])


@given(durations)
@settings(max_examples=30)
def test_percentiles_agree_with_the_histograms_of_a_run_overflows_included(values):
    histogram = Durations(highest=10_000_000_000)
    for value in values:
        histogram.add(value)
    theirs, ours = histogram.summary(), percentiles(np.array(values, float))
    assert theirs["max"] == ours["max"]
    for name in ("p50", "p90", "p99", "p99_9"):
        if ours[name] < 10_000_000:  # longer ones overflow there
            assert theirs[name] == pytest.approx(ours[name], rel=0.002)


@pytest.mark.parametrize("n", [10, 999, 1000, 1001, 2000, 9970, 10_000])
def test_a_percentile_is_the_value_of_the_nearest_rank(n):
    """Rank 999 of 1000 at 99.9 %, though 99.9 / 100 is a little more than that as a double."""
    values = np.random.default_rng(n).permutation(np.arange(1.0, n + 1.0)) * 1e3
    found = percentiles(values)
    for name, tenths in (("p50", 500), ("p90", 900), ("p99", 990), ("p99_9", 999)):
        assert found[name] == -(-n * tenths // 1000)
        assert summary(values / 1e3)[name] == found[name]


def test_the_far_tail_needs_a_hundred_thousand():
    values = np.random.default_rng(0).exponential(1e5, 100_000)
    assert percentiles(values)["p99_99"] == np.sort(values)[99_989] / 1e3
    assert "p99_99" not in percentiles(values[1:])
    assert percentiles(np.array([math.nan])) == {"n": 0}


@given(
    st.lists(st.one_of(st.none(), st.integers(0, 5 * MS)), min_size=1, max_size=60),
)
def test_response_is_the_wait_for_an_answer_to_this_tick_or_a_later_one(delays):
    intended = MS * np.arange(len(delays))
    arrival = np.array(
        [NEVER if d is None else at + d for at, d in zip(intended, delays, strict=True)], np.int64
    )
    end = MS * len(delays) + 6 * MS
    found = response(intended, arrival, end)
    for place, start in enumerate(intended):
        later = [stamp for stamp in arrival[place:] if stamp != NEVER]
        if later:
            assert found[place] == min(later) - start
        else:
            assert found[place] == end - start


def test_a_robot_that_sleeps_hides_nothing_from_the_response(table):
    asleep = set(range(500, 550))
    figures = tick_figures([table(Story(1000, skipped=asleep))])
    awake = tick_figures([table(Story(1000))])
    assert figures["rtt_us"]["p99"] == pytest.approx(awake["rtt_us"]["p99"], rel=0.01)
    assert figures["response_us"]["p99"] > 40_000 > 200 * awake["response_us"]["p99"] / 2
    assert figures["response_us"]["n"] == 1000
    assert figures["skipped"] == 50


def test_a_controller_that_dies_hides_nothing_from_the_response_either(table):
    figures = tick_figures([table(Story(500, vanished=set(range(480, 500))))])
    assert figures["response_us"]["n"] == 500
    assert figures["response_us"]["max"] == pytest.approx(20_000)  # to the last deadline, at least


@given(st.lists(st.booleans(), min_size=2, max_size=300), st.integers(0, 100))
@settings(max_examples=15)
def test_runs_and_windows_are_those_that_the_robot_counts(tmp_path_factory, hits, seed):
    story = Story(len(hits), seed, vanished={at for at, hit in enumerate(hits) if not hit})
    table = TickTable.from_run(story.write(tmp_path_factory.mktemp("run")))
    robot = Deadlines()
    for hit in hits:
        robot.hit() if hit else robot.miss(arrived=False)
    figures = tick_figures([table])
    assert longest_run(table) == figures["misses"]["longest_run"] == robot.longest_run
    assert worst_window(table) == figures["success_rate"]["worst_window"] == robot.worst_window
    assert figures["success_rate"]["run"] == pytest.approx(robot.run_rate)
    assert figures["ticks"] == robot.asked


def test_skipped_ticks_neither_add_to_a_run_of_misses_nor_end_it(table):
    found = table(Story(50, vanished={10, 13}, skipped={11, 12}))
    assert longest_run(found) == 2


def test_jitter_is_that_of_a_run(table):
    story = Story(400, skipped={100, 250, 251})
    story.lengths["wakeup"] = 40 + np.random.default_rng(1).exponential(60, 400)
    found, theirs = table(story), Jitter(MS)
    last = -1
    for tick, actual in zip(found.tick.tolist(), found.actual.tolist(), strict=True):
        if actual != NEVER:
            if tick != last + 1:
                theirs.skip()
            theirs.start(actual)
            last = tick
    ours, theirs = jitter([found]), theirs.summary()
    assert ours["n"] == theirs["n"]
    for name in ("std", "p99_9_minus_p50", "max"):
        assert ours[name] == pytest.approx(theirs[name], rel=3e-3), name


def test_counts_and_times_are_those_of_the_summary_of_a_run(tmp_path):
    story = Story(600, vanished={50}).slow("solve", [100, 300], 1400.0)
    robot, _ = story.records()
    statistics = RunStatistics(MS)
    for record in robot:
        statistics.add(record)
    run, ours = statistics.figures(), tick_figures([TickTable.from_run(story.write(tmp_path))])
    for name in ("p50", "p90", "max", "n"):
        assert ours["rtt_us"][name] == pytest.approx(run["rtt_us"][name], rel=2e-3)
        assert ours["wakeup_us"][name] == pytest.approx(run["wakeup_us"][name], rel=2e-3)
    for stage in ("decode", "kinematics", "solve", "encode"):
        for name in ("p50", "max"):
            assert ours["stages_us"][stage][name] == pytest.approx(
                run["stages_us"][stage][name], rel=2e-3
            )
    assert ours["misses"]["late"] == 2
    assert ours["misses"]["lost"] == 1


@given(seed=st.integers(0, 10_000))
@settings(max_examples=15)
def test_misses_outside_stalls_are_those_of_the_summary_of_a_run(tmp_path_factory, seed):
    rng = np.random.default_rng(seed)
    lengths = rng.integers(100 * US, 3 * MS, 12)
    starts = np.cumsum(lengths + rng.integers(0, 10 * MS, 12)) - lengths
    story = Story(100, stalls=list(zip(starts.tolist(), lengths.tolist(), strict=True)))
    fates = rng.choice(3, 100, p=[0.7, 0.2, 0.1])
    fates[[0, -1]] = 0
    story.vanished = set(np.flatnonzero(fates == 1).tolist())
    story.skipped = set(np.flatnonzero(fates == 2).tolist())
    watched = StallLog()
    watched.begin()
    for start, length in story.stalls:
        watched.note(START + start, START + start + length)
    outside = OutsideStalls({0: watched})
    statistics = RunStatistics(MS, outside)
    for record in story.records()[0]:
        statistics.add(record)
    outside.take()
    run = statistics.figures()
    ours = tick_figures([TickTable.from_run(story.write(tmp_path_factory.mktemp("run")))])
    assert ours["misses_outside_stalls"] == run["misses_outside_stalls"]
    assert ours["host_stalls"] == pytest.approx(run["host_stalls"])
    assert ours["skipped"] == run["skipped"]
    assert ours["misses"]["lost"] == run["misses"]["lost"]


def test_the_figures_have_the_promised_keys(table):
    figures = tick_figures([table(Story(200, stalls=[(50 * MS, MS)]))])
    assert figures.keys() >= {
        "verdicts", "ticks", "skipped", "misses", "misses_outside_stalls", "host_stalls",
        "success_rate", "rtt_us", "wakeup_us", "stages_us",
    }  # fmt: skip
    assert figures["misses"].keys() == {
        "late", "lost", "rejected", "duplicate", "out_of_order", "longest_run",
    }  # fmt: skip
    assert figures["host_stalls"].keys() == {"n", "total_ms", "longest_ms", "long", "in_step"}
    assert figures["success_rate"].keys() == {"run", "outside_stalls", "worst_window"}
    assert figures["stages_us"].keys() == {*STAGES, "unaccounted"}
    for histogram in (figures["rtt_us"], figures["wakeup_us"], *figures["stages_us"].values()):
        assert histogram.keys() >= FIGURES


def test_several_runs_are_counted_as_one(table):
    one = Story(300, vanished={10}, stalls=[(20 * MS, 3 * MS)])
    two = Story(500, 1, stalls=[]).slow("encode", [100], 1500.0)
    tables = [table(one), table(two)]
    figures = tick_figures(tables)
    assert figures["ticks"] == 800
    assert figures["misses"]["lost"] == 1
    assert figures["host_stalls"]["n"] == 1
    assert figures["misses_outside_stalls"] == sum(t.count(LATE) + t.count(LOST) for t in tables)
    in_time = sum(t.count(IN_TIME) for t in tables)
    assert figures["success_rate"]["outside_stalls"] == in_time / (
        in_time + figures["misses_outside_stalls"]
    )
    assert figures["worst"][0] == {"block": 1, **tables[1].worst(1)[0]}
    assert [w["rtt_us"] for w in figures["worst"]] == sorted(
        (w["rtt_us"] for w in figures["worst"]), reverse=True
    )
    unwatched = tick_figures([*tables, table(Story(100))])
    assert unwatched["misses_outside_stalls"] is None
    assert unwatched["host_stalls"] is None
    assert unwatched["success_rate"]["outside_stalls"] is None


def test_the_guilty_stage_is_never_the_host(table):
    story = Story(400, stalls=[(100 * MS, 5 * MS)], vanished={100, 101, 102})
    figures = tick_figures([table(story)])
    assert figures["guilty"] == {"host": 3}
    assert figures["guilty_stage"] is None
    figures = tick_figures([table(story.slow("decode", [300], 900.0))])
    assert figures["guilty_stage"] == "decode"


@pytest.mark.parametrize(("lost", "verdict"), [(19, "warn"), (20, "fail")])
def test_what_would_have_stopped_the_robot_is_unfit(table, lost, verdict):
    story = Story(2000, vanished=set(range(100, 100 + lost)))
    figures = tick_figures([table(story)])
    assert figures["misses"]["longest_run"] == lost
    assert figures["verdicts"]["deadlines"] == verdict
    assert tick_figures([table(story)], 21)["verdicts"]["deadlines"] == "warn"  # where it goes on


@pytest.mark.parametrize("stalled", [False, True])
def test_a_window_in_which_all_was_missed_fails_whoever_caused_it(table, stalled):
    stalls = [((100 + k) * MS, MS // 2) for k in range(111)] if stalled else []
    figures = tick_figures([table(Story(3000, vanished=set(range(100, 211)), stalls=stalls))], 1000)
    assert figures["success_rate"]["run"] == pytest.approx(1.0 - 111 / 3000)
    assert figures["success_rate"]["worst_window"] == 0.0
    assert figures["verdicts"]["deadlines"] == "fail"
    assert figures["deadlines"]["reasons"] == ["worst_window"]
    assert ("111 of 111" in figures["deadlines"]["cause"]) == stalled
    if stalled:
        assert figures["success_rate"]["outside_stalls"] == 1.0  # shown, and no excuse


def test_after_the_warm_up_nothing_of_it_is_left(table):
    story = Story(400, vanished={5}, stalls=[(10 * MS, MS), (300 * MS, MS)], skipped={20})
    whole, warm = table(story), table(story).after(200)
    assert warm.tick.tolist() == list(range(200, 400))
    assert warm.count(LATE) == warm.count(LOST) == 0
    assert len(warm.stalls) == 1
    assert np.array_equal(warm.stage("rtt"), whole.stage("rtt")[200:], equal_nan=True)
    assert warm.intended[0] == START + 200 * MS
    assert (warm.outcome == IN_TIME).all()
    assert warm.stage("wakeup").max() < 50 * US
