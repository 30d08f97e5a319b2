"""Planted faults are found, and what is sound is called so: a soak of made-up rounds."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from hoap3.protocol.errors import UsageError
from hoap3.protocol.messages import State
from hoap3.tools.bench.soak.judge import count_figures, judge
from hoap3.tools.bench.soak.watch import BOTH, HELD, ROBOT, Plan, Rounds, Watch

BEGIN_S, END_S, EVERY_S = 600.0, 5400.0, 5.0
TIMES = np.arange(BEGIN_S, END_S, EVERY_S)
PERIOD_NS = 1_000_000
CAP = 64_000_000
SUMMARY = {
    "safe_stops": 0,
    "success_rate": {"worst_window": 0.98},
    "misses": {"longest_run": 2},
    "log_lost": [],
}


def live(tick: int, /, **changes: Any) -> dict[str, Any]:
    """News of a robot's State on schedule."""
    stamp = 5_000_000_000 + tick * PERIOD_NS
    told = {"tick": tick, "session_id": 1, "mode": State.ACTIVE}
    return {**told, "stamp_intended": stamp, "stamp_actual": stamp + 20_000, **changes}


def soaked(
    *,
    leak_mb_h: float = 0.0,
    noise_mb: float = 0.1,
    descriptors: np.ndarray | None = None,
    until_s: float = END_S,
    robot: dict[str, np.ndarray] | None = None,
    seed: int = 1,
) -> Watch:
    """80 minutes of one process that holds 250 MB with noise, and of metrics without a miss."""
    rng = np.random.default_rng(seed)
    watch = Watch(Plan(END_S, BEGIN_S), {}, PERIOD_NS, lambda _: None)
    pages = np.cumsum(rng.choice([-1, 0, 0, 0, 1], len(TIMES))) % 16  # of 4 kB, and they stay
    rss = 250e6 + 1e6 * leak_mb_h * (TIMES - BEGIN_S) / 3600 + 4096 * pages
    rss += 1e6 * noise_mb * rng.normal(size=len(TIMES))
    files = np.full(len(TIMES), 22) if descriptors is None else descriptors
    process = watch.processes[7] = Rounds(HELD, "robot")
    for time, *held in zip(TIMES, rss, files, np.full(len(TIMES), 12), strict=True):
        if time < until_s:
            process.add(time, dict(zip(HELD, held, strict=True)))
    told = {name: np.zeros(len(TIMES)) for name in (*ROBOT, *BOTH)}
    told["deadlines_met_total"] = 1000.0 * TIMES
    told["wakeup_seconds_count"] = 1000.0 * TIMES
    told["wakeup_seconds_sum"] = 20e-6 * told["wakeup_seconds_count"]
    told |= robot or {}
    for side, names in (("robot", (*ROBOT, *BOTH)), ("controller", BOTH)):
        rounds = watch.sides[side] = Rounds(names)
        for place, time in enumerate(TIMES):
            rounds.add(time, {name: told[name][place] for name in names})
    watch.scrapes = 2 * len(TIMES)
    watch.receive(live(0))
    watch.receive(live(5_000_000))
    return watch


def verdicts(watch: Watch, summary: dict[str, Any] | None = SUMMARY) -> dict[str, str]:
    return judge(watch, BEGIN_S, summary, CAP)["verdicts"]


def test_what_is_sound_is_good_in_all():
    found = judge(soaked(), BEGIN_S, SUMMARY, CAP)
    assert found["verdict"] == "pass", found["verdicts"]
    assert found["deadlines"]["success_rate"] == 1.0
    assert found["deadlines"]["ticks"] == 1000 * (TIMES[-1] - TIMES[0])
    assert found["phase"]["wakeup_mean_us"] == pytest.approx(20.0)


@pytest.mark.parametrize("seed", range(5))
def test_a_leak_of_two_megabytes_an_hour_is_found_in_noise(seed):
    found = judge(soaked(leak_mb_h=2.0, seed=seed), BEGIN_S, SUMMARY, CAP)
    (process,) = found["processes"]
    assert found["verdicts"]["memory"] == found["verdict"] == "fail"
    assert process["memory"]["slope_mb_per_hour"] == pytest.approx(2.0, abs=0.2)
    below = judge(soaked(leak_mb_h=0.5, seed=seed), BEGIN_S, SUMMARY, CAP)
    assert below["verdicts"]["memory"] == "pass"


def test_growth_that_may_be_either_is_not_judged_and_the_whole_is_not_good():
    found = judge(soaked(leak_mb_h=1.0, noise_mb=10.0), BEGIN_S, SUMMARY, CAP)
    assert found["verdicts"]["memory"] == "not judged"
    assert found["verdict"] == "not judged"


def test_a_descriptor_that_is_left_open_is_found_and_one_that_is_closed_again_is_none():
    leaking = np.where(TIMES > 3000, 23, 22)
    assert verdicts(soaked(descriptors=leaking))["descriptors"] == "fail"
    passing = np.full(len(TIMES), 22)
    passing[[0, 300, -1]] = 24
    assert verdicts(soaked(descriptors=passing))["descriptors"] == "pass"
    assert count_figures(passing) == {"begin": 22, "end": 22, "min": 22, "max": 24}


