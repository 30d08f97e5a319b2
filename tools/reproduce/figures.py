"""Figures as data, from which pictures and CSV are made alike.

A paper's module returns panels of curves; here they are drawn as PNG and SVG, and the same arrays
are written as CSV, one file a panel with one row a point.
"""

from __future__ import annotations

import csv
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import repeat
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#F0E442")
"""Okabe and Ito's, which the colour-blind tell apart."""

INK, PALE = "#222222", "#BBBBBB"
DPI = 150
LEGEND = {"loc": "best", "fontsize": 7, "framealpha": 0.85, "edgecolor": "none"}


@dataclass(frozen=True, eq=False)
class Curve:
    """One curve.

    Attributes:
        label: its name in the CSV.
        x, y: points, of equal length.
        colour: of matplotlib.
        style: steps hold each value until the next point; an area is closed and filled.
        dash, marker: of matplotlib, "" for none.
        legend: its name in the legend where that is another, "" for none.
        fill: colour of an area.
    """

    label: str
    x: Array
    y: Array
    colour: str = INK
    style: Literal["line", "steps", "area"] = "line"
    dash: str = "-"
    marker: str = ""
    legend: str | None = None
    fill: str = "#F2F2F2"


@dataclass(frozen=True)
class Axis:
    """An axis.

    Attributes:
        name: of the column of the CSV.
        label: with unit.
        limits: least and greatest value shown.
        step: between two ticks.
        log: whether it is logarithmic.
    """

    name: str
    label: str
    limits: tuple[float, float] | None = None
    step: float | None = None
    log: bool = False


@dataclass(frozen=True, eq=False)
class Panel:
    """One pair of axes.

    Attributes:
        name: part of the CSV's name; "" where the figure has no other panel.
        title: above it.
        x, y: axes.
        curves: drawn in this order.
        square: whether both axes have the same scale.
        zoom: limits of x and of y that are shown larger in the lower half.
    """

    name: str
    title: str
    x: Axis
    y: Axis
    curves: Sequence[Curve]
    square: bool = False
    zoom: tuple[tuple[float, float], tuple[float, float]] | None = None


@dataclass(frozen=True, eq=False)
class Figure:
    """Panels in rows, each with its legend inside.

    Attributes:
        name: of its files.
        title: above all.
        rows: of panels.
        size: width and height [inch].
    """

    name: str
    title: str
    rows: Sequence[Sequence[Panel]]
    size: tuple[float, float]

    @property
    def panels(self) -> list[Panel]:
        """All of them."""
        return [panel for row in self.rows for panel in row]


def lines(
    data: Mapping[str, tuple[Array, Array]], dashes: Iterable[str] = repeat("-"), **style: Any
) -> list[Curve]:
    """A curve for the x and y of each name, one colour after the other."""
    styles = zip(data.items(), COLOURS, dashes, strict=False)
    return [Curve(name, *xy, colour, dash=dash, **style) for (name, xy), colour, dash in styles]


def level(
    label: str, span: Sequence[float] | Array, value: float, dash: str = "--", **style: Any
) -> Curve:
    """A horizontal line at a value, from one x to another."""
    return Curve(label, np.array(span), np.full(2, value), dash=dash, **style)


def trace(label: str, points: Array, colour: str = INK, **style: Any) -> Curve:
    """A curve through points, (k, 2)."""
    return Curve(label, points[:, 0], points[:, 1], colour, **style)


def mark(label: str, x: float, y: float, marker: str, **style: Any) -> Curve:
    """One point."""
    return Curve(label, np.array([x]), np.array([y]), dash="", marker=marker, **style)


def column(name: str, title: str, panels: Iterable[Panel], size: tuple[float, float]) -> Figure:
    """A figure of panels below each other."""
    return Figure(name, title, [[panel] for panel in panels], size)


