"""How the pictures look, and how they are written: always the same bytes for the same data.

What is data has an id that begins with `data`, so that a test can compare it and nothing else.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from runs import POINTS, Array, Run

from hoap3.tools.reproduce.figures import COLOURS, INK

STYLE = {
    "svg.fonttype": "none",
    "path.simplify": False,  # or the number of points would depend on the last digit
    "font.size": 8,
    "axes.titlesize": 8.5,
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#E5E5E5",
    "grid.linewidth": 0.6,
    "lines.linewidth": 1.4,
    "legend.frameon": False,
    "legend.handlelength": 1.4,
    "xtick.color": INK,
    "ytick.color": INK,
    "axes.edgecolor": "#888888",
}
WIDTH, HEIGHT = 7.2, 2.5  # inch
DASHES = ("-", "--", "-.", ":", (0, (1, 1)))
Curves = Mapping[str, tuple[Array, Array]]


def panels(
    count: int,
    *,
    left: float = 0.085,
    width: float = WIDTH,
    height: float = HEIGHT,
    gap: float = 0.28,
) -> Any:
    """A figure and its axes, side by side, at places that depend on no font."""
    figure = Figure(figsize=(width, height))
    margin = 0.5 / height
    figure.subplots_adjust(left=left, right=0.985, bottom=margin, top=1 - margin / 2, wspace=gap)
    return figure, figure.subplots(1, count, squeeze=False)[0]


def label(axes: Axes, title: str, x: str, y: str) -> None:
    """Title, and what the axes are."""
    axes.set_title(title)
    axes.set_xlabel(x)
    axes.set_ylabel(y)


def lines(
    axes: Axes,
    curves: Curves,
    *,
    rough: bool = False,
    first: int = 0,
    at: str = "best",
    **style: Any,
) -> None:
    """Curves over one another, named in a legend.

    Args:
        axes: where.
        curves: by name; without a legend if they have none.
        rough: whether they may differ from machine to machine.
        first: number of the first colour.
        at: place of the legend, "" for none.
        style: of matplotlib.
    """
    for place, (name, (x, y)) in enumerate(curves.items(), first):
        chosen = {"color": COLOURS[place], "linestyle": DASHES[place % len(DASHES)], **style}
        (line,) = axes.plot(x, y, label=name or None, **chosen)
        line.set_gid(_name(axes, "rough" if rough else "data"))
    if at and any(curves):
        axes.legend(loc=at)


def area(axes: Axes, corners: Sequence[tuple[float, float]], text: str = "") -> None:
    """A filled polygon."""
    (patch,) = axes.fill(*zip(*corners, strict=True), facecolor="#EEEEEE", edgecolor="#888888")
    patch.set_zorder(0)
    if text:
        axes.annotate(text, corners[0], xytext=(3, 4), textcoords="offset points", color="#666666")


def limit(axes: Axes, y: float, text: str = "", *, at: float = 0.99) -> None:
    """A horizontal line that is not to be crossed; its text ends at a share of the width."""
    axes.axhline(y, color=INK, linewidth=0.8, linestyle=(0, (4, 3)))
    if text:
        place = {"xycoords": ("axes fraction", "data"), "textcoords": "offset points"}
        axes.annotate(text, (at, y), xytext=(0, 2), ha="right", color=INK, **place)


def joints(axes: Sequence[Axes], speeds: Mapping[str, Array], names: Sequence[str]) -> None:
    """How fast each joint is, one panel a title."""
    places = np.arange(len(names))
    top = max(float(np.abs(each).max()) for each in speeds.values())
    for one, (title, values) in zip(axes, speeds.items(), strict=True):
        bars = one.barh(places, np.abs(values), color=COLOURS[0], height=0.7)
        for place, bar in enumerate(bars):
            bar.set_gid(_name(one, f"data-{place}"))
        label(one, title, "|u| [rad/s]", "")
        one.set_xlim(0.0, 1.05 * top)
        one.set_yticks(places, names if one is axes[0] else [""] * len(names), fontsize=6)
        one.invert_yaxis()
        one.grid(visible=False, axis="y")


def of(run: Run, values: Array, *, start: float = 0.0, end: float = np.inf) -> tuple[Array, Array]:
    """Time and values between two times, at so many points at the most."""
    chosen = np.flatnonzero((run.time >= start) & (run.time <= end))
    if chosen.size > POINTS:
        chosen = chosen[np.linspace(0, chosen.size - 1, POINTS).round().astype(int)]
    return run.time[chosen], np.asarray(values)[chosen]


def save(name: str, figure: Figure, folder: Path) -> Path:
    """Write `name.svg`: no date, no version, no random name."""
    path = folder / f"{name}.svg"
    with mpl.rc_context({"svg.hashsalt": name}):
        figure.savefig(path, metadata={"Date": None, "Creator": None})
    text = path.read_text(encoding="utf-8")
    path.write_text("\n".join(line.rstrip() for line in text.splitlines()) + "\n", encoding="utf-8")
    return path


def data(path: Path) -> dict[str, Array]:
    """Coordinates of what is data in a picture [points], by id."""
    found = {}
    for group in ET.parse(path).iter("{http://www.w3.org/2000/svg}g"):  # noqa: S314 - our own
        name = group.get("id", "")
        if name.startswith(("data", "rough")):
            (drawn,) = group.findall("{http://www.w3.org/2000/svg}path")
            words = [word for word in drawn.get("d", "").split() if word not in "MLz"]
            found[name] = np.array(words, float).reshape(-1, 2)
    return found


def _name(axes: Axes, kind: str) -> str:
    """A new id."""
    figure = axes.figure
    return f"{kind}-{figure.axes.index(axes)}-{len(axes.lines)}"
