"""Tables of a report: percentiles, worst ticks, who is to blame, conditions, events, stalls."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from hoap3.tools.html.markup import Markup, element, link, more, table
from hoap3.tools.html.numbers import NAMES, count, number, summary
from hoap3.tools.report.certificates import Certificates
from hoap3.tools.report.conditions import Condition
from hoap3.tools.report.content import Content
from hoap3.tools.report.happenings import MOST
from hoap3.tools.report.timing import Timing
from hoap3.tools.timing.ticks import STAGES


def ticks_section(timing: Timing | None, title: str) -> Markup:
    """Durations, the worst ten ticks stage by stage, and who is to blame for each miss."""
    parts: list[Markup] = [element("h2", title)]
    if timing is None:
        return element(
            "section", *parts, _said("There are no ticks to show, see above."), id="ticks"
        )
    if timing.table.lockstep:
        parts.append(_said("All time is virtual in lockstep: no tick is slower than another."))
    else:
        parts += [_worst(timing), _durations(timing)]
    parts += _guilty(timing)
    return element("section", *parts, id="ticks")


def _worst(timing: Timing) -> Markup:
    rows = timing.figures["worst"]
    names = (*STAGES, "unaccounted")
    stages = [name for name in names if any(row["stages_us"].get(name) for row in rows)]
    head = ["tick", "outcome", link("word-rtt-word", "RTT"), *stages]
    head += [link("word-stall", "stall"), link("word-guilty", "to blame")]
    usual = {name: summary(timing.us(name)).get("p50", 0.0) for name in stages}
    body = [
        [
            row["tick"],
            row["outcome"],
            number(row["rtt_us"]),
            *_stages(row["stages_us"], usual, stages),
            {None: "unknown", True: "yes", False: "no"}[row["stalled"]],
            row["guilty"] or "–",
        ]
        for row in rows
    ]
    n = int(np.isfinite(timing.us("rtt")).sum())
    note = f"The ten longest round trips of n {count(n)}, in µs. Bold is what exceeded its median "
    note += "most. Lost answers have no RTT."
    return element("div", _said(note), table(head, body, words=2))


def _stages(given: dict[str, float], usual: dict[str, float], names: list[str]) -> list[Any]:
    excess = {name: given[name] - usual[name] for name in names if name in given}
    most = max(excess, key=lambda name: excess[name], default=None)
    cells: list[Any] = []
    for name in names:
        shown = number(given[name]) if name in given else "–"
        cells.append(element("b", shown) if name == most else shown)
    return cells


def _durations(timing: Timing) -> Markup:
    figures = timing.figures
    sizes: dict[str, dict[str, float]] = {"RTT": figures["rtt_us"], **figures["stages_us"]}
    if not sizes["unaccounted"].get("max"):
        del sizes["unaccounted"]
    keys = ["min", *(key for key in NAMES if any(key in each for each in sizes.values())), "max"]
    head: list[object] = [link("word-stage", "µs"), link("word-percentile", "n")]
    head += [NAMES.get(key, key) for key in keys]
    body = [
        [name, count(int(each["n"])), *(number(each[k]) if k in each else "–" for k in keys)]
        for name, each in sizes.items()
    ]
    return element(
        "div",
        _said("Every duration of the run. The stages from wait to network make up the RTT."),
        table(head, body),
    )


def _guilty(timing: Timing) -> list[Markup]:
    counts = timing.figures["guilty"]
    if not counts:
        return [_said(f"None of n {count(timing.asked)} ticks was missed or skipped.")]
    total = sum(counts.values())
    rows = [[name, count(n), f"{100.0 * n / total:.1f} %"] for name, n in counts.items()]
    head = [link("word-guilty", "to blame"), "ticks", "share"]
    words = (
        f"Who is to blame for the {count(total)} ticks that were late, lost or skipped, "
        f"of n {count(len(timing.table))}."
    )
    return [element("div", _said(words), table(head, rows, class_="narrow"))]


def certificates_section(certificates: Certificates | None, title: str, *figures: Markup) -> Markup:
    """How many answers proved what, and where they did not."""
    heading = element("h2", title)
    if certificates is None:
        said = "No answer came with a certificate: nothing is known of what was proved."
        return element("section", heading, _said(said), id="certificates")
    total = certificates.n
    rows = [
        [name.replace("_", " "), count(n), f"{100.0 * n / total:.3f} %"]
        for name, n in certificates.counts.items()
    ]
    head: list[object] = [link("word-certificate", "answers"), "n", "share"]
    if certificates.reasons:
        head.append(link("conditions", "conditions meanwhile"))
        for row, name in zip(rows, certificates.counts, strict=True):
            why = certificates.reasons.get(name, {})
            row.append(", ".join(f"{each} {count(n)}" for each, n in why.items()) or "–")
    longest = certificates.longest
    words = f"Every one of n {count(total)} answers has been proved."
    if longest is not None:
        first = certificates.stretches[0]
        words = (
            f"{count(certificates.without)} of n {count(total)} answers came without a "
            f"certificate, in {count(len(certificates.stretches))} stretches. The first began at "
            f"{_at(first.begin_s)} s (tick {first.tick}), the longest at {_at(longest.begin_s)} s "
            f"(tick {longest.tick}): {count(longest.answers)} answers, until "
            f"{_at(longest.end_s)} s."
        )
    return element(
        "section",
        heading,
        _said(words) if longest is None else element("div", element("p", words), class_="gaps"),
        table(head, rows, class_="narrow"),
        element("div", *figures, class_="grid") if figures else "",
        id="certificates",
    )


def conditions_section(conditions: Sequence[Condition] | None, title: str) -> Markup:
    """What stood in the controller's way: how often, for how long, since when."""
    heading = element("h2", title)
    if not conditions:
        said = "No condition of the controller ever held."
        if conditions is None:
            said = "There is no log of the controller, which alone has its conditions."
        return element("section", heading, _said(said), id="conditions")
    rows = [
        [each.condition, count(each.times), count(each.ticks), each.first_tick, count(each.longest)]
        for each in conditions
    ]
    head = [link("word-condition", "condition"), "times", "ticks in all", "first tick", "longest"]
    said = "In ticks of the robot, also of those in which nobody asked for an answer."
    return element("section", heading, _said(said), table(head, rows), id="conditions")


