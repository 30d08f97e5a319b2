"""ρ and the margin of every answer over time, with the stretches that nobody has proved."""

from __future__ import annotations

import numpy as np

from hoap3.protocol.messages import FloatArray
from hoap3.tools.html.canvas import BEYOND, BUCKETS, Canvas, canvas, thin
from hoap3.tools.html.drawing import Drawing, Key
from hoap3.tools.html.numbers import count, number, spread, summary
from hoap3.tools.html.palette import LIGHT
from hoap3.tools.report.certificates import Certificates

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
    with canvas("rho") as drawing:
        _shade(drawing, certificates)
        drawing.axes.axhline(1.0, color=LIGHT["faint"], linewidth=1.0, dashes=(4, 3))
        drawing.axes.plot(*thin(certificates.time_s, certificates.rho), color=LIGHT["blue"])
        _room(drawing, np.append(rho, [0.0, 1.0]))
        drawing.time(certificates.duration_s, "ρ, share of Ψ [1]")
    title = f"The constraints allow less than Ψ in {count(below)} of {count(len(rho))} answers"
    if negative:
        title = f"V may rise in {count(negative)} of {count(len(rho))} answers: ρ is below 0"
    return Drawing(
        "rho",
        title,
        drawing.svg,
        (Key("blue", "ρ"), Key("faint", "all of Ψ", "dash"), *_keys(certificates)),
        f"ρ: {spread(summary(rho), '')} · below 1 {count(below)}, below 0 {count(negative)}",
        "Share of the decrease Ψ that the constraints leave room for, at most 1: V̇ ≤ −ρΨ. Where "
        "the target moves faster than the limits allow, it is below 0, and V rises as little as "
        "can be. Paper: (6).",
        "ρ = 0 and V above 0: the robot stands at a limit and can do no more. ρ that jumps to and "
        "fro: constraints that come and go.",
    )


def _margin(certificates: Certificates) -> Drawing:
    margin = _known(certificates.margin)
    outside = int((margin < OUTSIDE).sum())
    with canvas("margin") as drawing:
        _shade(drawing, certificates)
        drawing.axes.axhline(0.0, color=LIGHT["red"], linewidth=1.0, dashes=(4, 3))
        drawing.axes.plot(*thin(certificates.time_s, certificates.margin), color=LIGHT["blue"])
        _room(drawing, np.append(margin, 0.0))
        drawing.time(certificates.duration_s, "smallest margin [unit of its constraint]")
    title = f"Every constraint is kept, the nearest by {number(float(margin.min()))}"
    if outside:
        title = f"A constraint is violated in {count(outside)} of {count(len(margin))} answers"
    return Drawing(
        "margin",
        title,
        drawing.svg,
        (Key("blue", "margin"), Key("red", "limit", "dash"), *_keys(certificates)),
        f"margin: {spread(summary(margin), '')} · outside {count(outside)}",
        "Smallest true margin of all constraints, as each answer states it, in the unit of the "
        "one that is nearest: of qp12, pinv and osqp rad/s, u_max − max|u|. Negative is outside.",
        "A margin below the dashed line: a limit is broken; the events of the controller name "
        "which. A long time at 0: the motion is what the limit leaves of it.",
    )


def _known(values: FloatArray) -> FloatArray:
    return np.asarray(values[np.abs(values) < BEYOND], float)


def _room(drawing: Canvas, values: FloatArray) -> None:
    """Show all of these, with some room around them."""
    low, high = float(values.min()), float(values.max())
    around = 0.06 * max(high - low, 1e-9)
    drawing.axes.set_ylim(low - around, high + around)


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
