"""Figures of ticks, as docs/guides/measuring.md defines them: of one run, or of several in a row.

Percentiles are nearest-rank: a value that was measured, exact.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np

from hoap3.protocol.messages import FloatArray
from hoap3.protocol.runtime.deadlines import WINDOW, rank
from hoap3.tools.analysis.cycles import NEVER, Stamps
from hoap3.tools.analysis.deadline_verdict import NOT_JUDGED, judge_deadlines
from hoap3.tools.analysis.miss_attribution import Times
from hoap3.tools.analysis.numbers import summary
from hoap3.tools.analysis.ticks import IN_TIME, LATE, LOST, SKIPPED, STAGES, TickTable
from hoap3.tools.machine.stalls import figures as stall_figures


def tick_figures(
    tables: Sequence[TickTable],
    misses_to_stop: int | None = None,
    realtime: Sequence[str] | None = None,
) -> dict[str, Any]:
    """Everything that the ticks of some runs say.

    Args:
        tables: of runs that followed each other; `block` in `worst` counts them from 0.
        misses_to_stop: misses in a row that fail, where the robot itself goes on; None: those
            that stop it.
        realtime: real-time measures of the robot's process, where they are known.
    """
    in_time = np.concatenate([table.outcome == IN_TIME for table in tables])
    asked = np.concatenate([table.asked for table in tables])
    ticks = int(np.count_nonzero(asked))
    rate = float(np.mean(in_time[asked])) if ticks else None
    windows = [found for table in tables if (found := worst_window(table)) is not None]
    outside, rate_outside = _outside_stalls(tables)
    stalls = [stall for table in tables for stall in table.stalls_of_motion or ()]
    guilty = Counter[str]()
    for table in tables:
        guilty.update(table.attributed_counts())
    ours = [name for name, _ in guilty.most_common() if name != "host"]
    figures = {
        **tables[0].rule,
        "ticks": ticks,
        "skipped": sum(table.count(SKIPPED) for table in tables),
        "misses": {
            "late": sum(table.count(LATE) for table in tables),
            "lost": sum(table.count(LOST) for table in tables),
            **{
                name: sum(table.messages[name] for table in tables)
                for name in ("rejected", "duplicate", "out_of_order")
            },
            "longest_run": max((longest_run(table) for table in tables), default=0),
        },
        "misses_outside_stalls": outside,
        "host_stalls": None if outside is None else stall_figures(stalls),
        "success_rate": {
            "run": rate,
            "outside_stalls": rate_outside,
            "worst_window": min(windows, default=None),
        },
        "safe_stops": sum(table.safe_stops for table in tables),
        "guilty_stage": ours[0] if ours else None,
        "guilty": dict(guilty.most_common()),
        **_durations(tables),
    }
    known = figures if realtime is None else {**figures, "realtime": realtime}
    deadlines = judge_deadlines(known, misses_to_stop or tables[0].misses_to_stop)
    verdicts = {"deadlines": deadlines.pop("verdict"), "task": NOT_JUDGED}
    verdicts["limits_and_balance"] = NOT_JUDGED
    return {"verdicts": verdicts, "deadlines": deadlines, **figures}


def _durations(tables: Sequence[TickTable]) -> dict[str, Any]:
    """All that takes time; nothing where all time is virtual."""
    if any(table.lockstep for table in tables):
        return {}
    numbers = np.concatenate([table.tick for table in tables])

    def of(name: str) -> dict[str, Any]:
        return percentiles(np.concatenate([table.stage(name) for table in tables]), numbers)

    answered = [response(table.intended, table.arrival, _last(table)) for table in tables]
    worst = [
        {"block": block, **tick} for block, table in enumerate(tables) for tick in table.worst()
    ]
    worst.sort(key=lambda tick: -tick["rtt_us"])
    return {
        "rtt_us": of("rtt"),
        "response_us": percentiles(np.concatenate(answered), numbers),
        "wakeup_us": of("wakeup"),
        "jitter_us": jitter(tables),
        "stages_us": {name: of(name) for name in (*STAGES, "unaccounted")},
        "worst": worst[:10],
    }


def percentiles(values: Times, ticks: Stamps | None = None) -> dict[str, Any]:
    """n, min, percentiles, max [us] and worst ten of durations [ns]; nan are left out."""
    result: dict[str, Any] = summary(values / 1e3)
    if ticks is not None and result["n"]:
        known = ~np.isnan(values)
        values, numbers = values[known], ticks[known]
        result["worst"] = [
            {"us": float(values[place]) / 1e3, "tick": int(numbers[place])}
            for place in np.argsort(-values, kind="stable")[:10].tolist()
        ]
    return result


def response(intended: Stamps, arrival: Stamps, until: int) -> Times:
    """From the intended start of each tick until an answer to it, or to a later one, was there.

    Skipped and lost ticks count too: a sender that stalls must not hide how long everybody waited
    (coordinated omission). Where none came, they waited until the end at least.

    Args:
        intended: of ticks in ascending order, skipped ones too [ns].
        arrival: of their answers [ns], NEVER where none came.
        until: the last that is known [ns].
    """
    came = np.where(arrival == NEVER, np.inf, arrival.astype(float))
    first = np.minimum.accumulate(came[::-1])[::-1]
    waited: Times = np.where(np.isinf(first), float(until), first) - intended
    return waited


def _last(table: TickTable) -> int:
    """Until when anything is known of a run: an answer, or a deadline without one [ns]."""
    return int(np.concatenate([table.arrival, table.end]).max(initial=0))


def jitter(tables: Sequence[TickTable]) -> dict[str, Any]:
    """Spread of the time between wake-ups of ticks in a row about T [us]."""
    deviations = np.concatenate([_deviations(table) for table in tables])
    if len(deviations) < 2:
        return {"n": len(deviations)}
    sizes = np.sort(np.abs(deviations))
    p50, p99_9 = (sizes[rank(len(sizes), share) - 1] for share in (50.0, 99.9))
    return {
        "n": len(deviations),
        "std": float(np.std(deviations, ddof=1)) / 1e3,
        "p99_9_minus_p50": float(p99_9 - p50) / 1e3,
        "max": float(sizes[-1]) / 1e3,
    }


def _deviations(table: TickTable) -> Times:
    in_a_row = table.asked[1:] & table.asked[:-1] & (np.diff(table.tick) == 1)
    result: Times = (np.diff(table.actual)[in_a_row] - table.period).astype(float)
    return result


def longest_run(table: TickTable) -> int:
    """Most misses in a row; skipped ticks neither add to a run nor end it."""
    missed = (table.outcome != IN_TIME)[table.asked]
    ends = np.flatnonzero(np.concatenate([[True], ~missed, [True]]))
    return int(np.diff(ends).max()) - 1


def recent_rates(table: TickTable) -> FloatArray:
    """Success rate of the last 100 ticks, or of all so far, at each tick that asked."""
    hits = table.outcome[table.asked] == IN_TIME
    total = np.concatenate([[0], np.cumsum(hits)])
    end = np.arange(1, len(total))
    begin = np.maximum(end - WINDOW, 0)
    return np.asarray((total[end] - total[begin]) / (end - begin), float)


def worst_window(table: TickTable) -> float | None:
    """Least success rate of any 100 ticks in a row that asked; None for fewer."""
    return min(recent_rates(table)[WINDOW - 1 :].tolist(), default=None)


def _outside_stalls(tables: Sequence[TickTable]) -> tuple[int | None, float | None]:
    """Misses that no stall excuses, and the success rate without the others; None if unwatched."""
    counts = [table.misses_outside_stalls for table in tables]
    if any(count is None for count in counts):
        return None, None
    outside = sum(count or 0 for count in counts)
    in_time = sum(table.count(IN_TIME) for table in tables)
    return outside, in_time / (in_time + outside) if in_time + outside else None
