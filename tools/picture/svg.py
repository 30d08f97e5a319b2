"""Flat things as an SVG that takes the colours of its page: `html/templates/document.html`."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hoap3.protocol.messages import FloatArray
from hoap3.tools.html.palette import COLOURS
from hoap3.tools.picture.flat import Flat

FINE = 4  # steps of a coordinate in a px
DASH, GAP = 5.0, 4.0  # of a line with gaps [px]


def svg(things: Sequence[Flat], width: float, height: float) -> str:
    """An element without a size of its own.

    Args:
        things: in the order in which they are painted.
        width, height: of the picture [px].
    """
    box = f"0 0 {round(width * FINE)} {round(height * FINE)}"
    drawn = "".join(map(_drawn, things))
    return f'<svg class="flat" viewBox="{box}" aria-hidden="true">{drawn}</svg>'


def _drawn(thing: Flat) -> str:
    if thing.role not in COLOURS:
        raise KeyError(thing.role)
    size = f"{thing.size * FINE:g}"
    if thing.form == "face":
        return f'<path class="c-{thing.role}" d="{_path(thing.points)}z"/>'
    if thing.form in {"line", "loop", "dash"}:
        end = "z" if thing.form == "loop" else ""
        gaps = f' stroke-dasharray="{DASH * FINE:g} {GAP * FINE:g}"' if thing.form == "dash" else ""
        look = f'class="l c-{thing.role}" stroke-width="{size}"{gaps}'
        return f'<path {look} d="{_path(thing.points)}{end}"/>'
    x, y = np.rint(thing.points[0] * FINE).astype(int).tolist()
    if thing.form == "cross":
        r = round(thing.size * FINE)
        look = f'class="l c-{thing.role}" stroke-width="{2 * FINE}"'
        return f'<path {look} d="m{x - r} {y}h{2 * r}m{-r}-{r}v{2 * r}"/>'
    look = f'class="c-{thing.role}"'
    if thing.form == "ring":
        look = f'class="l c-{thing.role}" stroke-width="{2 * FINE}"'
    return f'<circle {look} cx="{x}" cy="{y}" r="{size}"/>'


def _path(points: FloatArray) -> str:
    """From corner to corner in whole steps, which is the shortest way to write it."""
    places = np.rint(points * FINE).astype(int)
    steps = np.vstack((places[:1], np.diff(places, axis=0))).tolist()
    words = [f"{x} {y}" for x, y in steps]
    return f"m{words[0]}l{' '.join(words[1:])}".replace(" -", "-")
