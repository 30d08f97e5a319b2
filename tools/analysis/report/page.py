"""Render the page of a report: tiles and rows of tables; the text is in the template."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

from hoap3.protocol.errors import LogError, UsageError
from hoap3.tools.analysis.deadline_verdict import FAIL, NOT_JUDGED, WARN
from hoap3.tools.analysis.document import PAGES, POLICY
from hoap3.tools.analysis.numbers import NAMES as PERCENTILES
from hoap3.tools.analysis.numbers import count, number, rate, seconds, summary
from hoap3.tools.analysis.report.content import Content, read_content
from hoap3.tools.analysis.report.events import MOST
from hoap3.tools.analysis.report.sources import of_ours
from hoap3.tools.analysis.ticks import IN_TIME, STAGES, TickTable
from hoap3.tools.analysis.verdicts import NAMES, deadline_words, in_words
from hoap3.tools.logs.files import whole_file
from hoap3.tools.logs.log import Log
from hoap3.tools.machine.stalls import Stall, limited
from hoap3.tools.machine.stalls import figures as stall_figures

__all__ = ["POLICY", "SECTIONS", "page"]

SECTIONS = {
    "motion": "Motion",
    "certificates": "Certificates",
    "checked": "Verification",
    "conditions": "Conditions",
    "time": "Deadlines and times",
    "ticks": "Worst ticks",
    "events": "Events",
    "stalls": "Host stalls",
    "machine": "Machine and settings",
    "words": "Definitions",
}
"""Titles; a report leaves out sections that would be empty."""
QUESTIONS = "task", "deadlines", "limits_and_balance"
"""The verdicts in the order of the page: did it reach, in time, within limits."""
Row = list[object]
Tile = tuple[str, str, str, list[str]]


def page(content: Content) -> str:
    """The whole file."""
    drawings = content.drawings
    ticks, duration = content.ticks, content.duration_s
    length = "" if duration is None else f"{duration:.1f} s of motion"
    words = in_words(content.judged)
    given: dict[str, Any] = {}
    if ticks is not None and not ticks.lockstep:
        figures = content.tick_figures
        given = {"worst_ticks": _worst(figures), "duration_rows": _durations(figures)}
    if ticks is not None and ticks.stalls:
        given["stalls"] = _stalls(ticks, ticks.stalls)
    events = _events(content)
    filled = {
        "motion": drawings["motion"],
        "certificates": content.certificates,
        "conditions": content.conditions,
        "time": drawings["time"],
        "ticks": ticks is not None and (not ticks.lockstep or ticks.missed.any()),
        "events": events,
        "stalls": given.get("stalls"),
    }
    return PAGES.get_template("analysis/report/templates/page.html").render(
        given,
        kind="report",
        title=f"{content.robot} · {_config_and_controller(content)}",
        headline=headline(
            content.judged, content.checked.verdict, virtual=content.sources.lockstep
        ),
        sections={name: title for name, title in SECTIONS.items() if filled.get(name, True)},
        content=content,
        drawings=drawings,
        verdicts=[(NAMES[key], content.judged["verdicts"][key], words[key]) for key in QUESTIONS],
        facts=[length, content.transport, content.date, content.sources.label],
        tiles=tiles(content),
        shares=_shares,
        certificate_rows=_certificates(content),
        event_rows=events,
        interval_rows=_intervals(content),
        machines=[_machine_facts(content, log) for log in content.sources.logs],
    )


def _config_and_controller(content: Content) -> str:
    """The config that was run and, where it has another name, the controller."""
    config, controller = content.config, content.controller
    return f"{config} ({controller})" if config not in {"", controller} else controller


def headline(judged: Mapping[str, Any], verified: str, *, virtual: bool = False) -> str:
    """State in one sentence whether the run passed, and why not.

    Args:
        judged: has the keys that `judge` returns.
        verified: the result of the verification.
        virtual: in lockstep, where to be in time says nothing about this machine.
    """
    verdicts, words = judged["verdicts"], in_words(judged)
    found = []
    for verdict, begin in ((FAIL, "Failed"), (WARN, "Warning"), (NOT_JUDGED, "Not judged")):
        keys = [key for key in QUESTIONS if verdicts[key] == verdict]
        if keys:
            reasons = (f"{NAMES[key]} ({words[key].partition('; ')[0]})" for key in keys)
            found.append(f"{begin}: {', '.join(reasons)}")
    if verified == "false":
        found.insert(0, "Verification failed: numbers in the log are not what follows from it")
    time = "in time (virtual time)" if virtual else "in time"
    return ". ".join(found) or f"Passed: within tolerance at the end, {time}, within all limits"


def write_report(
    *logs: Path,
    out: Path | None = None,
    say: Callable[[str], None] = lambda _: None,
    robot: str | None = None,
    allow_code: bool = False,
    verify: bool = True,
) -> dict[str, Any]:
    """Write the report of a log.

    Args:
        logs: folder of a run, one `*.mcap`, or those of two services.
        out: the file; None for `report.html` next to the first. An earlier report is replaced.
        say: takes what is being done.
        robot: name or path of the robot on this machine, whose meshes are drawn.
        allow_code: import what the log names by a dotted path, to repeat its controller.
        verify: recompute what the logs claim.

    Returns:
        its figures, as `--json` prints them, with the path of the page as `report`, and whether it
        `replaced` an earlier one.

    Raises:
        LogError: there is no log of ours.
        UsageError: `out` cannot be written.
    """
    say("reading the log")
    content = read_content(*logs, robot=robot, say=say, allow_code=allow_code, verify=verify)
    log = logs[0]
    say("drawing")
    with of_ours(log):
        drawn = page(content)
    target = out or (log if log.is_dir() else log.parent) / "report.html"
    replaced = target.is_file()
    try:
        with whole_file(target) as draft:
            draft.write_text(drawn, encoding="utf-8", errors="replace")
    except OSError as error:
        reason = error.strerror or "no reason given"
        raise UsageError(
            f"{target}: cannot be written ({reason}). Choose another place with --out"
        ) from error
    return {**content.as_json(), "report": str(target), "replaced": replaced}


def _shares(counts: Mapping[str, int], decimals: int = 1) -> list[Row]:
    """Names, counts, and what share each has of them all."""
    total = sum(counts.values())
    return [[name, count(n), f"{100.0 * n / total:.{decimals}f} %"] for name, n in counts.items()]


def _certificates(content: Content) -> list[Row]:
    found = content.certificates
    if found is None:
        return []
    rows = _shares({name.replace("_", " "): n for name, n in found.counts.items()}, 3)
    for row, name in zip(rows, found.counts if found.reasons else (), strict=False):
        why = found.reasons.get(name, {})
        row.append(", ".join(f"{each} {count(n)}" for each, n in why.items()) or "–")
    return rows


def _worst(figures: Mapping[str, Any]) -> tuple[list[str], list[Row]]:
    """Stages that took any time in the worst ticks, and the rows of these."""
    worst = figures["worst"]
    names = [n for n in (*STAGES, "unaccounted") if any(row["stages_us"].get(n) for row in worst)]
    usual = {name: figures["stages_us"][name].get("p50", 0.0) for name in names}
    rows: list[Row] = []
    for row in worst:
        stages = row["stages_us"]
        excess = {name: stages[name] - usual[name] for name in names if name in stages}
        cells = {name: number(stages[name]) for name in excess}
        if excess:
            most = max(excess, key=lambda name: excess[name])
            cells[most] = Markup("<b>{}</b>").format(cells[most])
        stalled = {None: "unknown", True: "yes", False: "no"}[row["stalled"]]
        begin = [row["tick"], row["outcome"], number(row["rtt_us"])]
        rows.append([*begin, *(cells.get(n, "–") for n in names), stalled, row["guilty"] or "–"])
    return names, rows


def _durations(figures: Mapping[str, Any]) -> tuple[list[str], list[Row]]:
    """Names of the percentiles, and a row for each stage."""
    sizes = {"RTT": figures["rtt_us"], **figures["stages_us"]}
    if not sizes["unaccounted"].get("max"):
        del sizes["unaccounted"]
    known = [key for key in PERCENTILES if any(key in each for each in sizes.values())]
    keys = ["min", *known, "max"]
    return [PERCENTILES.get(key, key) for key in keys], [
        [name, count(int(each["n"])), *(number(each[k]) if k in each else "–" for k in keys)]
        for name, each in sizes.items()
    ]


def _events(content: Content) -> list[Row]:
    """What happened, in words, side by side with its tick and time."""
    motion, rows = content.motion, []
    for item in content.events[:MOST]:
        timed = motion is not None and item.side == motion.side
        at = seconds((item.stamp - motion.start_ns) / 1e9) if motion and timed else "–"
        what = [item.side, item.name, item.detail or "–"]
        rows.append([*what, count(item.times), item.tick, at])
    return rows


def _intervals(content: Content) -> list[Row]:
    """When each condition held, the first of them."""
    motion, rows = content.motion, list[Row]()
    for item in (content.intervals or ())[:MOST]:
        begin = end = duration = "–"
        if motion is not None and motion.description is not None:
            period_s = motion.description.period_s
            begin, end = (
                seconds((tick - motion.first_tick) * period_s) for tick in (item.begin, item.end)
            )
            duration = seconds(item.ticks * period_s)
        end = "until the end of the log" if item.goes_on else end
        rows.append([item.condition, item.begin, begin, end, duration])
    return rows


def _stalls(ticks: TickTable, stalls: list[Stall]) -> dict[str, Any]:
    """Lengths of those during the motion and of all [ms], and the ten longest."""
    every, meanwhile = (
        [s.end - s.start for s in each] for each in (stalls, ticks.stalls_of_motion or [])
    )
    longest = sorted(stalls, key=lambda stall: stall.start - stall.end)[:10]
    return {
        "meanwhile": {"n": len(meanwhile), "total_ms": sum(meanwhile) / 1e6},
        "all": {"total_ms": sum(every) / 1e6, **summary(np.array(every) / 1e6)},
        "longest": [
            [seconds((s.start - ticks.start_ns) / 1e9), number((s.end - s.start) / 1e6)]
            for s in longest
        ],
    }


def tiles(content: Content) -> list[Tile]:
    """Anchor of the definition, name, value, and notes of each figure at the head."""
    found = _error_tiles(content)
    found += _deadline_tiles(content, content.tick_figures) if content.ticks else []
    motion, certificates = content.motion, content.certificates
    if motion is not None and (nearest := motion.nearest_limit) is not None:
        joint, room = nearest
        clamped = content.judged["limits_and_balance"]["held_back"]
        notes = [joint, f"of its usable range, n {count(len(motion.range_used))} States"]
        if clamped is not None:
            notes.append(f"clamped in {count(clamped)} periods" if clamped else "no joint clamped")
        found.append(("figure-positions", "nearest joint limit", f"{number(room)} %", notes))
    if certificates is not None:
        notes = [f"of n {count(certificates.n)} answers"]
        if certificates.longest is not None:
            first = seconds(certificates.stretches[0].begin_s)
            longest = count(certificates.longest.answers)
            notes.append(f"first at {first} s, longest interval {longest}")
        without = count(certificates.without)
        found.append(("certificates", "without certificate", without, notes))
    return found


def _error_tiles(content: Content) -> list[Tile]:
    """The largest final error of the tasks, in multiples of its tolerance; else √(2V)."""
    motion, notes, last = content.motion, list[str](), ""
    judged = [each for each in content.judged["task"]["errors"] if each["judged"]]
    known = [each for each in judged if each["error"] is not None]
    if motion is not None and motion.has_certificates:
        unit = " mm" if motion.target_m is not None else ""
        errors = (1e3 if unit else 1.0) * (2.0 * motion.v[motion.v >= 0.0]) ** 0.5
        first, last = (f"{number(errors[place])}{unit}" for place in (0, -1))
        notes = [f"√(2V): {first} at first, {last} at the end"]
    if known:
        worst = max(known, key=lambda each: each["error"] / each["tolerance"])
        size, most = (_with_unit(worst[key], worst["unit"]) for key in ("error", "tolerance"))
        notes = [f"{worst['task']}, tolerance {most}", *notes]
        return [("word-verdict", "error at the end", size, notes)]
    if notes:
        return [("word-certificate", "error at the end", last, notes)]
    return []


def _with_unit(value: float, unit: str) -> str:
    """A size with its unit; lengths in mm."""
    if unit == "m":
        return f"{number(1e3 * value)} mm"
    return f"{number(value)} {unit}".rstrip()


def _deadline_tiles(content: Content, given: Mapping[str, Any]) -> list[Tile]:
    success, misses = given["success_rate"], given["misses"]
    worst = success["worst_window"]
    window = "fewer than 100 ticks" if worst is None else f"worst 100: {number(100.0 * worst)} %"
    ticks = [f"n {count(given['ticks'])} ticks", window]
    late = deadline_words(given)
    if late is not None:
        ticks.append(f"in time: {late}")
    found: list[Tile] = [("word-success", "answers in time", rate(success["run"]), ticks)]
    if content.ticks is not None and content.ticks.stalls is not None:
        outside = rate(success["outside_stalls"])
        found.append(("word-stall", "outside stalls", outside, _stall_notes(content.ticks)))
    kinds = [f"late {count(misses['late'])}, lost {count(misses['lost'])}"]
    kinds.append(f"longest run {misses['longest_run']}; skipped {count(given['skipped'])}")
    missed = count(misses["late"] + misses["lost"])
    found.append(("word-outcome", "misses", missed, kinds))
    for key, anchor, name in (
        ("rtt_us", "word-rtt-word", "RTT"),
        ("wakeup_us", "word-wakeup-word", "wake-up"),
    ):
        sizes = given.get(key)
        if sizes and sizes["n"]:
            tail = f"p99 {number(sizes['p99'])}, p99.9 {number(sizes['p99_9'])}, "
            notes = [f"{tail}max {number(sizes['max'])} µs", f"n {count(sizes['n'])}"]
            found.append((anchor, f"{name}, median", f"{number(sizes['p50'])} µs", notes))
    if given.get("worst"):
        worst = given["worst"][0]
        notes = [f"tick {worst['tick']}, {worst['outcome']}"]
        notes += [f"attributed to {worst['guilty']}"] if worst["guilty"] else []
        found.append(("ticks", "longest RTT", f"{number(worst['rtt_us'])} µs", notes))
    return found


def _stall_notes(table: TickTable) -> list[str]:
    stalls = stall_figures(table.stalls_of_motion or [])
    misses = table.misses_outside_stalls or 0
    outside = f"n {count(table.count(IN_TIME) + misses)}, missed or skipped {count(misses)}"
    notes = [outside, f"{count(stalls['n'])} stalls, {number(stalls['total_ms'])} ms"]
    return [*notes, told] if (told := limited(stalls)) else notes


def _machine_facts(content: Content, log: Log) -> tuple[str, list[tuple[str, str]], str]:
    """Side of a log, its machine block and versions, and its settings."""
    machine, versions = content.machine(log.side), log.metadata.get("versions", {})
    measures = content.sources.summary.get("realtime") if log.side == "robot" else None
    rows = [(k.replace("_", " "), _plain(v)) for k, v in machine.items() if k != "versions"]
    if measures:
        rows.append(("real-time measures", _plain(measures)))
    if versions:
        rows.append(("versions", ", ".join(f"{k} {v}" for k, v in versions.items())))
    rows.append(("log", ", ".join(str(path) for path in log.paths)))
    rows += [(k, v) for k, v in log.metadata.get("run", {}).items() if v]
    try:
        settings = str(log.config).rstrip()
    except LogError as error:
        settings = str(error)
    return log.side, rows, settings


def _plain(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, list):
        return ", ".join(map(_plain, value)) or "none"
    return value if isinstance(value, str) else json.dumps(value)
