"""The plots of a comparison: one colour for each controller, over one axis of time."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from hoap3.protocol.messages import FloatArray
from hoap3.remote_controller.controllers.base import STATUS
from hoap3.tools.compare.comparison import Comparison
from hoap3.tools.compare.series import SPEED, Series
from hoap3.tools.compare.words import unit
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
WIDE = "Earlier controllers are drawn wider, so that curves on one another can all be seen."


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
        found += [_effort(made), _certificates(made)]
    return found


def _error(made: Comparison) -> Drawing:
    svg = _falling(made, "error", lambda each: each.error, "√(2V) [unit of the task], logarithmic")
    ends = _ends(made, lambda each: each.error)
    title = "The error of each controller"
    return Drawing(
        "error",
        title if made.closed_loop else "The error at the States of the log",
        svg,
        _keys(made),
        f"at the end: {ends}",
        "√(2V) of each answer, as its certificate has it: for V = |e|²/2 the length of the error. "
        f"{WIDE}",
        "A plateau above zero: that controller stalls. Curves that begin apart: the controllers "
        "do not have the same task, so that neither their V nor their error can be compared.",
    )


def _lyapunov(made: Comparison) -> Drawing:
    svg = _falling(made, "v", lambda each: each.lyapunov, "V [squared unit], logarithmic")
    unlike = [each["v_difference"] for each in made.figures]
    known = [each for each in unlike if each is not None]
    title = "V of each controller"
    if known:
        title = f"V differs by at most {number(100.0 * max(known))} % of its start"
    return Drawing(
        "v",
        title if made.closed_loop else "V at the States of the log",
        svg,
        _keys(made),
        f"at the end: {_ends(made, lambda each: each.lyapunov)}",
        "Lyapunov function V of each answer. The difference is that to the first controller at the "
        f"same answer, compared with V at its start. {WIDE}",
        "A step up: a setpoint was clipped, or the robot does not do what the model says.",
    )


def _active(made: Comparison) -> Drawing:
    with canvas("active") as drawing:
        highest = 1.0
        for place, each in enumerate(made.series):
            if each.active is not None and len(each):
                time, mean, _ = means(each.time_s, each.active)
                drawing.axes.plot(time, mean, **_look(made, place))
                highest = max(highest, float(mean.max()))
        drawing.axes.set_ylim(0.0, 1.15 * highest)
        drawing.axes.yaxis.get_major_locator().set_params(integer=True)
        _time(drawing, made, f"joints with |u| ≥ 0.001 {SPEED}")
    mean_of = [found["active_joints"]["mean"] for found in made.figures]
    return Drawing(
        "active",
        f"Joints at work, of {made.facts['joints']}",
        drawing.svg,
        _keys(made),
        f"mean: {_each(made, mean_of)}",
        "Number of joints that are told to move at 0.001 rad/s or more, as a mean over 160 windows "
        f"of time. {WIDE}",
        "A mean between whole numbers: joints go on and off within a window; see switching in the "
        "table.",
    )


def _switching(made: Comparison) -> Drawing:
    with canvas("switching") as drawing:
        for place, each in enumerate(made.series):
            if each.switched is not None and len(each):
                points = thin(each.time_s, np.cumsum(each.switched))
                drawing.axes.plot(*points, **_look(made, place))
        drawing.axes.set_ylim(bottom=0.0)
        _time(drawing, made, "times that a joint went on or off")
    rates = [found["switching_per_s"] for found in made.figures]
    return Drawing(
        "switching",
        "Joints that go on and off, from the start on",
        drawing.svg,
        _keys(made),
        f"per second: {_each(made, rates)}",
        "How often any joint became active, at 0.001 rad/s or more, or stopped being so, up to "
        f"each answer. {WIDE}",
        "A straight, steep line: chattering. Choose a lower γ, or adaptive_gamma.",
    )


def _effort(made: Comparison) -> Drawing:
    with canvas("effort") as drawing:
        for place, each in enumerate(made.series):
            if len(each):
                total = np.cumsum(each.effort) * each.period_s
                drawing.axes.plot(*thin(each.time_s, total), **_look(made, place))
        drawing.axes.set_ylim(bottom=0.0)
        _time(drawing, made, f"∫ |u|₁ dt [{unit('u·s', made)}]")
    return Drawing(
        "effort",
        "Effort, from the start on",
        drawing.svg,
        _keys(made),
        f"at the end: {_each(made, [found['effort']['l1'] for found in made.figures])}",
        "T·Σ|u|₁ up to each answer: of speeds, how far all joints together were told to go. "
        f"{WIDE}",
        "A curve that goes on rising when the error has gone: work for nothing, often chattering.",
    )


def _certificates(made: Comparison) -> Drawing:
    n = len(made.series)
    with canvas("certificates") as drawing:
        axes = drawing.axes
        for place, each in enumerate(made.series):
            if not len(each):
                continue
            at, colour = n - place, LIGHT[role(place)]
            given = each.proved
            if given.any():
                ends = each.time_s[given][[0, -1]]
                axes.plot(ends, [at, at], color=colour, linewidth=1.6)
            for status, shown, height in (
                ("uncertified", colour, 0.28),
                ("infeasible", LIGHT["red"], 0.4),
            ):
                for begin, end in _stretches(each, STATUS[status], made.facts["duration_s"]):
                    axes.fill_between(
                        [begin, end], at - height, at + height, facecolor=shown, linewidth=0.0
                    )
        axes.set_ylim(0.4, n + 0.6)
        axes.set_yticks(range(1, n + 1), [str(n + 1 - at) for at in range(1, n + 1)])
        _time(drawing, made, "controller, in the order of the legend")
    bad = [int(each.unproved.sum()) for each in made.series]
    without = [found["certificates"]["none"] for found in made.figures]
    if sum(bad):
        title = f"{count(sum(bad))} answers lack a certificate that holds"
    else:
        title = "Every answer has its certificate"
        title = title if not sum(without) else "Every certificate that is given holds"
    keys = [Key(key.role, f"{place}: {key.text}") for place, key in enumerate(_keys(made), 1)]
    if any((each.status == STATUS["uncertified"]).any() for each in made.series):
        keys.append(Key("soft", "uncertified", "area"))
    if any((each.status == STATUS["infeasible"]).any() for each in made.series):
        keys.append(Key("red", "infeasible", "area"))
    return Drawing(
        "certificates",
        title,
        drawing.svg,
        tuple(keys),
        f"uncertified or infeasible: {_each(made, bad)}",
        "One line for each controller that gives certificates. A bar in its colour where its "
        "answers are uncertified; a higher, red one where it found no admissible input. What lies "
        "closer together than can be drawn is one bar.",
        "Any bar: the decrease of V, or a constraint, was not proved there.",
    )


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
    made: Comparison, name: str, values: Callable[[Series], FloatArray], label: str
) -> str:
    """The drawing of what falls towards zero, on a logarithmic axis."""
    with canvas(name) as drawing:
        for place, each in enumerate(made.series):
            drawing.axes.plot(*thin(each.time_s, values(each)), **_look(made, place))
        _time(drawing, made, label)
        together = np.concatenate([values(each) for each in made.series])
        positive(drawing, together[np.isfinite(together)])
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


def _ends(made: Comparison, values: Callable[[Series], FloatArray]) -> str:
    last: list[float | None] = []
    for each in made.series:
        known = values(each)[np.isfinite(values(each))]
        last.append(float(known[-1]) if len(known) else None)
    return _each(made, last)
