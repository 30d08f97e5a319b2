"""Where the time went: round trips and wake-ups, and the stages of the round trip over time."""

from __future__ import annotations

import numpy as np

from hoap3.protocol.messages import FloatArray
from hoap3.protocol.runtime.deadlines import FIT, WARN, WINDOW
from hoap3.tools.html.canvas import BUCKETS, canvas, thin
from hoap3.tools.html.drawing import Drawing, Key
from hoap3.tools.html.numbers import count, number, spread, summary
from hoap3.tools.html.palette import LIGHT
from hoap3.tools.report.timing import Timing
from hoap3.tools.timing.ticks import LATE, LOST, SKIPPED, STAGES

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
PER_WINDOW = 200  # ticks, so that a p99 rests on two of them
MOST_WINDOWS = 100
BINS = 90
MOST_STALLS = 500  # that are drawn, the longest


def timing_drawings(timing: Timing) -> list[Drawing]:
    """Every figure that this run has the data for: in lockstep there are no durations."""
    if timing.table.lockstep:
        return [_success(timing)]
    drawings = [_deadlines(timing), _success(timing), _rtt(timing), _wakeup(timing)]
    if any(np.isfinite(timing.us(name)).any() for name in STAGES[2:]):
        drawings += [_typical(timing), _tail(timing)]
    return drawings


def _deadlines(timing: Timing) -> Drawing:
    table, seconds = timing.table, timing.seconds
    period_us = table.period / 1e3
    rtt = timing.us("rtt")
    middles, windows = _windows(seconds, rtt)
    missed = {
        "late": (LATE, "orange"),
        "lost": (LOST, "red"),
        "skipped": (SKIPPED, "violet"),
    }
    with canvas("deadlines", 275) as drawing:
        axes = drawing.axes
        longest = sorted(timing.stalls, key=lambda stall: stall.start - stall.end)
        for stall in longest[:MOST_STALLS]:
            begin, end = ((at - timing.start_ns) / 1e9 for at in (stall.start, stall.end))
            axes.axvspan(begin, end, color=LIGHT["faint"], alpha=0.5, linewidth=0.5)
        greatest, median = ([_of(w, share) for w in windows] for share in (100.0, 50.0))
        axes.fill_between(middles, median, greatest, color=LIGHT["blue"], alpha=0.18, linewidth=0)
        axes.plot(middles, median, color=LIGHT["blue"])
        axes.axhline(period_us, color=LIGHT["ink"], linewidth=1.0, dashes=(4, 3))
        drawing.log_scale("y", numbers=True)
        low, high = axes.get_ylim()
        high = max(high, 1.6 * period_us)
        for row, (outcome, role) in enumerate(missed.values()):
            at = _apart(seconds[table.outcome == outcome], timing.duration_s)
            level = high * (high / low) ** (0.05 * (row + 1))
            axes.plot(at, np.full(len(at), level), "|", color=LIGHT[role], markersize=7)
        axes.set_ylim(low, high * (high / low) ** 0.2)
        drawing.time(timing.duration_s, "RTT [µs], logarithmic")
    counts = {name: table.count(outcome) for name, (outcome, _) in missed.items()}
    keys = [
        Key("blue", f"median of {len(seconds) // max(len(windows), 1)} ticks"),
        Key("blue", "up to the longest of them", "area"),
        Key("ink", f"period T = {number(period_us)} µs", "dash"),
        *(Key(role, f"{name} {count(counts[name])}", "tick") for name, (_, role) in missed.items()),
    ]
    if table.stalls is not None:
        some = f": the {MOST_STALLS} longest" if len(timing.stalls) > MOST_STALLS else ""
        keys.append(Key("faint", f"the host took the CPU away{some}", "area"))
    misses = sum(counts.values())
    return Drawing(
        "deadlines",
        "Every answer came in time"
        if not misses
        else f"{count(misses)} ticks without an answer in time",
        drawing.svg,
        tuple(keys),
        f"RTT: {spread(summary(rtt), 'µs')}",
        "RTT: from the publication of State k to the arrival of its answer, on the robot's clock. "
        "The deadline is the intended start of the next tick, so an answer may be late although "
        "its RTT is below T: then the robot itself woke late.",
        "Marks in bursts: something else had the CPU. Marks evenly spread, at a fixed distance: "
        "something periodic. Marks only where it is grey: the host, not this software.",
    )


