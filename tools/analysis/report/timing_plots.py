"""Where the time went: round trips and wake-ups, and the stages of the round trip over time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hoap3.protocol.messages import FloatArray
from hoap3.protocol.runtime.deadlines import WINDOW
from hoap3.tools.analysis.canvas import BUCKETS, Drawing, Key, canvas
from hoap3.tools.analysis.deadline_verdict import FAIL_WINDOW, PASS_WINDOW
from hoap3.tools.analysis.numbers import NAMES, count, number, spread, summary
from hoap3.tools.analysis.tick_metrics import jitter, recent_rates
from hoap3.tools.analysis.ticks import LATE, LOST, SKIPPED, STAGES, TickTable
from hoap3.tools.picture.palette import LIGHT

STAGE_ROLES = {
    "wakeup": "olive",
    "publish": "brown",
    "wait": "red",
    "decode": "cyan",
    "kinematics": "green",
    "solve": "orange",
    "encode": "pink",
    "send": "violet",
    "network": "blue",
}
MISSED = {"late": (LATE, "orange"), "lost": (LOST, "red"), "skipped": (SKIPPED, "violet")}
PER_WINDOW = 200  # ticks, so that a p99 rests on two of them
MOST_WINDOWS = 100
BINS = 90
MOST_STALLS = 500  # that are drawn, the longest


def timing_drawings(table: TickTable) -> list[Drawing]:
    """Every figure that this run has the data for: in lockstep there are no durations."""
    if table.lockstep:
        return [_success(table)]
    rtt = _histogram(table, "rtt", "RTT [µs], logarithmic", "of the answers are back within")
    drawings = [_deadlines(table), _success(table), rtt, _wakeup(table)]
    if any(np.isfinite(table.us(name)).any() for name in STAGES[2:]):
        drawings += [_stages(table, name) for name in ("typical", "tail")]
    return drawings


def _deadlines(table: TickTable) -> Drawing:
    seconds, rtt, due_us = table.seconds, table.us("rtt"), table.due / 1e3
    middles, windows = _windows(seconds, rtt)
    with canvas("deadlines", 275) as drawing:
        axes = drawing.axes
        stalls = table.stalls_of_motion or []
        longest = sorted(stalls, key=lambda stall: stall.start - stall.end)
        for stall in longest[:MOST_STALLS]:
            begin, end = ((at - table.start_ns) / 1e9 for at in (stall.start, stall.end))
            axes.axvspan(begin, end, color=LIGHT["faint"], alpha=0.5, linewidth=0.5)
        greatest, median = ([_of(w, share) for w in windows] for share in (100.0, 50.0))
        axes.fill_between(middles, median, greatest, color=LIGHT["blue"], alpha=0.18, linewidth=0)
        axes.plot(middles, median, color=LIGHT["blue"])
        drawing.threshold(due_us, "ink")
        drawing.log_scale("y", numbers=True)
        low, high = axes.get_ylim()
        high = max(high, 1.6 * due_us)
        for row, (outcome, role) in enumerate(MISSED.values()):
            at = _apart(seconds[table.outcome == outcome], table.duration_s)
            level = high * (high / low) ** (0.05 * (row + 1))
            axes.plot(at, np.full(len(at), level), "|", color=LIGHT[role], markersize=7)
        axes.set_ylim(low, high * (high / low) ** 0.2)
        drawing.time(table.duration_s, "RTT [µs], logarithmic")
    keys = [
        Key("blue", f"median of {len(seconds) // max(len(windows), 1)} ticks"),
        Key("blue", "up to the longest of them", "area"),
        _due_key(table),
    ]
    misses = 0
    for name, (outcome, role) in MISSED.items():
        misses += table.count(outcome)
        keys.append(Key(role, f"{name} {count(table.count(outcome))}", "tick"))
    if table.stalls is not None:
        some = f": the {MOST_STALLS} longest" if len(stalls) > MOST_STALLS else ""
        keys.append(Key("faint", f"host stall{some}", "area"))
    title = f"{count(misses)} ticks without an answer in time"
    title = title if misses else "All answers arrived in time"
    return Drawing("deadlines", title, drawing.svg, tuple(keys), f"RTT: {_spread_us(rtt)}")


def _success(table: TickTable) -> Drawing:
    rates = recent_rates(table)
    first = min(WINDOW, len(rates)) - 1  # before, there is no full window
    recent = 100.0 * rates[first:]
    with canvas("success", 275) as drawing:
        drawing.threshold(100.0 * PASS_WINDOW, "green")
        drawing.threshold(100.0 * FAIL_WINDOW, "red")
        drawing.line(table.seconds[table.asked][first:], recent, "blue")
        least = min(float(recent.min()), 100.0 * FAIL_WINDOW)
        drawing.axes.set_ylim(max(least - 0.15 * (100.0 - least), -2.0), 101.0)
        drawing.time(table.duration_s, f"answers in time [% of the last {WINDOW}]")
    title = f"Any {WINDOW} ticks in a row: at least {number(float(recent.min()))} % in time"
    lines = (Key("green", "pass from here on", "dash"), Key("red", "fail below", "dash"))
    keys = (Key("blue", f"of the last {WINDOW} ticks that asked"), *lines)
    return Drawing("success", title, drawing.svg, keys, spread(summary(recent), "%"))


def _apart(times: FloatArray, duration_s: float) -> FloatArray:
    """As many of these times as can be told apart in a figure."""
    _, first = np.unique((times * (BUCKETS / duration_s)).astype(int), return_index=True)
    return times[first]


def _wakeup(table: TickTable) -> Drawing:
    label = "wake-up latency [µs], logarithmic"
    drawing = _histogram(table, "wakeup", label, "of the ticks begin within")
    found = jitter([table])
    if "std" not in found:
        return drawing
    text = (
        f"{drawing.figures} · jitter: n {count(found['n'])}, std {number(found['std'])}, "
        f"p99.9 − p50 {number(found['p99_9_minus_p50'])}, max {number(found['max'])} µs"
    )
    return replace(drawing, figures=text)


def _stages(table: TickTable, name: str) -> Drawing:
    """Stages of ticks, window by window: stacked medians ("typical"), or lines of p99 ("tail")."""
    stacked = name == "typical"
    share, key = (50.0, "p50") if stacked else (99.0, "p99")
    shown: dict[str, FloatArray] = {}
    middles = np.empty(0)
    for stage in STAGES:
        values = table.us(stage)
        if np.isfinite(values).any():
            middles, windows = _windows(table.seconds, values)
            shown[stage] = np.array([_of(window, share) for window in windows])
    with canvas(name) as drawing:
        if stacked:
            heights = [np.nan_to_num(values) for values in shown.values()]
            colours = [LIGHT[STAGE_ROLES[stage]] for stage in shown]
            drawing.axes.stackplot(middles, heights, colors=colours, linewidth=0.0, alpha=0.85)
            drawing.time(table.duration_s, "medians, one upon the other [µs]")
        else:
            for stage, values in shown.items():
                look = {"color": LIGHT[STAGE_ROLES[stage]], "linewidth": 1.3}
                drawing.axes.plot(middles, values, **look)
            drawing.log_scale("y", numbers=True)
            drawing.time(table.duration_s, "p99 [µs], logarithmic")
    figures = {stage: summary(table.us(stage)) for stage in shown}
    longest = max(figures, key=lambda stage: figures[stage][key])
    least = min(int(each["n"]) for each in figures.values())
    parts = ", ".join(f"{stage} {number(each[key])}" for stage, each in figures.items())
    text = f"n ≥ {count(least)} · {key} of the run: {parts} µs"
    drawn = [stage for stage, values in shown.items() if np.nanmax(values) > 0.0]
    keys = tuple(Key(STAGE_ROLES[stage], stage, "area") for stage in drawn)
    which = "Median" if stacked else "99th percentile"
    title = f"{which} of each stage: {longest} is longest"
    return Drawing(name, title, drawing.svg, keys, text)


def _windows(seconds: FloatArray, values: FloatArray) -> tuple[FloatArray, list[FloatArray]]:
    """Middles [s] and values of windows of equally many ticks."""
    parts = int(np.clip(len(values) // PER_WINDOW, 1, MOST_WINDOWS))
    middles = [float(part.mean()) for part in np.array_split(seconds, parts)]
    return np.array(middles), list(np.array_split(values, parts))


def _of(window: FloatArray, share: float) -> float:
    known = window[np.isfinite(window)]
    return float(np.percentile(known, share)) if len(known) else np.nan


def _histogram(table: TickTable, name: str, label: str, what: str) -> Drawing:
    """How often each length of a stage occurred, both axes logarithmic."""
    line_us = (table.due if name == "rtt" else table.period) / 1e3
    values = table.us(name)
    known = values[np.isfinite(values)]
    figures = summary(known)
    top = max(float(known.max(initial=0.0)), 1.3 * line_us)
    floor = max(float(known.min(initial=top)), 0.1)
    edges = np.geomspace(0.8 * floor, 1.2 * top, BINS + 1)
    keys = [Key("blue", "ticks", "area")]
    with canvas(name) as drawing:
        heights, _ = np.histogram(np.clip(known, edges[0], None), edges)
        look = {"color": LIGHT["blue"], "alpha": 0.75}
        drawing.axes.stairs(heights, edges, baseline=0.5, fill=True, **look)
        drawing.log_scale("x", numbers=True)
        drawing.log_scale("y", numbers=True)
        drawing.axes.set_ylim(0.5, 2.0 * max(heights.max(initial=1), 2))
        for key, role in (("p50", "green"), ("p99", "orange"), ("p99_9", "red")):
            if key in figures:
                drawing.axes.axvline(figures[key], color=LIGHT[role], linewidth=1.4)
                keys.append(Key(role, f"{NAMES[key]} {number(figures[key])} µs"))
        drawing.threshold(line_us, "ink", "x")
        drawing.axes.set_xlim(edges[0], edges[-1])
        drawing.label(label, "ticks, logarithmic")
    title = f"99 % {what} {number(figures['p99'])} µs" if figures["n"] else "Nothing to measure"
    keys.append(_due_key(table) if name == "rtt" else _period_key(line_us))
    return Drawing(name, title, drawing.svg, tuple(keys), _spread_us(known))


def _period_key(period_us: float) -> Key:
    return Key("ink", f"period T = {number(period_us)} µs", "dash")


def _due_key(table: TickTable) -> Key:
    """The time that an answer has: a period, unless the robot delays answers."""
    if table.due == table.period:
        return _period_key(table.period / 1e3)
    periods = table.due // table.period
    return Key("ink", f"an answer has {periods} periods = {number(table.due / 1e3)} µs", "dash")


def _spread_us(values: FloatArray) -> str:
    return spread(summary(values), "µs")