def save(figure: Figure, folder: Path) -> list[Path]:
    """Write PNG, SVG and one CSV a panel; the same data gives the same bytes.

    Returns:
        The files.
    """
    import matplotlib

    files = [folder / f"{figure.name}.png", folder / f"{figure.name}.svg"]
    with matplotlib.rc_context({"svg.hashsalt": figure.name, "svg.fonttype": "none"}):
        picture = draw(figure)
        picture.savefig(files[0], dpi=DPI)
        picture.savefig(files[1], metadata={"Date": None})
    for panel in figure.panels:
        path = folder / f"{'_'.join(filter(None, (figure.name, panel.name)))}.csv"
        write_csv(panel, path)
        files.append(path)
    return files


def write_csv(panel: Panel, path: Path) -> None:
    """One row a point: curve, x, y; numbers with all their digits."""
    with path.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream)
        writer.writerow(["curve", panel.x.name, panel.y.name])
        for curve in panel.curves:
            for x, y in zip(curve.x.tolist(), curve.y.tolist(), strict=True):
                writer.writerow([curve.label, repr(x), repr(y)])


def draw(figure: Figure) -> Any:
    """Draw a figure without any window; a `matplotlib.figure.Figure`.

    A panel has a legend, unless the one above it has the same.
    """
    from matplotlib.figure import Figure as Picture

    picture = Picture(figsize=figure.size, layout="constrained")
    picture.suptitle(figure.title, fontsize=11, fontweight="bold")
    columns = max(len(row) for row in figure.rows)
    axes = picture.subplots(len(figure.rows), columns, squeeze=False)
    above: dict[int, list[str]] = {}
    for row, places in zip(figure.rows, axes, strict=True):
        for column, (panel, place) in enumerate(zip(row, places, strict=True)):
            handles = _draw_panel(panel, place)
            if handles and above.get(column) != [*handles]:
                ncols = 1 + len(handles) // 7
                place.legend(handles.values(), handles.keys(), ncols=ncols, **LEGEND)
            above[column] = [*handles]
    return picture


def _draw_panel(panel: Panel, axes: Any) -> dict[str, Any]:
    """Draw one panel; handles of its curves by their names in the legend."""
    from matplotlib.ticker import MultipleLocator

    handles: dict[str, Any] = {}
    for curve in panel.curves:
        line = _draw_curve(curve, axes)
        name = curve.label if curve.legend is None else curve.legend
        if name:
            handles.setdefault(name, line)
    axes.set_title(panel.title, fontsize=9, loc="left")
    axes.set_xlabel(panel.x.label, fontsize=9)
    axes.set_ylabel(panel.y.label, fontsize=9)
    axes.tick_params(which="both", labelsize=8)
    axes.grid(visible=True, color="#E5E5E5", linewidth=0.6)
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    axes.set_xscale("log" if panel.x.log else "linear")
    axes.set_yscale("log" if panel.y.log else "linear")
    for line, axis in ((axes.xaxis, panel.x), (axes.yaxis, panel.y)):
        if axis.step:
            line.set_major_locator(MultipleLocator(axis.step))
    if panel.x.limits:
        axes.set_xlim(panel.x.limits)
    if panel.y.limits:
        axes.set_ylim(panel.y.limits)
    if panel.square:
        axes.set_aspect("equal")
    if panel.zoom:
        _draw_zoom(panel, panel.zoom, axes)
    return handles


def _draw_curve(curve: Curve, axes: Any) -> Any:
    if curve.style == "area":
        (area,) = axes.fill(
            curve.x, curve.y, facecolor=curve.fill, edgecolor=curve.colour, linewidth=1.0
        )
        return area
    (line,) = axes.plot(
        curve.x,
        curve.y,
        color=curve.colour,
        linestyle=curve.dash or "none",
        marker=curve.marker or None,
        markersize=5,
        linewidth=1.4,
        drawstyle="steps-post" if curve.style == "steps" else "default",
    )
    return line


def _draw_zoom(
    panel: Panel, limits: tuple[tuple[float, float], tuple[float, float]], axes: Any
) -> None:
    """Show a part of a panel larger, in its own lower half."""
    inset = axes.inset_axes((0.17, 0.14, 0.72, 0.5), xlim=limits[0], ylim=limits[1])
    for curve in panel.curves:
        _draw_curve(curve, inset)
    inset.tick_params(labelsize=7)
    axes.indicate_inset_zoom(inset, edgecolor="#888888")
