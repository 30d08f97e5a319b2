"""The verdict on deadlines: its reasons, the cause of the misses, and what would help."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

PASS, WARN, FAIL, NOT_JUDGED = "pass", "warn", "fail", "not judged"
"""Values of all verdicts; `warn` is of deadlines alone."""

PASS_RATE, FAIL_RATE = 0.95, 0.90
PASS_WINDOW, FAIL_WINDOW = 0.90, 0.80
"""Success rates that pass, and those below which a run fails: of all ticks, of the worst 100."""
MISSES_TO_STOP = 20
"""Misses in a row after which a robot with ordinary settings stops safely."""

SAFE_STOP, LONGEST_RUN = "safe_stop", "longest_run"
RATE, WINDOW, NOTHING_ASKED = "success_rate", "worst_window", "nothing_asked"
_HELP = "`hoap3 doctor` names what this machine lacks"
_REMEDIES = {
    "host": "use CPUs that no other machine shares (`hoap3 help operation`)",
    "rights": f"the first lines of the run say what was refused; {_HELP}",
    "wakeup": _HELP,
    "network": "look for load on the link, and compare links with `hoap3 latency`",
    "solve": "take fewer tasks or constraints, another controller, or a longer period",
    "kinematics": "take fewer frames, or a longer period",
    "preempted": f"keep other load off its CPU; {_HELP}",
}
_COMPUTED = {"decode", "kinematics", "solve", "encode"}
PREEMPTED = 5.0
"""A computation that once took so many times its 99th percentile may not have had its CPU."""
_REPORT = "see the worst ticks in `hoap3 report`"


def judge_deadlines(
    figures: Mapping[str, Any], misses_to_stop: float | None = None
) -> dict[str, Any]:
    """Judge success rate, worst window of 100 ticks and longest run of misses of a run.

    All misses count, also those that overlap a stall of the host: that is a cause, no excuse.

    Args:
        figures: as `run --json` has them: `ticks`, `skipped`, `success_rate`, `misses`,
            `safe_stops`, and where known `misses_outside_stalls`, `realtime`, and `guilty` or
            `stages_us` and `wakeup_us`. A run of fewer than 100 ticks has no worst window: there
            the rate of the run decides.
        misses_to_stop: misses in a row that stop the robot; None: 20.

    Returns:
        `verdict`, `reasons`, `cause` and `remedy` (None without misses), and all of it as `text`.
    """
    ticks, skipped = figures["ticks"], figures["skipped"]
    rate, window = figures["success_rate"]["run"], figures["success_rate"]["worst_window"]
    longest, stops = figures["misses"]["longest_run"], figures.get("safe_stops") or 0
    most = misses_to_stop or MISSES_TO_STOP
    found: list[tuple[str, str, str]] = []  # verdict, reason, text
    if stops:
        found.append((FAIL, SAFE_STOP, f"{stops} safe stop{'s' if stops > 1 else ''}"))
    if not ticks or rate is None:
        found.append((FAIL if stops else NOT_JUDGED, NOTHING_ASKED, "no answer was requested"))
        return _result(found, None, None)
    rate *= ticks / (ticks + skipped)  # a skipped tick was not in time either
    found += _below(RATE, rate, PASS_RATE, FAIL_RATE, "of all ticks in time")
    if window is not None:
        found += _below(WINDOW, window, PASS_WINDOW, FAIL_WINDOW, "of the worst 100 in time")
    if longest >= most:
        found.append((FAIL, LONGEST_RUN, f"{longest} misses in a row; {most:g} stop a robot"))
    if not found:
        worst = "" if window is None else f", {window:.2f} of the worst 100"
        return _result([(PASS, "", f"{rate:.5f} of all ticks in time{worst}")], None, None)
    return _result(found, *_cause(figures))


def judge_counts(counts: Mapping[str, Any], skipped: int | None = None) -> dict[str, Any]:
    """The same from what a robot counted itself, as its summary and status have it.

    Args:
        counts: of the robot.
        skipped: ticks skipped while it was active; None: as `counts` has them.
    """
    asked = counts.get("asked", 0)
    rate = counts.get("in_time", 0) / asked if asked else None
    figures = {
        "ticks": asked,
        "skipped": counts.get("skipped", 0) if skipped is None else skipped,
        "success_rate": {"run": rate, "worst_window": counts.get("worst_window")},
        "misses": {"longest_run": counts.get("longest_run", 0)},
        "safe_stops": counts.get("safe_stops", 0),
    }
    return judge_deadlines(figures, counts.get("misses_to_stop"))


def unknown_deadlines(reason: str, text: str, verdict: str = NOT_JUDGED) -> dict[str, Any]:
    """The verdict on deadlines where their figures are not known."""
    return _result([(verdict, reason, text)], None, None)


def _below(reason: str, rate: float, passes: float, fails: float, what: str) -> list[Any]:
    if rate >= passes:
        return []
    verdict, limit = (WARN, passes) if rate >= fails else (FAIL, fails)  # NaN fails
    return [(verdict, reason, f"{rate:.5f} {what}, below {limit:.2f}")]


def _result(found: list[Any], cause: str | None, remedy: str | None) -> dict[str, Any]:
    verdicts = [verdict for verdict, _, _ in found]
    worst = next((each for each in (FAIL, WARN, NOT_JUDGED) if each in verdicts), PASS)
    parts = [text for _, _, text in found]
    parts += [f"cause: {cause}", f"remedy: {remedy}"] if cause else []
    return {
        "verdict": worst,
        "reasons": [reason for _, reason, _ in found if reason],
        "cause": cause,
        "remedy": remedy,
        "text": "; ".join(part for part in parts if part),
    }


def _cause(figures: Mapping[str, Any]) -> tuple[str | None, str | None]:
    """What most misses are due to, and what helps; None where all time is virtual."""
    ticks, skipped = figures["ticks"], figures["skipped"]
    total = round((1.0 - figures["success_rate"]["run"]) * ticks) + skipped
    if not total:  # such as a safe stop for another reason
        return None, None
    ours, measures = figures.get("misses_outside_stalls"), figures.get("realtime")
    if ours is not None and 2 * (total - ours) > total:
        return f"the host stalled in {total - ours} of {total} misses", _REMEDIES["host"]
    stage, words = _longest_stage(figures)
    granted = ours is not None if measures is None else any(map(_is_realtime, measures))
    if "rtt_us" in figures and not granted:
        return "; ".join(filter(None, ["no real-time rights", words])), _REMEDIES["rights"]
    return words or None, _REMEDIES.get(stage, _REPORT)


def _is_realtime(measure: str) -> bool:
    return measure.startswith("scheduling policy: SCHED_FIFO")


def _longest_stage(figures: Mapping[str, Any]) -> tuple[str, str]:
    """Stage of ours to which most misses are attributed, else that which took longest, in words."""
    guilty = {name: n for name, n in figures.get("guilty", {}).items() if name != "host"}
    if guilty:
        stage = max(guilty, key=lambda name: guilty[name])
        return stage, f"{stage} in {guilty[stage]} misses"
    stages = {**figures.get("stages_us", {}), "wakeup": figures.get("wakeup_us", {})}
    excess = {name: each["max"] - each["p50"] for name, each in stages.items() if each.get("n")}
    if not excess:
        return "", ""
    stage = max(excess, key=lambda name: excess[name])
    most, usual = stages[stage]["max"], stages[stage]["p99"]
    words = f"{stage} took longest, up to {most / 1e3:.2f} ms"
    ticks = figures["ticks"] + figures["skipped"]
    missed = ticks - figures["success_rate"]["run"] * figures["ticks"]
    if stage in _COMPUTED and most > PREEMPTED * usual and missed < 0.01 * ticks:
        return "preempted", f"{words} (p99 {usual / 1e3:.2f} ms): it may have lost its CPU"
    return stage, words
