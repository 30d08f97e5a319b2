"""Flat things as an image of Pillow, painted larger and made smaller: edges are smooth."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from hoap3.tools.picture.palette import COLOURS
from hoap3.tools.picture.svg import Flat

LARGER = 4  # times, on the way
DASH, GAP = 5.0, 4.0  # of a line with gaps [px]


class Canvas:
    """An image to paint on.

    Args:
        width, height: [px].
        dark: whether colours are those of dark pages.
        background: its role.
    """

    def __init__(
        self, width: int, height: int, *, dark: bool = False, background: str = "card"
    ) -> None:
        from PIL import Image, ImageDraw

        self._dark = dark
        self._size = (width, height)
        colour = self.colour(background)
        self._image: Any = Image.new("RGB", (width * LARGER, height * LARGER), colour)
        self._draw: Any = ImageDraw.Draw(self._image)

    def colour(self, role: str) -> str:
        """Of a role, or the colour itself."""
        return COLOURS[role][self._dark] if role in COLOURS else role

    def paint(self, things: Sequence[Flat], at: tuple[float, float] = (0.0, 0.0)) -> None:
        """Paint things, moved by so many px."""
        for thing in things:
            points = (thing.points + np.array(at)) * LARGER
            _FORMS[thing.form](self._draw, points, self.colour(thing.role), thing.size * LARGER)

    def write(
        self,
        at: tuple[float, float],
        text: str,
        role: str,
        size: float = 14.0,
        anchor: str = "ls",
    ) -> float:
        """Write a line of text.

        Args:
            at: its place [px].
            text: what.
            role: its colour.
            size: height of the letters [px].
            anchor: which point of the text that is, as Pillow names them: "ls" its lower left.

        Returns:
            How long it is [px].
        """
        font = _font(size * LARGER)
        place = (at[0] * LARGER, at[1] * LARGER)
        self._draw.text(place, text, fill=self.colour(role), font=font, anchor=anchor)
        return float(font.getlength(text)) / LARGER

    @property
    def image(self) -> Any:
        """The image in its size, a `PIL.Image.Image`."""
        from PIL import Image

        return self._image.resize(self._size, Image.Resampling.BOX)


def _font(size: float) -> Any:
    """Matplotlib's own, so that pictures are alike everywhere."""
    import matplotlib as mpl
    from PIL import ImageFont

    return ImageFont.truetype(Path(mpl.get_data_path(), "fonts", "ttf", "DejaVuSans.ttf"), size)


def _corners(points: Any) -> list[tuple[float, float]]:
    return [(float(x), float(y)) for x, y in points]


def _face(draw: Any, points: Any, colour: str, size: float) -> None:
    del size
    draw.polygon(_corners(points), fill=colour, outline=colour, width=LARGER // 2)


def _line(draw: Any, points: Any, colour: str, size: float) -> None:
    draw.line(_corners(points), fill=colour, width=max(1, round(size)), joint="curve")


def _loop(draw: Any, points: Any, colour: str, size: float) -> None:
    _line(draw, [*points, points[0], points[1]], colour, size)


def _dash(draw: Any, points: Any, colour: str, size: float) -> None:
    for one, other in itertools.pairwise(points):
        long = float(np.linalg.norm(other - one))
        if long == 0.0:
            continue
        along = (other - one) / long
        for begin in np.arange(0.0, long, (DASH + GAP) * LARGER):
            end = min(begin + DASH * LARGER, long)
            _line(draw, [one + begin * along, one + end * along], colour, size)


def _dot(draw: Any, points: Any, colour: str, size: float) -> None:
    x, y = points[0]
    draw.ellipse((x - size, y - size, x + size, y + size), fill=colour)


def _ring(draw: Any, points: Any, colour: str, size: float) -> None:
    x, y = points[0]
    box = (x - size, y - size, x + size, y + size)
    draw.ellipse(box, outline=colour, width=2 * LARGER)


def _cross(draw: Any, points: Any, colour: str, size: float) -> None:
    x, y = points[0]
    for dx, dy in ((size, 0.0), (0.0, size)):
        _line(draw, [(x - dx, y - dy), (x + dx, y + dy)], colour, 2.0 * LARGER)


_FORMS = {
    "face": _face,
    "line": _line,
    "loop": _loop,
    "dash": _dash,
    "dot": _dot,
    "ring": _ring,
    "cross": _cross,
}
