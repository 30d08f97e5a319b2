"""Fig. 1, the hierarchies as they change, and (15): priorities of the runs beside the formula.

The paper's Fig. 1 is a drawing; the curves of α stand above Figs. 3 and 4.
"""

from __future__ import annotations

import numpy as np

from hoap3.tools.reproduce.figures import Axis, Figure, Panel, column, lines
from hoap3.tools.reproduce.papers.ghc import reference as ref
from hoap3.tools.reproduce.papers.ghc.reference import expected
from hoap3.tools.reproduce.papers.ghc.runs import Run
from hoap3.tools.reproduce.rows import Row, bounded

EXACT = 1e-12
PAIRS = ((0, 1), (0, 2), (1, 2), (1, 1))
"""Shown; of each pair, the other is 1 − α, but where task 2 is removed."""


def rows(runs: dict[float, Run], phase_s: float = ref.PHASE_S) -> list[Row]:
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
    panels = [panel(f"{over:g}s", over, run) for over, run in runs.items()]
    title = "Fig. 1 and (15): α_ij, the priority of task j over task i"
    return column("fig1", title, panels, (10.0, 3.0 * len(panels)))


def panel(name: str, over_s: float, run: Run) -> Panel:
    """α of one run."""
    shown = {f"α_{i + 1}{j + 1}": (run.time_s, run.alpha[:, i, j]) for i, j in PAIRS}
    curves = lines(shown, ("-", "--", "-.", ":"))
    return Panel(
        name,
        f"transitions of {over_s:g} s",
        Axis("time_s", "time [s]", step=ref.PHASE_S),
        Axis("alpha", "α [1]", (-0.05, 1.05)),
        curves,
    )
