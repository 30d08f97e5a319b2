"""Fig. 1: which part of the polygon A u ≤ b the line ∇V·u = −ρΨ leaves, for two joints.

The paper gives no numbers; this is a square of 1 rad/s with a corner cut off. Solvers give what is
feasible: the LP (7) ρ*, and how far one may go either way along the line; `StableQp` the answer
there, or that there is none. Geometry is the polygon's corners, and where the line cuts its edges.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from hoap3.remote_controller.solvers import StableQp
from hoap3.remote_controller.solvers.lyapunov_qp.max_descent_lp import MaxDescentLp
from hoap3.tools.reproduce.figures import (
    COLOURS,
    Array,
    Axis,
    Figure,
    Panel,
    mark,
    trace,
)
from hoap3.tools.reproduce.rows import Row, like, table

A = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0], [1.0, 1.0]])
B = np.array([1.0, 1.0, 1.0, 1.0, 1.5])  # rad/s
CORNERS = np.array([[1.0, -1.0], [1.0, 0.5], [0.5, 1.0], [-1.0, 1.0], [-1.0, -1.0]])
NO_ROWS, NO_SIDES = np.zeros((0, 2)), np.zeros(0)
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
    def known(self) -> Array:
        """Ends of the feasible set by geometry, (2, 2), or (0, 2)."""
        return cut_polygon(CORNERS, self.gradient, self.decrease, self.along)

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
    if optimum(case) is None:
        return np.zeros((0, 2))
    row, value = case.gradient[None, :], np.array([-case.decrease])
    foot = -case.decrease * case.gradient / (case.gradient @ case.gradient)
    reaches = [way * FAR * feasible_rate(-way * case.along, FAR, row, value) for way in (-1.0, 1.0)]
    return np.array([foot + reach * case.along for reach in reaches])


def feasible_rate(gradient: Array, psi: float, C: Array = NO_ROWS, c: Array = NO_SIDES) -> float:
    """min(1, ρ*): the largest share of Ψ that A u ≤ b and C u = c allow, (6) with ρ ≤ 1."""
    steepest, nothing = MaxDescentLp(2, len(B), len(c)), np.full(2, np.inf)
    steepest.fill(gradient, A, B, C, c, -nothing, nothing)
    _, fall = steepest.fall(1.0, psi / steepest.top)
    return min(1.0, fall * steepest.top / psi)


def optimum(case: Case) -> Array | None:
    """QP12's answer for γ = 0, (2,); None where no u in the polygon has that decrease."""
    solver, nothing = StableQp(2, len(B), gamma=0.0), np.full(2, np.inf)
    solver.solve(case.gradient, case.decrease, 0.0, A, B, -nothing, nothing)
    return solver.u if abs(solver.rate + case.decrease) <= ROUNDING else None


def cut_polygon(corners: Array, gradient: Array, decrease: float, along: Array) -> Array:
    """Where the line gradient·u = −decrease cuts a polygon.

    Args:
        corners: of the polygon in order, (k, 2).
        gradient: (2,).
        decrease: how far V is to fall.
        along: unit vector along the line, (2,).

    Returns:
        The two ends, (2, 2), or (0, 2) where the line misses it.
    """
    levels = corners @ gradient + decrease
    levels[np.abs(levels) < 1e-12] = 0.0
    found = [corner for corner, level in zip(corners, levels, strict=True) if level == 0.0]
    closed = [*zip(corners, levels, strict=True), (corners[0], levels[0])]
    for (start, before), (end, after) in pairwise(closed):
        if before * after < 0.0:
            found.append(start + (end - start) * before / (before - after))
    if not found:
        return np.zeros((0, 2))
    points = np.array(found)
    order = np.argsort(points @ along)
    return points[order[[0, -1]]]


def rows() -> list[Row]:
    """ρ*, and how long the feasible set is in each panel."""
    why = "The paper prints no figures; beside it the best of the polygon's corners"
    made = table(
        "Fig. 1: ρ*, ",
        *((name, None, feasible_rate(gradient, PSI),
           like(Case("", "", gradient, 1.0).best, 1e-9), why)
          for name, gradient in (("line through a corner", CORNER), ("edge", EDGE))),
    )  # fmt: skip
    why = "As the paper's caption; beside it where the line cuts the polygon's edges"
    for case in CASES:
        ends, known = by_solvers(case), case.known
        item = f"Fig. 1{case.name[0]}: {case.what}, "
        made += table(item, ("ends found", None, _count(ends), (_count(known),) * 2, why))
        if _count(ends):
            made += table(
                item,
                ("error of its ends", 0, np.abs(ends - known).max(), (None, ROUNDING), why,
                 "rad/s"),
                ("distance of u* from it", 0, _off(case, known), (None, ROUNDING), why, "rad/s"),
            )  # fmt: skip
    return made


def draw() -> Figure:
    """The paper's three panels, and its special case as a fourth."""
    title = "Fig. 1: A u ≤ b and ∇V·u = −ρΨ, two joints"
    return Figure("fig1", title, ([_panel(case) for case in CASES],), (14.0, 3.8))


def _panel(case: Case) -> Panel:
    foot = -case.decrease * case.gradient / (case.gradient @ case.gradient)
    curves = [
        trace("A u ≤ b", np.vstack([CORNERS, CORNERS[:1]]), COLOURS[0], style="area"),
        trace("∇V·u = −ρΨ", foot + FAR * np.outer([-1.0, 1.0], case.along), COLOURS[1]),
    ]
    ends = by_solvers(case)[: 2 if _count(by_solvers(case)) > 1 else 1]
    if len(ends):
        dash = "-" if len(ends) > 1 else ""
        style = {"dash": dash, "marker": "o", "legend": "feasible set"}
        curves.append(trace("feasible", ends, COLOURS[2], **style))
        u = optimum(case)
        if u is not None:
            curves.append(mark("u*, γ = 0", u[0], u[1], "*"))
    u1, u2 = (Axis(f"u{i}_rad_per_s", f"u{sub} [rad/s]", (-1.6, 2.2), step=1.0)
              for i, sub in ((1, "₁"), (2, "₂")))  # fmt: skip
    return Panel(case.name, f"({case.name[0]}) {case.what}", u1, u2, curves, square=True)


def _count(ends: Array) -> int:
    """0 for nothing, 1 for a point, 2 for a segment."""
    return 0 if not len(ends) else 2 if math.dist(*ends) > ROUNDING else 1


def _off(case: Case, known: Array) -> float:
    """How far QP12's answer lies from the segment between two points."""
    u = optimum(case)
    if u is None:
        return math.nan
    span = known[1] - known[0]
    length = float(span @ span)
    share = min(max(float((u - known[0]) @ span) / length, 0.0), 1.0) if length else 0.0
    return math.dist(u, known[0] + share * span)
