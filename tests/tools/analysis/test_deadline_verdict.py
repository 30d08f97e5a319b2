"""The verdict on deadlines: both sides of each threshold, its reasons, cause and remedy."""

from __future__ import annotations

from typing import Any

import pytest

from hoap3.tools.analysis.deadline_verdict import judge_counts, judge_deadlines

FIFO, ORDINARY = "scheduling policy: SCHED_FIFO 85", "scheduling policy: refused, no right"
STAGES = {
    "solve": {"n": 9, "p50": 30.0, "p99": 900.0, "max": 900.0},
    "network": {"n": 9, "p50": 500.0, "p99": 1000.0, "max": 1000.0},
}


def figures(
    rate: float = 1.0,
    window: float | None = 1.0,
    longest: int = 1,
    ticks: int = 10_000,
    skipped: int = 0,
    stops: int = 0,
    **more: Any,
) -> dict[str, Any]:
    return {
        "ticks": ticks,
        "skipped": skipped,
        "success_rate": {"run": rate, "worst_window": window},
        "misses": {"longest_run": longest},
        "safe_stops": stops,
        **more,
    }


@pytest.mark.parametrize(
    ("given", "verdict", "reasons"),
    [
        (figures(), "pass", []),
        (figures(0.95, 0.90), "pass", []),
        (figures(0.9499), "warn", ["success_rate"]),
        (figures(0.90), "warn", ["success_rate"]),
        (figures(0.8999), "fail", ["success_rate"]),
        (figures(window=0.89), "warn", ["worst_window"]),
        (figures(window=0.80), "warn", ["worst_window"]),
        (figures(window=0.79), "fail", ["worst_window"]),
        (figures(0.9945, 0.0, 111), "fail", ["worst_window", "longest_run"]),
        (figures(longest=19), "pass", []),
        (figures(longest=20), "fail", ["longest_run"]),
        (figures(stops=1), "fail", ["safe_stop"]),
        (figures(0.96, skipped=104), "pass", []),
        (figures(0.96, skipped=106), "warn", ["success_rate"]),  # 9600 of 10106
        (figures(0.96, None, ticks=99), "pass", []),  # no worst window: the rate decides
        (figures(0.94, None, ticks=99), "warn", ["success_rate"]),
        (figures(0.0, None, 5, ticks=5), "fail", ["success_rate"]),
        (figures(ticks=0), "not judged", ["nothing_asked"]),
        (figures(ticks=0, stops=1), "fail", ["safe_stop", "nothing_asked"]),
    ],
)
def test_the_verdict_on_both_sides_of_its_thresholds(given, verdict, reasons):
    found = judge_deadlines(given)
    assert (found["verdict"], found["reasons"]) == (verdict, reasons)


def test_misses_in_a_row_are_judged_by_the_robots_own_setting():
    patient = figures(0.999, 0.9, 30)
    assert judge_deadlines(patient, 31)["verdict"] == "pass"
    assert judge_deadlines(patient, 30)["reasons"] == ["longest_run"]
    counts = {"asked": 1000, "in_time": 970, "worst_window": 0.95, "longest_run": 5}
    assert judge_counts({**counts, "misses_to_stop": 5})["verdict"] == "fail"
    assert judge_counts(counts)["verdict"] == "pass"
    assert judge_counts(counts, skipped=30)["verdict"] == "warn"


@pytest.mark.parametrize(
    ("more", "cause", "remedy"),
    [
        ({"misses_outside_stalls": 10, "realtime": [FIFO]}, "host stalled in 1190 of 1200", "CPU"),
        ({"misses_outside_stalls": 1190, "realtime": [FIFO]}, "solve took longest", "constraints"),
        (
            {
                "misses_outside_stalls": 1190,
                "realtime": [FIFO],
                "stages_us": {"kinematics": {"n": 9, "p50": 80.0, "p99": 110.0, "max": 6780.0}},
            },
            "kinematics took longest",  # 11 % misses have another cause
            "frames",
        ),
        ({"misses_outside_stalls": None, "realtime": [ORDINARY]}, "real-time rights", "doctor"),
        (
            {"misses_outside_stalls": 1200, "realtime": [FIFO], "guilty": {"host": 9, "decode": 2}},
            "decode in 2 misses",
            "report",
        ),
    ],
)
def test_the_cause_and_the_remedy_are_named(more, cause, remedy):
    given = figures(0.89, 0.5, skipped=100, rtt_us={"n": 9}, **{"stages_us": STAGES, **more})
    found = judge_deadlines(given)
    assert found["verdict"] == "fail"  # whatever the cause is
    assert cause in found["cause"]
    assert remedy in found["remedy"]
    assert found["cause"] in found["text"]
    assert found["remedy"] in found["text"]


@pytest.mark.parametrize(("most", "preempted"), [(551.0, True), (549.0, False)])
def test_a_computation_that_took_far_longer_once_may_have_been_preempted(most, preempted):
    took = {"kinematics": {"n": 9, "p50": 80.0, "p99": 110.0, "max": most}}
    given = figures(0.995, 0.5, stages_us=took, realtime=[FIFO], misses_outside_stalls=50)
    assert ("CPU" in judge_deadlines(given)["cause"]) == preempted


def test_in_virtual_time_no_stage_is_blamed():
    found = judge_deadlines(figures(0.5, 0.0, 50, realtime=[]))
    assert found["verdict"] == "fail"
    assert found["cause"] is None
