"""A quiet pair of axes, and what becomes of it: an SVG that takes the colours of its page.

No figure holds text that is not a number or an axis label: titles, legends and notes belong to the
page, where they wrap, scale and can be searched.
"""

from __future__ import annotations

import io
import itertools
import math
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.messages import FloatArray
from hoap3.tools.analysis.numbers import count
from hoap3.tools.picture.palette import LIGHT

WIDTH, HEIGHT = 420, 250  # px; a phone shows it at four fifths of that, a desk at five quarters
LEFT, RIGHT, BOTTOM, TOP = 50, 18, 38, 22  # px around the axes, the same in every figure
BEYOND = 1e100  # what no figure can show
BUCKETS = 700  # across a figure
WINDOWS = 160  # in which means and rates are taken

_STYLE: dict[Any, Any] = {
    "svg.fonttype": "none",
    "svg.hashsalt": "report",
    "text.parse_math": False,
    "font.family": "sans-serif",
    "font.size": 11.5,
    "axes.edgecolor": LIGHT["faint"],
    "axes.labelcolor": LIGHT["soft"],
    "axes.linewidth": 0.8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.unicode_minus": True,
    "grid.color": LIGHT["rule"],
    "grid.linewidth": 0.7,
    **dict.fromkeys(("xtick.color", "ytick.color"), LIGHT["faint"]),
    **dict.fromkeys(("xtick.labelcolor", "ytick.labelcolor"), LIGHT["soft"]),
    "xtick.major.size": 3.0,
    **dict.fromkeys(("ytick.major.size", "xtick.minor.size", "ytick.minor.size"), 0.0),
    "lines.linewidth": 1.6,
    "lines.solid_capstyle": "round",
    "lines.solid_joinstyle": "round",
    "path.simplify": True,
    "path.simplify_threshold": 0.2,
}
_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_LONG = re.compile(r"(\.\d\d)\d+")
_ROLES = {value: f"var(--{role})" for role, value in LIGHT.items()}
_COLOUR = re.compile("|".join(map(re.escape, _ROLES)), re.IGNORECASE)


@dataclass(frozen=True)
class Key:
    """One entry of a legend.

    Attributes:
        role: colour, of `palette`.
        text: what it stands for; from a log, so not yet fit for HTML.
        mark: how it is drawn: "line", "dash", "dot", "ring", "area".
    """

    role: str
    text: str
    mark: str = "line"


@dataclass(frozen=True)
class Drawing:
    """One figure.

    Attributes:
        name: its anchor.
        title: what to see in it.
        svg: the drawing itself.
        keys: legend.
        figures: n and percentiles of what is drawn, in words.
        wide: whether it takes all the width of the page.
    """

    name: str
    title: str
    svg: str
    keys: tuple[Key, ...]
    figures: str
    wide: bool = False


class Canvas:
    """One figure with one pair of axes.

    Attributes:
        axes: matplotlib's.
        svg: the drawing, once `canvas` has closed it.
    """

    def __init__(self, name: str, height: int) -> None:
        from matplotlib.figure import Figure

        self._name = name
        self.figure = Figure(figsize=(WIDTH / 72, height / 72), dpi=72)
        width, tall = WIDTH - LEFT - RIGHT, height - BOTTOM - TOP
        place = (LEFT / WIDTH, BOTTOM / height, width / WIDTH, tall / height)
        self.axes: Any = self.figure.add_axes(place)
        self._top = 1.0 - 13.0 / height
        for background in (self.figure.patch, self.axes.patch):
            background.set_visible(False)
        self.svg = ""

    def label(self, x: str, y: str) -> None:
        """Name both axes, with units."""
        look: Any = {"color": LIGHT["soft"], "fontsize": 11.5}
        self.figure.text(1.0 - RIGHT / WIDTH, 0.01, x, ha="right", va="bottom", **look)
        self.figure.text(0.01, self._top, y, ha="left", va="baseline", **look)

    def time(self, duration_s: float, y: str, since: str = "the first tick that asked") -> None:
        """Name both axes; x is time [s], from 0 to the end of the motion."""
        self.label(f"time since {since} [s]", y)
        self.axes.set_xlim(0.0, max(duration_s, 1e-9))

    def line(
        self, x: FloatArray, y: FloatArray, role: str, width: float | None = None, dash: str = "-"
    ) -> None:
        """Draw as much of a curve as can be seen."""
        self.axes.plot(*thin(x, y), color=LIGHT[role], linewidth=width, linestyle=dash)

    def threshold(self, value: float, role: str, axis: str = "y") -> None:
        """A dashed line across the figure, at one value of an axis."""
        across = self.axes.axhline if axis == "y" else self.axes.axvline
        across(value, color=LIGHT[role], linewidth=1.0, dashes=(4, 3))

    def log_scale(self, axis: str, *, numbers: bool = False) -> None:
        """Make one axis logarithmic, its decades written 10⁻³, or as plain `numbers`."""
        from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

        getattr(self.axes, f"set_{axis}scale")("log", nonpositive="clip")
        which = getattr(self.axes, f"{axis}axis")
        low, high = getattr(self.axes, f"get_{axis}lim")()
        near = numbers and high < 200.0 * low  # else decades alone are enough
        which.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if near else (1.0,), numticks=8))
        which.set_major_formatter(FuncFormatter(lambda v, _: plain(v) if numbers else decade(v)))
        which.set_minor_locator(NullLocator())

    def log_positive(self, values: FloatArray) -> None:
        """A logarithmic y axis over the positive values; twelve decades at most, for rounding."""
        positive = values[(values > 0.0) & (values < BEYOND)]
        if len(positive):
            self.log_scale("y")
            top = float(positive.max())
            self.axes.set_ylim(max(float(positive.min()), 1e-12 * top) / 2.0, 2.0 * top)

    def close(self) -> None:
        """Turn the drawing into text."""
        from matplotlib.backends.backend_svg import FigureCanvasSVG

        stream = io.StringIO()
        drawing: Any = FigureCanvasSVG(self.figure)
        drawing.print_svg(stream, metadata=dict.fromkeys(_METADATA))
        self.svg = _for_page(stream.getvalue(), self._name)


