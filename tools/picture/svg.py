"""Shapes of a picture, painted one over the other, as an SVG with the colours of its page.

`analysis/templates/document.html` has these colours.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from hoap3.protocol.messages import FloatArray
from hoap3.tools.picture.palette import COLOURS

FINE = 4  # steps of a coordinate in a px
DASH, GAP = 5.0, 4.0  # of a line with gaps [px]
Form = Literal["face", "line", "loop", "dash", "dot", "ring", "cross"]


@dataclass(frozen=True, eq=False)
class Flat:
    """One thing.

    Attributes:
        form: face: filled; line: through its points; loop: one that is closed; dash: one with
            gaps; dot, ring, cross: at its first point.
        points: (k, 2), x to the right, y down [px].
        role: its colour, of `hoap3.tools.picture.palette`.
        size: width of a line; radius of a dot, a ring or a cross [px].
    """

    form: Form
    points: FloatArray
    role: str
    size: float = 1.5


def svg(things: Sequence[Flat], width: float, height: float) -> str:
    """An element without a size of its own.

    Args:
        things: in the order in which they are painted. Faces next to each other that have one
            colour become one path, so they all have to turn the same way round.
        width, height: of the picture [px].
    """
    box = f"0 0 {round(width * FINE)} {round(height * FINE)}"
    groups = itertools.groupby(things, lambda thing: (thing.form, thing.role, thing.size))
    drawn = "".join(_drawn(list(alike)) for _, alike in groups)
    return f'<svg class="flat" viewBox="{box}" aria-hidden="true">{drawn}</svg>'


def _drawn(alike: list[Flat]) -> str:
    """Things that differ in their places alone."""
    first = alike[0]
    if first.role not in COLOURS:
        raise KeyError(first.role)
    size = f"{first.size * FINE:g}"
    colour = f"c-{first.role}"
    if first.form == "face":
        return f'<path class="{colour}" d="{"".join(_path(each.points) + "z" for each in alike)}"/>'
    if first.form in {"line", "loop", "dash"}:
        end = "z" if first.form == "loop" else ""
        gaps = f' stroke-dasharray="{DASH * FINE:g} {GAP * FINE:g}"' if first.form == "dash" else ""
        path = "".join(_path(each.points) + end for each in alike)
        return f'<path class="l {colour}" stroke-width="{size}"{gaps} d="{path}"/>'
    places = np.rint(np.array([each.points[0] for each in alike]) * FINE).astype(int).tolist()
    hollow = f'class="l {colour}" stroke-width="{2 * FINE}"'
    if first.form == "cross":
        r = round(first.size * FINE)
        path = "".join(f"M{x - r} {y}h{2 * r}m-{r}-{r}v{2 * r}" for x, y in places)
        return f'<path {hollow} d="{path}"/>'
    look = hollow if first.form == "ring" else f'class="{colour}"'
    return "".join(f'<circle {look} cx="{x}" cy="{y}" r="{size}"/>' for x, y in places)


def _path(points: FloatArray) -> str:
    """From corner to corner in whole steps, which is the shortest way to write it."""
    places = np.rint(points * FINE).astype(int)
    (x, y), *steps = np.vstack((places[:1], np.diff(places, axis=0))).tolist()
    words = " ".join(f"{dx} {dy}" for dx, dy in steps)
    return f"M{x} {y}l{words}".replace(" -", "-")
