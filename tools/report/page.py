"""Composes the page of a report: rows of its tables; the words around them are in the template."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from markupsafe import Markup

from hoap3.tools.html.document import PAGES, POLICY
from hoap3.tools.html.numbers import NAMES as PERCENTILES
from hoap3.tools.html.numbers import count, number, seconds, summary
from hoap3.tools.machine.stalls import Stall
from hoap3.tools.report.content import Content
from hoap3.tools.report.facts import machine_facts, tiles
from hoap3.tools.report.happenings import MOST
from hoap3.tools.report.timing import Timing
from hoap3.tools.show.verdicts import NAMES, in_words
from hoap3.tools.timing.ticks import STAGES

__all__ = ["POLICY", "SECTIONS", "page"]

SECTIONS = {
    "motion": "Motion",
    "certificates": "Certificates",
    "checked": "Checked",
    "conditions": "Conditions",
    "time": "Deadlines and time",
    "ticks": "Worst ticks",
    "events": "Events",
    "stalls": "Stalls of the host",
    "machine": "Machine and settings",
    "words": "Words",
}
Row = list[object]


def page(content: Content) -> str:
    """The whole file."""
    timing, duration = content.timing, content.duration_s
    length = "" if duration is None else f"{duration:.1f} s of motion"
    words = in_words(content.judged)
    given: dict[str, Any] = {}
    if timing is not None and not timing.table.lockstep:
        given = {"worst_ticks": _worst(timing), "duration_rows": _durations(timing)}
    if timing is not None and timing.table.stalls:
        given["stalls"] = _stalls(timing, timing.table.stalls)
    return PAGES.get_template("report/templates/page.html").render(
        given,
        kind="report",
        title=f"{content.robot} · {content.controller}",
        sections=SECTIONS,
        content=content,
        verdicts=[
            (name, content.judged["verdicts"][key], words[key]) for key, name in NAMES.items()
        ],
        facts=[length, content.transport, content.date, content.sources.path],
        tiles=tiles(content),
        shares=_shares,
        certificate_rows=_certificates(content),
        event_rows=_events(content),
        machines=[machine_facts(content, log) for log in content.sources.logs],
    )


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


def _worst(timing: Timing) -> tuple[list[str], list[Row]]:
    """Stages that took any time in the worst ticks, and the rows of these."""
    worst = timing.figures["worst"]
    names = [n for n in (*STAGES, "unaccounted") if any(row["stages_us"].get(n) for row in worst)]
    usual = {name: summary(timing.us(name)).get("p50", 0.0) for name in names}
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


def _durations(timing: Timing) -> tuple[list[str], list[Row]]:
    """Names of the percentiles, and a row for each stage."""
    sizes = {"RTT": timing.figures["rtt_us"], **timing.figures["stages_us"]}
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
    for item in content.happenings[:MOST]:
        timed = motion is not None and item.side == motion.side
        at = seconds((item.stamp - motion.start_ns) / 1e9) if motion and timed else "–"
        what = [item.side, item.name, item.detail or "–"]
        rows.append([*what, count(item.times), item.tick, at])
    return rows


def _stalls(timing: Timing, stalls: list[Stall]) -> dict[str, Any]:
    """Lengths of those during the motion and of all [ms], and the ten longest."""
    every, meanwhile = ([s.end - s.start for s in each] for each in (stalls, timing.stalls))
    longest = sorted(stalls, key=lambda stall: stall.start - stall.end)[:10]
    return {
        "meanwhile": {"n": len(meanwhile), "total_ms": sum(meanwhile) / 1e6},
        "all": {"total_ms": sum(every) / 1e6, **summary(np.array(every) / 1e6)},
        "longest": [
            [seconds((s.start - timing.start_ns) / 1e9), number((s.end - s.start) / 1e6)]
            for s in longest
        ],
    }
