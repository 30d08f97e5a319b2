"""ρ and the margin of every answer over time, with the stretches that nobody has proved."""

from __future__ import annotations

import numpy as np

from hoap3.protocol.messages import FloatArray
from hoap3.tools.analysis.canvas import BEYOND, BUCKETS, Canvas, Drawing, Key, canvas
from hoap3.tools.analysis.certificates import Certificates
from hoap3.tools.analysis.numbers import count, number, spread, summary
from hoap3.tools.picture.palette import LIGHT

OUTSIDE = -1e-9  # of a margin: what is nearer to 0 is rounding


def certificate_drawings(certificates: Certificates) -> list[Drawing]:
    """Every figure that there is something to see in."""
    drawings = []
    if (_known(certificates.rho) < 1.0).any():
        drawings.append(_rho(certificates))
    if len(_known(certificates.margin)):
        drawings.append(_margin(certificates))
    return drawings


def _rho(certificates: Certificates) -> Drawing:
    rho = _known(certificates.rho)
    below, negative = int((rho < 1.0).sum()), int((rho < 0.0).sum())
    svg = _over_time(certificates, "rho", (1.0, "faint"), np.append(rho, 0.0), "ρ, share of Ψ [1]")
    title = f"The constraints allow less than Ψ in {count(below)} of {count(len(rho))} answers"
    if negative:
        title = f"V may rise in {count(negative)} of {count(len(rho))} answers: ρ is below 0"
    figures = f"ρ: {spread(summary(rho), '')} · below 1 {count(below)}, below 0 {count(negative)}"
    keys = (Key("blue", "ρ"), Key("faint", "all of Ψ", "dash"), *_keys(certificates))
    return Drawing("rho", title, svg, keys, figures)


def _margin(certificates: Certificates) -> Drawing:
    margin = _known(certificates.margin)
    outside = int((margin < OUTSIDE).sum())
    label = "smallest margin [unit of its constraint]"
    svg = _over_time(certificates, "margin", (0.0, "red"), margin, label)
    title = f"All constraints hold, the nearest by {number(float(margin.min()))}"
    if outside:
        title = f"A constraint is violated in {count(outside)} of {count(len(margin))} answers"
    figures = f"margin: {spread(summary(margin), '')} · outside {count(outside)}"
    keys = (Key("blue", "margin"), Key("red", "limit", "dash"), *_keys(certificates))
    return Drawing("margin", title, svg, keys, figures)


def _over_time(
    certificates: Certificates,
    name: str,
    threshold: tuple[float, str],
    shown: FloatArray,
    label: str,
) -> str:
    """A quantity of `certificates` with a threshold, both of which and `shown` fit into it."""
    shown = np.append(shown, threshold[0])
    low, high = float(shown.min()), float(shown.max())
    around = 0.06 * max(high - low, 1e-9)
    with canvas(name) as drawing:
        _shade(drawing, certificates)
        drawing.threshold(*threshold)
        drawing.line(certificates.time_s, getattr(certificates, name), "blue")
        drawing.axes.set_ylim(low - around, high + around)
        drawing.time(certificates.duration_s, label)
    return drawing.svg


def _known(values: FloatArray) -> FloatArray:
    return np.asarray(values[np.abs(values) < BEYOND], float)


def _shade(drawing: Canvas, certificates: Certificates) -> None:
    """Colour the stretches without certificate; neighbours that touch on paper become one."""
    finest = max(certificates.duration_s, 1e-9) / BUCKETS
    merged: list[list[float]] = []
    for stretch in certificates.stretches:
        begin, end = stretch.begin_s, max(stretch.end_s, stretch.begin_s + finest)
        if merged and begin - merged[-1][1] < finest:
            merged[-1][1] = max(end, merged[-1][1])
        else:
            merged.append([begin, end])
    for begin, end in merged:
        drawing.axes.axvspan(begin, end, color=LIGHT["red"], alpha=0.22, linewidth=0)


def _keys(certificates: Certificates) -> tuple[Key, ...]:
    if not certificates.stretches:
        return ()
    return (Key("red", f"no certificate: {count(certificates.without)} answers", "area"),)