@contextmanager
def canvas(name: str, height: int = HEIGHT) -> Iterator[Canvas]:
    """A canvas that is drawn when the block ends; `name` sets its ids apart from all others."""
    import matplotlib as mpl

    with mpl.rc_context(_STYLE):
        drawing = Canvas(name, height)
        yield drawing
        drawing.close()


def thin(x: FloatArray, y: FloatArray, buckets: int = BUCKETS) -> tuple[FloatArray, FloatArray]:
    """As many points as can be seen: of each stretch of x the least and the greatest y.

    Both are kept in the order in which they stand, so that no spike is lost or invented.
    """
    keep = np.abs(y) < BEYOND  # not so of NaN
    x, y = x[keep], y[keep]
    if len(y) <= 2 * buckets:
        return x, y
    edges = np.linspace(0, len(y), buckets + 1).astype(int)
    places: list[int] = []
    for begin, end in itertools.pairwise(edges.tolist()):
        stretch = y[begin:end]
        places += sorted({begin + int(np.argmin(stretch)), begin + int(np.argmax(stretch))})
    chosen: NDArray[np.intp] = np.array(places, np.intp)
    return x[chosen], y[chosen]


def means(time: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray, float]:
    """Middle and mean of each window with values in it, and its length [s]."""
    length = max((time[-1] - time[0]) / WINDOWS, 1e-9)
    place = ((time - time[0]) / length).astype(int).clip(0, WINDOWS - 1)
    begins = np.flatnonzero(np.diff(place, prepend=-1))
    pieces = np.split(values, begins[1:])
    middles = time[0] + (place[begins] + 0.5) * length
    return middles, np.array([piece.mean() for piece in pieces]), float(length)


def decade(value: float) -> str:
    """A power of ten as 10⁻³; nothing for what is none."""
    power = round(math.log10(value)) if value > 0.0 else 0
    if not math.isclose(value, 10.0**power, rel_tol=1e-6):
        return ""
    return "10" + str(power).translate(_SUPERSCRIPT)


def plain(value: float) -> str:
    """A number as people write it: 10 000 rather than 1e4."""
    return count(round(value)) if value >= 1000.0 else f"{value:g}"


_METADATA = ("Creator", "Date", "Format", "Type")


def _for_page(svg: str, name: str) -> str:
    """An SVG element without prologue, fixed size, fixed colours, or ids that others have."""
    head, _, rest = svg[svg.index("<svg") :].partition(">")
    box = re.search(r'viewBox="[^"]*"', head)
    rest = re.sub(r"<(metadata|style)\b.*?</\1>", "", rest, flags=re.DOTALL)
    rest = re.sub(r'<g id="[^"]*">', "<g>", rest)
    rest = re.sub(r'\bid="([^"]*)"', rf'id="{name}-\1"', rest)
    rest = rest.replace("url(#", f"url(#{name}-").replace('xlink:href="#', f'href="#{name}-')
    rest = re.sub(r' d="[^"]*"', lambda path: _LONG.sub(r"\1", path[0]).replace("\n", " "), rest)
    rest = re.sub(r"font-family: [^;\"]*;?", "", rest)
    rest = _COLOUR.sub(lambda match: _ROLES[match[0].lower()], rest)
    return f'<svg {box[0] if box else ""} aria-hidden="true">{rest.strip()}'