def events_section(content: Content, title: str) -> Markup:
    """What happened, in words, side by side with its tick and time."""
    happenings = content.happenings
    main = content.motion.side if content.motion else ""
    start = content.motion.start_ns if content.motion else None
    head = ["side", "what", "detail", "times", "tick", "time [s]"]
    rows = [
        [
            item.side,
            item.name,
            item.detail or "–",
            count(item.times),
            item.tick,
            _seconds(item.stamp - start) if item.side == main and start is not None else "–",
        ]
        for item in happenings[:MOST]
    ]
    parts: list[Markup] = [element("h2", title)]
    if not rows:
        return element("section", *parts, _said("No event is in the log."), id="events")
    parts.append(table(head, rows, words=3))
    words = f"Times of the {main} count from the first tick that asked. " if main else ""
    words += "What comes by the hundred is one line, with the tick of the first one."
    if len(happenings) > MOST:
        words += f" {count(len(happenings) - MOST)} more are in the log."
    parts.append(_said(words))
    return element("section", *parts, id="events")


def stalls_section(timing: Timing | None, title: str) -> Markup:
    """When the host took a CPU away."""
    heading = element("h2", title)
    stalls = timing.table.stalls if timing else None
    if timing is None or stalls is None:
        said = "Nobody watched for stalls, so none can be told from load."
        if timing is not None and timing.table.lockstep:
            said = "All time is virtual in lockstep: nobody can take it away."
        return element("section", heading, _said(said), id="stalls")
    lengths = summary([(stall.end - stall.start) / 1e6 for stall in stalls])
    if not stalls:
        said = "A monitor watched, and the host never took the CPU away for more than 0.15 ms."
        return element("section", heading, _said(said), id="stalls")
    longest = sorted(stalls, key=lambda stall: stall.start - stall.end)[:10]
    rows = [
        [
            _seconds(stall.start - timing.start_ns),
            number((stall.end - stall.start) / 1e6),
        ]
        for stall in longest
    ]
    total = sum(stall.end - stall.start for stall in stalls) / 1e6
    meanwhile = timing.stalls
    moving = sum(stall.end - stall.start for stall in meanwhile) / 1e6
    words = (
        f"{count(len(meanwhile))} stalls, {number(moving)} ms together, from the first tick that "
        f"asked to the last. In the whole log n {count(len(stalls))}, {number(total)} ms; length "
        f"p50 {number(lengths['p50'])}, p90 {number(lengths['p90'])}, "
        f"p99 {number(lengths['p99'])}, max {number(lengths['max'])} ms."
    )
    inside = table(["begin [s]", "length [ms]"], rows, words=0, class_="narrow")
    return element("section", heading, _said(words), more("The ten longest", inside), id="stalls")


def _seconds(nanoseconds: int) -> str:
    return _at(nanoseconds / 1e9)


def _at(seconds: float) -> str:
    return f"{seconds:.3f}".replace("-", "−")


def _said(words: str) -> Markup:
    return element("p", words, class_="sub")