def _success(timing: Timing) -> Drawing:
    asked = timing.table.asked
    first = min(WINDOW, timing.asked) - 1  # before, there is no full window
    recent = 100.0 * timing.recent()[first:]
    seconds = timing.seconds[asked][first:]
    with canvas("success", 275) as drawing:
        for rate, role in ((FIT, "green"), (WARN, "red")):
            drawing.axes.axhline(100.0 * rate, color=LIGHT[role], linewidth=1.0, dashes=(4, 3))
        drawing.axes.plot(*thin(seconds, recent), color=LIGHT["blue"])
        least = min(float(recent.min()), 100.0 * WARN)
        drawing.axes.set_ylim(max(least - 0.15 * (100.0 - least), -2.0), 101.0)
        drawing.time(timing.duration_s, f"answers in time [% of the last {WINDOW}]")
    low = number(float(recent.min()))
    return Drawing(
        "success",
        f"Any {WINDOW} ticks in a row: at least {low} % in time",
        drawing.svg,
        (
            Key("blue", f"of the last {WINDOW} ticks that asked"),
            Key("green", "fit from here on", "dash"),
            Key("red", "unfit below", "dash"),
        ),
        f"{spread(summary(recent), '%')}",
        "Success rate of the last 100 ticks that asked, as the robot publishes it in each State. "
        "The lines are those of the verdict, which is of the run as a whole.",
        "Deep, narrow notches: bursts of misses, one cause each. A level below 100 % throughout: "
        "the controller, or the link, is too slow for this period.",
    )


def _apart(times: FloatArray, duration_s: float) -> FloatArray:
    """As many of these times as can be told apart in a figure."""
    _, first = np.unique((times * (BUCKETS / duration_s)).astype(int), return_index=True)
    return times[first]


def _rtt(timing: Timing) -> Drawing:
    rtt = timing.us("rtt")
    svg, keys = _histogram("rtt", rtt, timing.table.period / 1e3, "RTT [µs], logarithmic")
    figures = summary(rtt)
    return Drawing(
        "rtt",
        _most(figures, "of the answers are back within"),
        svg,
        keys,
        spread(figures, "µs"),
        "How often each RTT occurred, both axes logarithmic so that one bad tick among "
        "millions can be seen. Lost answers have no RTT and are not in it.",
        "A second hill to the right: a second cause, such as another CPU or a busy neighbour. A "
        "tail that reaches the dashed line.",
    )


def _wakeup(timing: Timing) -> Drawing:
    wakeup = timing.us("wakeup")
    name = "wake-up latency [µs], logarithmic"
    svg, keys = _histogram("wakeup", wakeup, timing.table.period / 1e3, name)
    figures = summary(wakeup)
    jitter = timing.figures["jitter_us"]
    text = spread(figures, "µs")
    if "std" in jitter:
        text += (
            f" · jitter: n {count(jitter['n'])}, std {number(jitter['std'])}, "
            f"p99.9 − p50 {number(jitter['p99_9_minus_p50'])}, max {number(jitter['max'])} µs"
        )
    return Drawing(
        "wakeup",
        _most(figures, "of the ticks begin within"),
        svg,
        keys,
        text,
        "How late the robot's loop woke, after the intended start of the tick. Jitter is the "
        "deviation of the time between two wake-ups from T.",
        "A wide hill: no real-time priority, or a CPU that sleeps deeply. Single ticks far to the "
        "right: stalls of the host, or a neighbour.",
    )


def _typical(timing: Timing) -> Drawing:
    middles, shown = _stages(timing, 50.0)
    with canvas("typical") as drawing:
        heights = [np.nan_to_num(values) for values in shown.values()]
        colours = [LIGHT[STAGE_ROLES[name]] for name in shown]
        drawing.axes.stackplot(middles, heights, colors=colours, linewidth=0.0, alpha=0.85)
        drawing.time(timing.duration_s, "medians, one upon the other [µs]")
    medians = {name: summary(timing.us(name)) for name in shown}
    longest = max(medians, key=lambda name: medians[name]["p50"])
    return Drawing(
        "typical",
        f"Usually most of the time goes into {longest}",
        drawing.svg,
        _stage_keys(shown),
        _stage_text(medians, "p50"),
        "Median of each stage, window by window. Medians do not add up exactly, so the top is "
        "about the median of the whole, from the intended start to the arrival.",
        "A layer that swells or steps: a stage became slower while it ran.",
    )


