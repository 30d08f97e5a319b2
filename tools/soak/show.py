"""What a soak came to, as tables for people."""

from __future__ import annotations

from typing import Any

from rich.markup import escape
from rich.table import Table

from hoap3.protocol.runtime.deadline_verdict import FAIL, NOT_JUDGED
from hoap3.tools.show.output import print_line, results
from hoap3.tools.show.summary import coloured_verdict, known, machine_line
from hoap3.tools.soak.judge import LIMIT_MB_H, memory_verdict
from hoap3.tools.soak.trend import CONFIDENCE

COLUMNS = (
    "process",
    "RSS [MB]",
    "least",
    "most",
    "grows [MB/h]",
    "at most",
    "descriptors",
    "threads",
)


def show_soak(soaked: dict[str, Any]) -> None:
    """Print a row a process, a verdict a figure, and where the files are."""
    table = Table(*COLUMNS, box=None, header_style="bold", pad_edge=False)
    for each in soaked["processes"]:
        memory = each["memory"]
        table.add_row(
            escape(each["name"]),
            f"{memory['begin_mb']:.1f} → {memory['end_mb']:.1f}",
            f"{memory['min_mb']:.1f}",
            f"{memory['max_mb']:.1f}",
            known(memory["slope_mb_per_hour"], "+.3f"),
            known(memory["upper_mb_per_hour"], "+.3f"),
            _counts(each["descriptors"]),
            _counts(each["threads"]),
        )
    results.print(table)
    rows = Table(show_header=False, box=None, pad_edge=False)
    for name, words in in_words(soaked).items():
        rows.add_row(name, coloured_verdict(soaked["verdicts"][name], words))
    rows.add_row("all in all", coloured_verdict(soaked["verdict"]))
    results.print(rows)
    if soaked["interrupted"]:
        print_line(
            f"ended by the user, before {soaked['plan']['duration_s'] / 60:g} min had passed"
        )
    if soaked["failure"]:
        print_line(f"the services failed: {soaked['failure']}")
    results.print(machine_line(soaked), markup=False)
    for file in soaked["files"]:
        print_line(file)


def in_words(soaked: dict[str, Any]) -> dict[str, str]:
    """What each verdict rests on, in a line."""
    measured, processes = soaked["measured"], soaked["processes"]
    log, metrics = soaked["log"], soaked["metrics"]
    there = sum(each["throughout"] for each in processes)
    sizes = ", ".join(f"{side} {known(mb, '.1f')}" for side, mb in log["most_mb"].items())
    dropped = ", ".join(f"{side} {known(n, 'd')}" for side, n in log["dropped"].items())
    lost = "".join(f"; {why}" for why in log["lost"])
    return {
        "memory": _memory_words(processes),
        "descriptors": _changed(processes, "descriptors"),
        "threads": _changed(processes, "threads"),
        "processes": f"{there} of {len(processes)} were there in all {measured['rounds']} rounds",
        "phase": _phase_words(soaked["phase"]),
        "deadlines": _deadline_words(soaked["deadlines"]),
        "log": f"at most {sizes} MB of {log['cap_mb']:g}; records dropped: {dropped}{lost}",
        "metrics": f"asked for {metrics['asked']} times, {metrics['unanswered']} in vain",
    }


def _memory_words(processes: list[dict[str, Any]]) -> str:
    limit = f"{LIMIT_MB_H:g} MB/h with {CONFIDENCE:.0%} confidence"
    by_verdict = {
        verdict: [each["name"] for each in processes if memory_verdict(each["memory"]) == verdict]
        for verdict in (FAIL, NOT_JUDGED)
    }
    if by_verdict[FAIL]:
        return f"grows by more than {limit}: {', '.join(by_verdict[FAIL])}"
    if by_verdict[NOT_JUDGED] or not processes:
        which = f": {', '.join(by_verdict[NOT_JUDGED])}" if processes else ""
        return f"too short to tell whether growth is below {limit}{which}"
    return f"every process grows by less than {limit}"


def _phase_words(phase: dict[str, Any]) -> str:
    words = f"the schedule moved by {phase['drift_ns']} ns in {phase['states']} States"
    if phase["wakeup_mean_us"] is None:
        return words
    words += f"; woke {phase['wakeup_mean_us']:.1f} µs late on average"
    grows = phase["wakeup_trend"]
    if grows["upper_us_per_hour"] is None:
        return words
    return (
        f"{words}, {grows['slope_us_per_hour']:+.1f} µs/h "
        f"({grows['lower_us_per_hour']:+.1f} to {grows['upper_us_per_hour']:+.1f})"
    )


def _deadline_words(found: dict[str, Any]) -> str:
    stops = f"safe stops {known(found['safe_stops'], 'd')}"
    if found["success_rate"] is None:
        return f"{found['text']} in the measured time; {stops}"
    words = (
        f"{found['text']}; success rate {found['success_rate']:.6f} of {found['ticks']} ticks: "
        f"late {found['late']}, lost {found['lost']}, skipped {found['skipped']}"
    )
    if found["success_rate_outside_stalls"] is not None:
        words += (
            f"; outside stalls {found['success_rate_outside_stalls']:.6f}, missed or skipped "
            f"{found['missed_outside_stalls']}; the host stalled {found['host_stalls']} times, "
            f"{found['host_stall_seconds']:.2f} s in all"
        )
    worst = found["worst_round"]
    if worst is not None:
        words += f"; worst round {worst['success_rate']:.4f} of {worst['ticks']} ticks"
    return (
        f"{words}; of the whole run: worst window of 100 {known(found['worst_window'], '.2f')}, "
        f"{stops}"
    )


def _changed(processes: list[dict[str, Any]], what: str) -> str:
    changed = [
        f"{each['name']} {each[what]['begin']} → {each[what]['end']}"
        for each in processes
        if each[what]["begin"] != each[what]["end"]
    ]
    return ", ".join(changed) or "as many at the end as at the begin"


def _counts(found: dict[str, int]) -> str:
    return f"{found['begin']} → {found['end']} ({found['min']} to {found['max']})"
