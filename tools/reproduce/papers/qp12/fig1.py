"""Fig. 1: what of the polygon A u ≤ b the line ∇V·u = −ρΨ leaves, for two joints.

The paper gives no figures; this is a square of 1 rad/s with a corner cut off. Solvers say what is
feasible: `feasible_rate` ρ*, and how far one may go either way along the line; `lyapunov_qp` the
answer there, or that there is none. Beside them stands plain geometry: the polygon's corners, and
where the line cuts its edges.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from hoap3.protocol.errors import InfeasibleError
from hoap3.remote_controller.solvers import feasible_rate, lyapunov_qp
from hoap3.tools.reproduce.figures import COLOURS, INK, Array, Axis, Curve, Figure, Panel
from hoap3.tools.reproduce.papers.qp12.reference import cut_polygon
from hoap3.tools.reproduce.rows import Row, bounded, near

A = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0], [1.0, 1.0]])
B = np.array([1.0, 1.0, 1.0, 1.0, 1.5])  # rad/s
CORNERS = np.array([[1.0, -1.0], [1.0, 0.5], [0.5, 1.0], [-1.0, 1.0], [-1.0, -1.0]])
FAR = 10.0  # rad/s: further than the polygon reaches
ROUNDING = 1e-7  # rad/s

CORNER, EDGE = np.array([-1.0, -2.0]), np.array([-1.0, -1.0])
"""∇V such that V falls fastest in a corner, and on an edge; per rad."""

PSI = 5.0
"""Ψ [1/s], so large that ρ* < 1."""


@dataclass(frozen=True, eq=False)
class Case:
    """One line against the polygon.

    Attributes:
        name: of the panel, as in the paper.
        what: it shows.
        gradient: ∇V, (2,).
        share: ρ/ρ*.
    """

    name: str
    what: str
    gradient: Array
    share: float

    @property
    def best(self) -> float:
        """ρ*, from the polygon's corners."""
        return float(-(CORNERS @ self.gradient).min()) / PSI

    @property
    def decrease(self) -> float:
        """ρΨ."""
        return self.share * self.best * PSI

    @property
    def along(self) -> Array:
        """Unit vector along the line."""
        across = self.gradient / np.linalg.norm(self.gradient)
        return np.array([-across[1], across[0]])


CASES = (
    Case("a", "ρ = 1.2 ρ*: nothing", CORNER, 1.2),
    Case("b", "ρ = 0.6 ρ*: a segment", CORNER, 0.6),
    Case("c", "ρ = ρ*: one point", CORNER, 1.0),
    Case("c_edge", "ρ = ρ*, parallel to an edge: the edge", EDGE, 1.0),
)


def by_solvers(case: Case) -> Array:
    """Ends of the feasible set, (2, 2), as two LPs and the QP have it; (0, 2) where it is empty."""
    try:
        lyapunov_qp(case.gradient, case.decrease, 0.0, A, B)
    except InfeasibleError:
        return np.zeros((0, 2))
    row, value = case.gradient[None, :], np.array([-case.decrease])
    foot = -case.decrease * case.gradient / (case.gradient @ case.gradient)
    reaches = [
        way * FAR * feasible_rate(-way * case.along, FAR, A, B, C=row, c=value)
        for way in (-1.0, 1.0)
    ]
    return np.array([foot + reach * case.along for reach in reaches])


def by_geometry(case: Case) -> Array:
    """Ends of the feasible set, (2, 2), where the line cuts the polygon's edges, or (0, 2)."""
    return cut_polygon(CORNERS, case.gradient, case.decrease, case.along)


def rows() -> list[Row]:
    """ρ*, and how long the feasible set is in each panel."""
    made = []
    for name, gradient in (("corner", CORNER), ("edge", EDGE)):
        case = Case("", "", gradient, 1.0)
        why = "The paper prints no figures; beside it the best of the polygon's corners"
        item = f"Fig. 1: ρ*, line through a {name}" if name == "corner" else "Fig. 1: ρ*, edge"
        rho = feasible_rate(gradient, PSI, A, B)
        made.append(near(item, None, rho, case.best, why, absolute=1e-9))
    for case in CASES:
        ends, known = by_solvers(case), by_geometry(case)
        why = "As the paper's caption; beside it where the line cuts the polygon's edges"
        item = f"Fig. 1{case.name[0]}: {case.what}"
        count = _count(ends)
        counts = (float(_count(known)),) * 2
        made.append(bounded(f"{item}, ends found", None, count, counts, why))
        if count:
            made += [
                near(f"{item}, length", None, _length(ends), _length(known), why, unit="rad/s",
                     absolute=ROUNDING),
                bounded(f"{item}, error of its ends", 0, float(np.abs(ends - known).max()),
                        (None, ROUNDING), why, unit="rad/s"),
                bounded(f"{item}, distance of u* from it", 0, _off(case, known),
                        (None, ROUNDING), why, unit="rad/s"),
            ]  # fmt: skip
    return made


def draw() -> Figure:
    """The paper's three panels, and its special case as a fourth."""
    return Figure(
        "fig1",
        "Fig. 1: A u ≤ b and ∇V·u = −ρΨ, two joints",
        (tuple(_panel(case) for case in CASES),),
        (14.0, 3.8),
    )


def _panel(case: Case) -> Panel:
    outline = np.vstack([CORNERS, CORNERS[:1]])
    foot = -case.decrease * case.gradient / (case.gradient @ case.gradient)
    line = np.array([foot - FAR * case.along, foot + FAR * case.along])
    curves = [
        Curve("A u ≤ b", outline[:, 0], outline[:, 1], COLOURS[0], "area"),
        Curve("∇V·u = −ρΨ", line[:, 0], line[:, 1], COLOURS[1]),
    ]
    ends = by_solvers(case)
    if _count(ends) > 1:
        curves.append(
            Curve("feasible", ends[:, 0], ends[:, 1], COLOURS[2], marker="o", legend="feasible set")
        )
    elif len(ends):
        curves.append(
            Curve("feasible", ends[:1, 0], ends[:1, 1], COLOURS[2], dash="", marker="o",
                  legend="feasible set")
        )  # fmt: skip
    if len(ends):
        u = lyapunov_qp(case.gradient, case.decrease, 0.0, A, B)
        curves.append(
            Curve("u*, γ = 0", u[:1], u[1:], INK, dash="", marker="*"),
        )
    return Panel(
        case.name,
        f"({case.name[0]}) {case.what}",
        Axis("u1_rad_per_s", "u₁ [rad/s]", (-1.6, 2.2), step=1.0),
        Axis("u2_rad_per_s", "u₂ [rad/s]", (-1.6, 2.2), step=1.0),
        tuple(curves),
        square=True,
    )


def _length(ends: Array) -> float:
    return float(np.linalg.norm(ends[1] - ends[0])) if len(ends) else 0.0


def _count(ends: Array) -> int:
    """0 for nothing, 1 for a point, 2 for a segment."""
    return 0 if not len(ends) else 2 if _length(ends) > ROUNDING else 1


def _off(case: Case, known: Array) -> float:
    """How far QP12's answer lies from the segment between two points."""
    u = lyapunov_qp(case.gradient, case.decrease, 0.0, A, B)
    span = known[1] - known[0]
    length = float(span @ span)
    share = min(max(float((u - known[0]) @ span) / length, 0.0), 1.0) if length else 0.0
    return math.dist(u, known[0] + share * span)