def _tail(timing: Timing) -> Drawing:
    middles, shown = _stages(timing, 99.0)
    with canvas("tail") as drawing:
        for name, values in shown.items():
            drawing.axes.plot(middles, values, color=LIGHT[STAGE_ROLES[name]], linewidth=1.3)
        drawing.log_scale("y", numbers=True)
        drawing.time(timing.duration_s, "p99 [µs], logarithmic")
    tails = {name: summary(timing.us(name)) for name in shown}
    longest = max(tails, key=lambda name: tails[name]["p99"])
    return Drawing(
        "tail",
        f"In the slowest hundredth it goes into {longest}",
        drawing.svg,
        _stage_keys(shown),
        _stage_text(tails, "p99"),
        "99th percentile of each stage, window by window, each line for itself.",
        "A peak of one line alone: that stage is to blame. Peaks of all at once: the CPU was away.",
    )


def _stages(timing: Timing, share: float) -> tuple[FloatArray, dict[str, FloatArray]]:
    """Middle of each window, and a percentile of each known stage in it."""
    shown: dict[str, FloatArray] = {}
    middles = np.empty(0)
    for name in STAGES:
        values = timing.us(name)
        if np.isfinite(values).any():
            middles, windows = _windows(timing.seconds, values)
            shown[name] = np.array([_of(window, share) for window in windows])
    return middles, shown


def _stage_keys(shown: dict[str, FloatArray]) -> tuple[Key, ...]:
    drawn = [name for name, values in shown.items() if np.nanmax(values) > 0.0]
    return tuple(Key(STAGE_ROLES[name], name, "area") for name in drawn)


def _stage_text(figures: dict[str, dict[str, float]], key: str) -> str:
    least = min(int(each["n"]) for each in figures.values())
    parts = [f"{name} {number(each[key])}" for name, each in figures.items()]
    return f"n ≥ {count(least)} · {key} of the run: {', '.join(parts)} µs"


def _windows(seconds: FloatArray, values: FloatArray) -> tuple[FloatArray, list[FloatArray]]:
    """Middles [s] and values of windows of equally many ticks."""
    parts = int(np.clip(len(values) // PER_WINDOW, 1, MOST_WINDOWS))
    middles = [float(part.mean()) for part in np.array_split(seconds, parts)]
    return np.array(middles), list(np.array_split(values, parts))


def _of(window: FloatArray, share: float) -> float:
    known = window[np.isfinite(window)]
    return float(np.percentile(known, share)) if len(known) else np.nan


def _histogram(
    name: str, values: FloatArray, period_us: float, label: str
) -> tuple[str, tuple[Key, ...]]:
    known = values[np.isfinite(values)]
    figures = summary(known)
    top = max(float(known.max(initial=0.0)), 1.3 * period_us)
    floor = max(float(known.min(initial=top)), 0.1)
    edges = np.geomspace(0.8 * floor, 1.2 * top, BINS + 1)
    marks = {"p50": "green", "p99": "orange", "p99_9": "red"}
    with canvas(name) as drawing:
        heights, _ = np.histogram(np.clip(known, edges[0], None), edges)
        look = {"color": LIGHT["blue"], "alpha": 0.75}
        drawing.axes.stairs(heights, edges, baseline=0.5, fill=True, **look)
        drawing.log_scale("x", numbers=True)
        drawing.log_scale("y", numbers=True)
        drawing.axes.set_ylim(0.5, 2.0 * max(heights.max(initial=1), 2))
        for key, role in marks.items():
            if key in figures:
                drawing.axes.axvline(figures[key], color=LIGHT[role], linewidth=1.4)
        drawing.axes.axvline(period_us, color=LIGHT["ink"], linewidth=1.0, dashes=(4, 3))
        drawing.axes.set_xlim(edges[0], edges[-1])
        drawing.label(label, "ticks, logarithmic")
    keys = [
        Key(role, f"{key.replace('_', '.')} {number(figures[key])} µs")
        for key, role in marks.items()
        if key in figures
    ]
    period = Key("ink", f"period T = {number(period_us)} µs", "dash")
    return drawing.svg, (Key("blue", "ticks", "area"), *keys, period)


def _most(figures: dict[str, float], what: str) -> str:
    if not figures["n"]:
        return "Nothing to measure"
    return f"99 % {what} {number(figures['p99'])} µs"
