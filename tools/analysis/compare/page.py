"""The page of a comparison: figures, table and settings in one HTML file without any time.

In its plots each controller has one colour, over one axis of time.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
import yaml

from hoap3.protocol.messages import FloatArray
from hoap3.remote_controller.controllers.base import STATUS
from hoap3.tools.analysis.answer_series import UNITS
from hoap3.tools.analysis.canvas import Canvas, Drawing, Key, canvas, means, thin
from hoap3.tools.analysis.compare.comparison import Comparison
from hoap3.tools.analysis.compare.figures import SPEED, WORDS, Figures, Series, Word, cell, value
from hoap3.tools.analysis.document import PAGES
from hoap3.tools.analysis.numbers import count, number
from hoap3.tools.analysis.summary import units_of_v
from hoap3.tools.picture.palette import LIGHT
from hoap3.tools.picture.palette import SERIES as FIRST_ROLES

SECTIONS = {"plots": "Over time", "table": "Figures", "settings": "Settings", "words": "Words"}
ROLES = (*(role for role in FIRST_ROLES if role != "red"), "pink", "brown")
"""Colours of controllers; red stays for what is wrong."""

THINNEST, STEP = 1.2, 1.6  # width of the last curve, and how much wider each one below it is
STRETCHES = 400  # that can be told apart across a figure

OF_U = dict(
    zip(
        UNITS.values(),
        (
            {"u": "rad/s", "u·s": "rad", "u²·s": "rad²/s"},
            {"u": "rad/s²", "u·s": "rad/s", "u²·s": "rad²/s³"},
            {"u": "N m", "u·s": "N m s", "u²·s": "(N m)² s"},
        ),
        strict=True,
    )
)
"""Units of figures, by that of u."""


def shown_words(made: Comparison) -> list[Word]:
    """Figures that say something of one controller at least: known, or not 0 where 0 is usual."""
    return [word for word in WORDS if any(_shown(found, word.key) for found in made.figures)]


OF_TASK = "unit of the task"


def unit(what: str, made: Comparison) -> str:
    """Unit of a figure, which has u or the task in it where controllers differ in what it is."""
    if what.startswith(OF_TASK):
        told = {" and ".join(units_of_v(found)) for found in made.figures}
        name = told.pop()
        return what if told or not name or " and " in name else what.replace(OF_TASK, name)
    units = {found["unit"] for found in made.figures}
    known = OF_U.get(units.pop(), {}) if len(units) == 1 else {}
    return known.get(what, what)


def _shown(found: Figures, key: str) -> bool:
    if key == "error.settled_s":  # not there yet is an answer, too
        key = "error.start"
    given = value(found, key)
    quiet = key.startswith("certificates.") and key != "certificates.certified"
    return given is not None and not (quiet and given == 0)


def page(made: Comparison) -> str:
    """The whole file."""
    settings = [
        {"controller": each.config.controller, "parameters": each.parameters}
        for each in made.candidates
    ]
    return PAGES.get_template("analysis/compare/templates/page.html").render(
        kind="comparison",
        title=" · ".join(made.labels),
        sections=SECTIONS,
        made=made,
        drawings=drawings(made),
        role=role,
        rows=[
            (word, unit(word.unit, made), [cell(found, word.key) for found in made.figures])
            for word in shown_words(made)
        ],
        settings=[yaml.safe_dump(each, sort_keys=False, allow_unicode=True) for each in settings],
        words=WORDS,
    )


def role(place: int) -> str:
    """Colour of a controller."""
    return ROLES[place % len(ROLES)]


def _dash(place: int) -> str:
    return "--" if place >= len(ROLES) else "-"


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
    title = "The error of each controller"
    return _falling(made, "error", title, [each.error for each in made.series], label)


def _lyapunov(made: Comparison) -> Drawing:
    known = [each["v_difference"] for each in made.figures if each["v_difference"] is not None]
    title = "V of each controller"
    if known:
        title = f"V differs by at most {number(100.0 * max(known))} % of its start"
    label = "V [squared unit], logarithmic"
    return _falling(made, "v", title, [each.lyapunov for each in made.series], label)


def _falling(
    made: Comparison, name: str, title: str, values: list[FloatArray], label: str
) -> Drawing:
    """What falls towards zero, on a logarithmic axis."""
    known = [each[np.isfinite(each)] for each in values]
    ends = [float(each[-1]) if len(each) else None for each in known]
    if not made.closed_loop:
        title = f"{'V' if name == 'v' else 'The error'} at the States of the log"
    with _curves(made, name, label, values) as drawing:
        drawing.log_positive(np.concatenate(values))
    return _drawing(made, name, title, drawing, f"at the end: {_each(made, ends)}")


def _active(made: Comparison) -> Drawing:
    counts = [each.active for each in made.series]
    label = f"joints with |u| ≥ 0.001 {SPEED}"
    with _curves(made, "active", label, counts, means) as drawing:
        highest = max([1.0, *(float(line.get_ydata().max()) for line in drawing.axes.lines)])
        drawing.axes.set_ylim(0.0, 1.15 * highest)
        drawing.axes.yaxis.get_major_locator().set_params(integer=True)
    mean_of = _each(made, [found["active_joints"]["mean"] for found in made.figures])
    title = f"Joints at work, of {made.facts['joints']}"
    return _drawing(made, "active", title, drawing, f"mean: {mean_of}")


def _switching(made: Comparison) -> Drawing:
    sums = [None if each.switched is None else np.cumsum(each.switched) for each in made.series]
    with _curves(made, "switching", "times that a joint went on or off", sums) as drawing:
        drawing.axes.set_ylim(bottom=0.0)
    rates = _each(made, [found["switching_per_s"] for found in made.figures])
    title = "Joints that go on and off, from the start on"
    return _drawing(made, "switching", title, drawing, f"per second: {rates}")


def _control_effort(made: Comparison) -> Drawing:
    sums = [np.cumsum(each.control_effort) * each.period_s for each in made.series]
    label = f"∫ |u|₁ dt [{unit('u·s', made)}]"
    with _curves(made, "control_effort", label, sums) as drawing:
        drawing.axes.set_ylim(bottom=0.0)
    ends = _each(made, [found["control_effort"]["l1"] for found in made.figures])
    title = "Control effort, from the start on"
    return _drawing(made, "control_effort", title, drawing, f"at the end: {ends}")


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
        drawing.time(
            made.facts["duration_s"], "controller, in the order of the legend", "the first answer"
        )
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


@contextmanager
def _curves(
    made: Comparison,
    name: str,
    label: str,
    values: Sequence[FloatArray | None],
    sample: Callable[..., tuple[Any, ...]] = thin,
) -> Iterator[Canvas]:
    """A canvas with a curve for each controller that has values, thinned out by `sample`."""
    with canvas(name) as drawing:
        for place, (each, value) in enumerate(zip(made.series, values, strict=True)):
            if value is not None and len(value):
                x, y = sample(each.time_s, value)[:2]
                above = min(len(made.series) - 1 - place, 6)  # an earlier curve is wider
                drawing.line(x, y, role(place), THINNEST + STEP * above, _dash(place))
        drawing.time(made.facts["duration_s"], label, "the first answer")
        yield drawing


def _drawing(made: Comparison, name: str, title: str, drawing: Canvas, figures: str) -> Drawing:
    return Drawing(name, title, drawing.svg, tuple(_keys(made)), figures)


def _keys(made: Comparison) -> list[Key]:
    return [
        Key(role(place), label, "line" if _dash(place) == "-" else "dash")
        for place, label in enumerate(made.labels)
    ]


def _each(made: Comparison, values: Sequence[float | None]) -> str:
    """`a: 1 · b: 2`."""
    return " · ".join(
        f"{label}: {'–' if value is None else number(value)}"
        for label, value in zip(made.labels, values, strict=True)
    )