def test_a_process_that_ends_early_is_found_and_a_run_that_fails():
    assert verdicts(soaked(until_s=3000.0))["processes"] == "fail"
    failed = judge(soaked(), BEGIN_S, None, CAP)
    assert failed["verdicts"]["processes"] == failed["verdict"] == "fail"
    assert failed["deadlines"]["success_rate"] == 1.0


@pytest.mark.parametrize("moved", [{"stamp_intended": 0}, {"tick": 0}])
def test_a_schedule_that_moves_is_found(moved):
    watch = soaked()
    watch.receive(live(6_000_000, **moved))
    found = judge(watch, BEGIN_S, SUMMARY, CAP)
    assert found["verdicts"]["phase"] == "fail"
    assert found["phase"]["drift_ns"] > 0


@pytest.mark.parametrize(("mode", "begins"), [(State.IDLE, False), (State.STOPPED, True)])
def test_a_soak_begins_once_the_robot_is_not_idle_any_more(mode, begins):
    watch = Watch(Plan(END_S, BEGIN_S), {}, PERIOD_NS, lambda _: None)
    watch.receive({})
    watch.receive(live(3, mode=mode))
    assert watch.began == begins


def test_one_nanosecond_of_drift_is_one():
    watch = soaked()
    late = live(6_000_000)
    watch.receive({**late, "stamp_intended": late["stamp_intended"] + 1})
    assert watch.drift_ns == 1


def test_a_robot_that_began_anew_is_found():
    watch = soaked()
    watch.receive(live(0, session_id=2, stamp_intended=9_000_000_123))
    assert watch.drift_ns == 0
    assert verdicts(watch)["phase"] == "fail"


def test_misses_of_the_measured_time_count_and_those_before_do_not():
    missed = 10_000.0 + np.where(TIMES > 3000, 400.0, 0.0)
    figures = {
        "deadlines_missed_total": missed,
        "deadlines_late_total": missed / 4,
        "misses_outside_stalls_total": missed / 2,
        "deadlines_met_total": 1000.0 * TIMES - missed,
    }
    found = judge(soaked(robot=figures), BEGIN_S, SUMMARY, CAP)["deadlines"]
    ticks = 1000 * (TIMES[-1] - TIMES[0])
    assert found["success_rate"] == pytest.approx(1.0 - 400 / ticks)
    assert (found["late"], found["lost"]) == (100, 300)
    assert found["success_rate_outside_stalls"] > found["success_rate"]


def test_a_robot_that_rests_asks_for_nothing_and_its_skipped_ticks_are_no_misses():
    figures = {
        "deadlines_met_total": 1000.0 * np.minimum(TIMES, 3000.0),
        "ticks_skipped_total": np.maximum(TIMES - 3000.0, 0.0),
    }
    stopped = {**SUMMARY, "safe_stops": 1}
    found = judge(soaked(robot=figures), BEGIN_S, stopped, CAP)
    assert found["deadlines"]["success_rate"] == 1.0
    assert found["verdicts"]["deadlines"] == "fail"
    figures["deadlines_met_total"] = np.full(len(TIMES), 600_000.0)
    silent = judge(soaked(robot=figures), BEGIN_S, SUMMARY, CAP)
    assert silent["deadlines"]["success_rate"] is None
    assert silent["verdicts"]["deadlines"] == "not judged"
    assert silent["verdict"] == "not judged"


@pytest.mark.parametrize(
    "figures",
    [
        {"log_lost": np.where(TIMES > 3000, 1.0, 0.0)},
        {"log_bytes": TIMES * 2e4},
        {"dropped_records_total": np.where(TIMES > 3000, 1.0, 0.0)},
    ],
)
def test_a_log_that_is_lost_or_has_gaps_or_outgrows_its_cap_is_found(figures):
    assert verdicts(soaked(robot=figures))["log"] == "fail"


def test_a_scrape_without_an_answer_is_found_and_the_counts_go_on():
    met = 1000.0 * TIMES
    met[300] = np.nan
    watch = soaked(robot={"deadlines_met_total": met})
    watch.unanswered = 1
    found = judge(watch, BEGIN_S, SUMMARY, CAP)
    assert found["verdicts"]["metrics"] == "fail"
    assert found["deadlines"]["ticks"] == 1000 * (TIMES[-1] - TIMES[0])


def test_before_the_warm_up_is_over_nothing_is_judged():
    found = judge(soaked(), END_S, SUMMARY, CAP)
    assert found["processes"] == []
    assert found["verdict"] == "not judged"
    assert found["measured"] == {"from_s": None, "to_s": None, "rounds": 0}


@pytest.mark.parametrize(("whole", "warm_up"), [(60.0, 60.0), (60.0, 90.0), (3.0, 2.9)])
def test_a_plan_that_leaves_nothing_to_be_measured_is_refused(whole, warm_up):
    with pytest.raises(UsageError, match="--warm-up-minutes"):
        Plan(whole, warm_up)
