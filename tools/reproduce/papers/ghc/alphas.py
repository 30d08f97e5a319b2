"""Fig. 1, the hierarchies as they change, and (15): priorities of the runs beside the formula.

The paper's Fig. 1 is a drawing; the curves of α stand above Figs. 3 and 4.
"""

from __future__ import annotations

import numpy as np

from hoap3.tools.reproduce.figures import COLOURS, Array, Axis, Curve, Figure, Panel
from hoap3.tools.reproduce.papers.ghc.reference import PHASES
from hoap3.tools.reproduce.papers.ghc.runs import PHASE_S, Run
from hoap3.tools.reproduce.rows import Row, bounded

EXACT = 1e-12
ABOVE = (
    ((0, 1), (0, 2), (1, 2)),
    ((1, 0), (2, 0), (2, 1)),
    ((0, 1), (2, 0), (2, 1)),
    ((2, 0), (1, 0), (1, 1), (1, 2)),
    ((1, 0), (2, 0), (2, 1)),
)
"""Where α is 1, by phase: (i, j) says that task j stands above task i. In the fourth, task 2 takes
no part: it is kept out of everything, also of itself, and is in nobody's way."""

PAIRS = ((0, 1), (0, 2), (1, 2), (1, 1))
"""Shown; of each pair, the other is 1 − α, but where task 2 is removed."""


def hierarchy(phase: int) -> Array:
    """The matrix of a phase, (3, 3)."""
    found = np.zeros((3, 3))
    for pair in ABOVE[phase]:
        found[pair] = 1.0
    return found


def expected(time_s: Array, over_s: float, phase_s: float = PHASE_S) -> Array:
    """The matrix by (15), without the code that the controller uses, (N, 3, 3)."""
    found = np.tile(hierarchy(0), (len(time_s), 1, 1))
    for phase in range(1, len(PHASES)):
        passed = np.clip((time_s - phase * phase_s) / over_s, 0.0, 1.0)
        share = 0.5 - 0.5 * np.cos(np.pi * passed)
        found += share[:, None, None] * (hierarchy(phase) - hierarchy(phase - 1))
    return found


def rows(runs: dict[float, Run], phase_s: float = PHASE_S) -> list[Row]:
    """α beside (15), by the duration of transitions."""
    why = (
        "Exact: all nine priorities at every tick, with five hierarchies, one removal and insertion"
    )
    return [
        bounded(f"Fig. 1: greatest |α − (15)|, transitions of {over:g} s", 0,
                float(np.abs(run.alpha - expected(run.time_s, over, phase_s)).max()),
                (None, EXACT), why)
        for over, run in runs.items()
    ]  # fmt: skip


def draw(runs: dict[float, Run]) -> Figure:
    """α over time, a panel a duration."""
    panels = tuple(panel(f"{over:g}s", over, run) for over, run in runs.items())
    title = "Fig. 1 and (15): α_ij, the priority of task j over task i"
    return Figure("fig1", title, tuple((each,) for each in panels), (10.0, 3.0 * len(panels)))


def panel(name: str, over_s: float, run: Run) -> Panel:
    """α of one run."""
    curves = tuple(
        Curve(f"α_{i + 1}{j + 1}", run.time_s, run.alpha[:, i, j].copy(), colour, dash=dash)
        for (i, j), colour, dash in zip(PAIRS, COLOURS, ("-", "--", "-.", ":"), strict=False)
    )
    return Panel(
        name,
        f"transitions of {over_s:g} s",
        Axis("time_s", "time [s]", step=PHASE_S),
        Axis("alpha", "α [1]", (-0.05, 1.05)),
        curves,
    )
