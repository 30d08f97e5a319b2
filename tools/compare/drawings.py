"""The plots of a comparison: one colour for each controller, over one axis of time."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from hoap3.protocol.messages import FloatArray
from hoap3.remote_controller.controllers.base import STATUS
from hoap3.tools.compare.comparison import Comparison
from hoap3.tools.compare.series import SPEED, Series
from hoap3.tools.compare.words import OF_TASK, unit
from hoap3.tools.html.canvas import Canvas, canvas, thin
from hoap3.tools.html.drawing import Drawing, Key
from hoap3.tools.html.numbers import count, number
from hoap3.tools.html.palette import LIGHT
from hoap3.tools.html.palette import SERIES as FIRST_ROLES
from hoap3.tools.report.plots.motion_plots import means, positive

ROLES = (*(role for role in FIRST_ROLES if role != "red"), "pink", "brown")
"""Colours of controllers; red stays for what is wrong."""

THINNEST, STEP = 1.2, 1.6  # width of the last curve, and how much wider each one below it is
STRETCHES = 400  # that can be told apart across a figure


def role(place: int) -> str:
    """Colour of a controller."""
    return ROLES[place % len(ROLES)]


def drawings(made: Comparison) -> list[Drawing]:
    """Every figure that there is data for."""
    found = []
    if any(np.isfinite(each.lyapunov).any() for each in made.series):
        found += [_error(made), _lyapunov(made)]
    if any(each.active is not None and len(each) for each in made.series):
        found += [_active(made), _switching(made)]
    if any(len(each) for each in made.series):
        found += [_control_effort(made), _certificates(made)]
    return found


def _error(made: Comparison) -> Drawing:
    label = f"√(2V) [{unit(OF_TASK, made)}], logarithmic"
    titles = "The error of each controller", "The error at the States of the log"
    return _falling(made, "error", titles, lambda each: each.error, label)


def _lyapunov(made: Comparison) -> Drawing:
    unlike = [each["v_difference"] for each in made.figures]
    known = [each for each in unlike if each is not None]
    title = "V of each controller"
    if known:
        title = f"V differs by at most {number(100.0 * max(known))} % of its start"
    titles = title, "V at the States of the log"
    return _falling(made, "v", titles, lambda each: each.lyapunov, "V [squared unit], logarithmic")


def _active(made: Comparison) -> Drawing:
    highest = 1.0
    with canvas("active") as drawing:
        for place, each in enumerate(made.series):
            if each.active is not None and len(each):
                time, mean, _ = means(each.time_s, each.active)
                drawing.axes.plot(time, mean, **_look(made, place))
                highest = max(highest, float(mean.max()))
        drawing.axes.set_ylim(0.0, 1.15 * highest)
        drawing.axes.yaxis.get_major_locator().set_params(integer=True)
        _time(drawing, made, f"joints with |u| ≥ 0.001 {SPEED}")
    mean_of = _each(made, [found["active_joints"]["mean"] for found in made.figures])
    title = f"Joints at work, of {made.facts['joints']}"
    return Drawing("active", title, drawing.svg, _keys(made), f"mean: {mean_of}")


def _switching(made: Comparison) -> Drawing:
    sums = [None if each.switched is None else np.cumsum(each.switched) for each in made.series]
    svg = _rising(made, "switching", sums, "times that a joint went on or off")
    rates = _each(made, [found["switching_per_s"] for found in made.figures])
    title = "Joints that go on and off, from the start on"
    return Drawing("switching", title, svg, _keys(made), f"per second: {rates}")


def _control_effort(made: Comparison) -> Drawing:
    sums = [np.cumsum(each.control_effort) * each.period_s for each in made.series]
    svg = _rising(made, "control_effort", sums, f"∫ |u|₁ dt [{unit('u·s', made)}]")
    ends = _each(made, [found["control_effort"]["l1"] for found in made.figures])
    return Drawing(
        "control_effort",
        "Control effort, from the start on",
        svg,
        _keys(made),
        f"at the end: {ends}",
    )


def _certificates(made: Comparison) -> Drawing:
    n = len(made.series)
    with canvas("certificates") as drawing:
        axes = drawing.axes
        for place, each in enumerate(made.series):
            at, colour = n - place, LIGHT[role(place)]
            if each.proved.any():
                ends = each.time_s[each.proved][[0, -1]]
                axes.plot(ends, [at, at], color=colour, linewidth=1.6)
            for status, shown, height in (
                ("uncertified", colour, 0.28),
                ("infeasible", LIGHT["red"], 0.4),
            ):
                for bar in _stretches(each, STATUS[status], made.facts["duration_s"]):
                    low, high = at - height, at + height
                    axes.fill_between(bar, low, high, facecolor=shown, linewidth=0.0)
        axes.set_ylim(0.4, n + 0.6)
        axes.set_yticks(range(1, n + 1), [str(n + 1 - at) for at in range(1, n + 1)])
        _time(drawing, made, "controller, in the order of the legend")
    bad = [int(each.unproved.sum()) for each in made.series]
    title = "Every answer has its certificate"
    if sum(bad):
        title = f"{count(sum(bad))} answers lack a certificate that holds"
    elif any(found["certificates"]["none"] for found in made.figures):
        title = "Every certificate that is given holds"
    keys = [Key(key.role, f"{place}: {key.text}") for place, key in enumerate(_keys(made), 1)]
    for status, colour in (("uncertified", "soft"), ("infeasible", "red")):
        if any((each.status == STATUS[status]).any() for each in made.series):
            keys.append(Key(colour, status, "area"))
    figures = f"uncertified or infeasible: {_each(made, bad)}"
    return Drawing("certificates", title, drawing.svg, tuple(keys), figures)


def _stretches(each: Series, status: int, duration_s: float) -> list[tuple[float, float]]:
    """Begin and end [s] of what has this status, together where no gap could be seen."""
    times = each.time_s[each.status == status]
    if not len(times):
        return []
    visible = max(duration_s / STRETCHES, each.period_s)
    gaps = np.flatnonzero(np.diff(times) > 1.5 * visible)
    begins = np.concatenate([times[:1], times[gaps + 1]])
    ends = np.concatenate([times[gaps], times[-1:]])
    return [(float(a), float(max(b, a) + visible)) for a, b in zip(begins, ends, strict=True)]


def _falling(
    made: Comparison,
    name: str,
    titles: tuple[str, str],
    values: Callable[[Series], FloatArray],
    label: str,
) -> Drawing:
    """What falls towards zero, on a logarithmic axis; `titles` of a closed loop, and an open."""
    last: list[float | None] = []
    with canvas(name) as drawing:
        for place, each in enumerate(made.series):
            drawing.axes.plot(*thin(each.time_s, values(each)), **_look(made, place))
            known = values(each)[np.isfinite(values(each))]
            last.append(float(known[-1]) if len(known) else None)
        _time(drawing, made, label)
        together = np.concatenate([values(each) for each in made.series])
        positive(drawing, together[np.isfinite(together)])
    title = titles[0] if made.closed_loop else titles[1]
    return Drawing(name, title, drawing.svg, _keys(made), f"at the end: {_each(made, last)}")


def _rising(made: Comparison, name: str, sums: Sequence[FloatArray | None], label: str) -> str:
    """The drawing of what adds up from the start on."""
    with canvas(name) as drawing:
        for place, (each, total) in enumerate(zip(made.series, sums, strict=True)):
            if total is not None and len(each):
                drawing.axes.plot(*thin(each.time_s, total), **_look(made, place))
        drawing.axes.set_ylim(bottom=0.0)
        _time(drawing, made, label)
    return drawing.svg


def _look(made: Comparison, place: int) -> dict[str, object]:
    """Colour and width: the earlier a curve, the wider, so that none hides another."""
    above = len(made.series) - 1 - place
    dashed = place >= len(ROLES)
    return {
        "color": LIGHT[role(place)],
        "linewidth": THINNEST + STEP * min(above, 6),
        "linestyle": "--" if dashed else "-",
    }


def _time(drawing: Canvas, made: Comparison, label: str) -> None:
    drawing.label("time since the first answer [s]", label)
    drawing.axes.set_xlim(0.0, made.facts["duration_s"])


def _keys(made: Comparison) -> tuple[Key, ...]:
    return tuple(
        Key(role(place), label, "dash" if place >= len(ROLES) else "line")
        for place, label in enumerate(made.labels)
    )


def _each(made: Comparison, values: Sequence[float | None]) -> str:
    """`a: 1 · b: 2`."""
    return " · ".join(
        f"{label}: {'–' if value is None else number(value)}"
        for label, value in zip(made.labels, values, strict=True)
    )
