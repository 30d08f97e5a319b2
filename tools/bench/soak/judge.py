"""What a soak came to: its figures, and a verdict on each. docs/guides/operation.md defines them.

How fast something grows is a line through it, with bounds that allow for its autocorrelation.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from scipy.stats import t

from hoap3.tools.analysis.deadline_verdict import FAIL, NOT_JUDGED, PASS, judge_deadlines
from hoap3.tools.analysis.verdicts import failed
from hoap3.tools.bench.soak.watch import ROBOT, Rounds, Series, Watch

LIMIT_MB_H = 1.0
"""Growth of a process that is taken for none, with 95 % confidence."""
BLOCK_S = 60.0
LEAST_BLOCKS = 16  # of the measured time, where that is short
ENDS = 10  # the part of the rounds, 1/10, that is the begin, and the end
Figures = dict[str, Any]
CONFIDENCE = 0.95
STEEPEST = 2.0
HOUR_S = 3600.0


def judge(
    watch: Watch, begin_s: float, summary: Mapping[str, Any] | None, cap_bytes: int
) -> Figures:
    """All figures of a soak, and its verdicts.

    Args:
        watch: what was seen.
        begin_s: of the measured time, after the begin of the motion [s].
        summary: of the run, None where it failed.
        cap_bytes: that the log of a side may take.

    Returns:
        `verdicts`, by what they are about, and `verdict`, of all; each `pass` or `fail`, or
        `not judged` where too little was seen; that of `deadlines` is that of a run. Then the
        figures: `measured`, `processes`, `phase`, `deadlines`, `log` and `metrics`.
    """
    robot = watch.sides["robot"].since(begin_s)
    times = robot["t"]
    processes = [
        {"pid": pid, **process_figures(rounds, begin_s, times)}
        for pid, rounds in watch.processes.items()
        if len(rounds.since(begin_s)["t"])
    ]
    figures: Figures = {
        "measured": {
            "from_s": float(times[0]) if len(times) else None,
            "to_s": float(times[-1]) if len(times) else None,
            "rounds": len(times),
        },
        "processes": processes,
        "phase": _phase(watch, robot),
        "deadlines": _deadlines(robot, summary),
        "log": _log(watch, begin_s, summary, cap_bytes),
        "metrics": {"asked": watch.scrapes, "unanswered": watch.unanswered},
    }
    verdicts = {
        "memory": _of_all([memory_verdict(each["memory"]) for each in processes]),
        "descriptors": _of_all([_same(each["descriptors"]) for each in processes]),
        "threads": _of_all([_same(each["threads"]) for each in processes]),
        "processes": _of_all([PASS if each["throughout"] else FAIL for each in processes]),
        "phase": figures["phase"].pop("verdict"),
        "deadlines": figures["deadlines"].pop("verdict"),
        "log": figures["log"].pop("verdict"),
        "metrics": NOT_JUDGED if not watch.scrapes else FAIL if watch.unanswered else PASS,
    }
    if summary is None:
        verdicts["processes"] = FAIL  # one ended, or never did its work
    whole = FAIL if failed(verdicts) else NOT_JUDGED if NOT_JUDGED in verdicts.values() else PASS
    return {"verdicts": verdicts, "verdict": whole, **figures}


def process_figures(rounds: Rounds, begin_s: float, times: Series) -> Figures:
    """Of one process, in the measured time.

    Args:
        rounds: of what it held.
        begin_s: of the measured time [s].
        times: of all rounds of the measured time [s].

    Returns:
        `name`; `throughout`, whether it was there in each round; `memory`, `descriptors`
        and `threads`.
    """
    held = rounds.since(begin_s)
    rss = held["rss_bytes"] / 1e6
    middles, means = block_means(held["t"], rss, _block_s(times))
    grows = trend(middles, means)
    return {
        "name": rounds.label,
        "throughout": len(held["t"]) == len(times),
        "memory": {
            "begin_mb": float(means[0]),
            "end_mb": float(means[-1]),
            "min_mb": float(rss.min()),
            "max_mb": float(rss.max()),
            **{
                f"{name}_mb_per_hour": value if math.isfinite(value) else None
                for name, value in grows._asdict().items()
            },
            "blocks_s": middles.round(3).tolist(),
            "blocks_mb": means.round(6).tolist(),
        },
        "descriptors": count_figures(held["descriptors"]),
        "threads": count_figures(held["threads"]),
    }


def count_figures(counts: Series) -> dict[str, int]:
    """Begin and end of a count: the least of the first, and of the last, tenth of the rounds.

    What is there for a moment, such as the socket of whoever asks for metrics, is in `max` only.
    """
    part = -(-len(counts) // ENDS)
    return {
        "begin": int(counts[:part].min()),
        "end": int(counts[-part:].min()),
        "min": int(counts.min()),
        "max": int(counts.max()),
    }


def memory_verdict(memory: Mapping[str, Any]) -> str:
    """`pass` where growth is below the limit with confidence, `fail` where it is above with it."""
    lower, upper = memory["lower_mb_per_hour"], memory["upper_mb_per_hour"]
    if lower is None or upper is None:
        return NOT_JUDGED
    return PASS if upper < LIMIT_MB_H else FAIL if lower >= LIMIT_MB_H else NOT_JUDGED


def _block_s(times: Series) -> float:
    """Length of a block, for rounds at these times [s]."""
    whole = float(times[-1] - times[0]) if len(times) > 1 else BLOCK_S
    return min(BLOCK_S, whole / LEAST_BLOCKS)


def _same(counts: Mapping[str, int]) -> str:
    return PASS if counts["begin"] == counts["end"] else FAIL


def _of_all(verdicts: list[str]) -> str:
    """`fail` if one fails, `pass` if all pass; `not judged` otherwise."""
    if FAIL in verdicts:
        return FAIL
    return NOT_JUDGED if NOT_JUDGED in verdicts or not verdicts else PASS


def _phase(watch: Watch, robot: Mapping[str, Series]) -> Figures:
    """Of the schedule, and of how late the robot woke."""
    kept = watch.drift_ns == 0 and len(watch.sessions) == 1
    return {
        "verdict": NOT_JUDGED if not watch.heard else PASS if kept else FAIL,
        "drift_ns": watch.drift_ns,
        "states": watch.heard,
        "sessions": len(watch.sessions),
        "wakeup_mean_us": _ratio(
            _grown(robot["wakeup_seconds_sum"]), _grown(robot["wakeup_seconds_count"]), 1e6
        ),
    }


def _deadlines(robot: Mapping[str, Series], summary: Mapping[str, Any] | None) -> Figures:
    """Of the ticks of the measured time; safe stops and the worst window are of the whole run."""
    told = np.isfinite(robot["deadlines_met_total"])
    grown = {name: np.diff(robot[name][told]) for name in ROBOT}
    met, missed = grown["deadlines_met_total"], grown["deadlines_missed_total"]
    asks = met + missed > 0  # a robot that rests asks for nothing, and skips nothing that counts
    skipped = np.where(asks, grown["ticks_skipped_total"], 0.0)
    in_time, failures, lapsed = (int(each.sum()) for each in (met, missed, skipped))
    late = int(grown["deadlines_late_total"].sum())
    asked = in_time + failures + lapsed
    rate = in_time / asked if asked else None
    outside = _grown(robot["misses_outside_stalls_total"])
    stops = None if summary is None else summary["safe_stops"]
    run = summary or {"success_rate": {"worst_window": None}, "misses": {"longest_run": 0}}
    worst, longest = run["success_rate"]["worst_window"], run["misses"]["longest_run"]
    judged = judge_deadlines(
        {
            **run,
            "ticks": in_time + failures,
            "skipped": lapsed,
            "success_rate": {"run": _ratio(in_time, in_time + failures), "worst_window": worst},
            "misses_outside_stalls": outside,
        }
    )
    return {
        **judged,
        "ticks": asked,
        "in_time": in_time,
        "late": late,
        "lost": failures - late,
        "skipped": lapsed,
        "success_rate": rate,
        "missed_outside_stalls": outside,
        "success_rate_outside_stalls": (
            None if outside is None else _ratio(in_time, in_time + outside)
        ),
        "worst_window": worst,
        "longest_run": None if summary is None else longest,
        "safe_stops": stops,
        "host_stalls": _grown(robot["host_stalls_total"]),
        "host_stall_seconds": _grown(robot["host_stall_seconds_total"]),
    }


def _log(
    watch: Watch, begin_s: float, summary: Mapping[str, Any] | None, cap_bytes: int
) -> Figures:
    """Of the logs of both sides: whether they are whole, and within their size."""
    lost = [] if summary is None else summary["log_lost"]
    sides = {side: rounds.since(begin_s) for side, rounds in watch.sides.items()}
    dropped = {side: _grown(each["dropped_records_total"]) for side, each in sides.items()}
    most = {side: _most(each["log_bytes"]) for side, each in sides.items()}
    known = None not in dropped.values() and None not in most.values()
    sound = (
        not lost
        and not any(_most(each["log_lost"]) for each in sides.values())
        and not any(dropped.values())
        and all(size is not None and size <= cap_bytes for size in most.values())
    )
    return {
        "verdict": NOT_JUDGED if not known else PASS if sound else FAIL,
        "lost": lost,
        "dropped": dropped,
        "most_mb": {side: None if size is None else size / 1e6 for side, size in most.items()},
        "cap_mb": cap_bytes / 1e6,
    }


def _grown(counts: Series) -> Any:
    """By how much a count has grown; None where it was not told twice."""
    told = counts[np.isfinite(counts)]
    if len(told) < 2:
        return None
    grown = float(told[-1] - told[0])
    return int(grown) if grown.is_integer() else grown


def _most(values: Series) -> float | None:
    told = values[np.isfinite(values)]
    return float(told.max()) if len(told) else None


def _ratio(part: float | None, whole: float | None, scale: float = 1.0) -> float | None:
    return None if part is None or not whole else scale * part / whole


class Trend(NamedTuple):
    """A slope per hour, and what it is at least and at most, each with 95 % confidence.

    Of fewer than three values the bounds are infinite, and the slope is no number.
    """

    slope: float
    lower: float
    upper: float


def block_means(times: Series, values: Series, length_s: float) -> tuple[Series, Series]:
    """Means over blocks of equal length.

    What is no number is left out, and so is a block of nothing else.

    Args:
        times: ascending [s].
        values: one at each of them.
        length_s: of a block, from the first time on [s].

    Returns:
        Mean time of each block [s], and the mean of its values.
    """
    known = np.isfinite(values)
    times, values = times[known], values[known]
    if not len(times):
        return times, values
    last = max(int((times[-1] - times[0]) / length_s + 0.5), 1) - 1  # of a piece, no block
    block = np.minimum(((times - times[0]) / length_s).astype(int), last)
    n = np.bincount(block)
    there = n > 0
    middles = np.bincount(block, times)[there] / n[there]
    above = np.bincount(block, values - values[0])[there] / n[there]  # 0, not nearly, of constants
    return middles, values[0] + above


def trend(times: Series, values: Series) -> Trend:
    """The least-squares slope of a series, with one-sided bounds.

    Values beside each other are alike: memory grows in steps, and stays. With the correlation r of
    a residual with the next one, at least 0, n values are worth n (1 − r)/(1 + r) independent
    ones, in the spread of the residuals as in the degrees of freedom of Student's t (Santer et al.
    2000, doi:10.1029/1999JD901105). Below one degree, where a series is of one piece, the bounds
    are ± `STEEPEST` times its whole range over its whole time: of a random walk, which keeps all
    that it ever took, and any slope added to it, that is exceeded in at most 5 % of cases.

    Args:
        times: equally far apart [s], (n,).
        values: at these times, (n,).
    """
    if len(times) < 3:
        return Trend(math.nan, -math.inf, math.inf)
    hours = (times - times.mean()) / HOUR_S
    spread = float(hours @ hours)
    values = values - values[0]  # or rounding would make a constant a series of one piece
    values -= values.mean()
    slope = float(hours @ values) / spread
    residuals = values - slope * hours
    square = float(residuals @ residuals)
    alike = max(float(residuals[1:] @ residuals[:-1]) / square, 0.0) if square else 0.0
    freedom = len(times) * (1.0 - alike) / (1.0 + alike) - 2.0
    if freedom < 1.0:
        steepest = STEEPEST * float(np.ptp(values) / np.ptp(hours))
        return Trend(slope, -steepest, steepest)
    margin = float(t.ppf(CONFIDENCE, freedom)) * math.sqrt(square / freedom / spread)
    return Trend(slope, slope - margin, slope + margin)
