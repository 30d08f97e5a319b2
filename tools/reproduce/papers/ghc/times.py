"""Fig. 12: how long a solution takes, over the number of tasks. Ours are measurements."""

from __future__ import annotations

from typing import Any

import numpy as np

from hoap3.tools.bench.hierarchy import HEADLINE, OURS, PAPER_MS, TASKS, bench_hierarchy
from hoap3.tools.reproduce.figures import COLOURS, Axis, Curve, Figure, Panel, mark
from hoap3.tools.reproduce.rows import Row, bounded, measured

SAMPLES = 10
ROBOTS = {"lwr": "7 joints", "humanoid32": "32 joints"}


def measure(samples: int = SAMPLES, tasks: tuple[int, ...] = TASKS) -> list[dict[str, Any]]:
    """Rows of `bench_hierarchy` without bounds, as in the figure."""
    found = bench_hierarchy(samples, tasks)["rows"]
    return [row for row in found if row["case"] == "free" and row["times_ghc"] is not None]


def rows(timed: list[dict[str, Any]]) -> list[Row]:
    """Times of five tasks, and the trends."""
    ours = {(row["robot"], row["tasks"]): row for row in timed if row["solver"] == OURS}
    most = max(tasks for _, tasks in ours)
    least = min(tasks for _, tasks in ours)
    made = []
    for robot, name in ROBOTS.items():
        for row in timed:
            if row["robot"] == robot and row["tasks"] == HEADLINE:
                paper = PAPER_MS[robot] if row["solver"] == OURS else None
                kind = "GHC as here" if row["solver"] == OURS else f"(13) by {row['solver']}"
                item = f"Fig. 12: {name}, {HEADLINE} tasks, {kind}, median"
                why = _TIME if row["solver"] == OURS else _PLAIN
                ours_ms = 1e-3 * row["p50_us"]
                made.append(measured(item, paper, ours_ms, why, unit="ms", timed=True))
        growth = ours[robot, most]["min_us"] / ours[robot, least]["min_us"]
        made.append(
            bounded(f"Fig. 12: {name}, {most} tasks / {least}", "increases", growth, (1.0, None),
                    _TREND)
        )  # fmt: skip
    sizes = ours["humanoid32", HEADLINE]["min_us"] / ours["lwr", HEADLINE]["min_us"]
    item = f"Fig. 12: {HEADLINE} tasks, 32 joints / 7 joints"
    made.append(bounded(item, "increases", sizes, (1.0, None), _TREND))
    return made


def draw(timed: list[dict[str, Any]]) -> Figure:
    """Medians over the number of tasks, and the paper's two means."""
    panels = []
    for robot, name in ROBOTS.items():
        curves = []
        for solver, colour in zip(_solvers(timed), COLOURS, strict=False):
            picked = [row for row in timed if (row["robot"], row["solver"]) == (robot, solver)]
            x = np.array([float(row["tasks"]) for row in picked])
            y = np.array([1e-3 * row["p50_us"] for row in picked])
            label = "GHC as here" if solver == OURS else f"(13) by {solver}"
            curves.append(Curve(label, x, y, colour, marker="o"))
        curves.append(mark("the paper, mean", float(HEADLINE), PAPER_MS[robot], "X"))
        axis = Axis("time_ms", "time of one solution [ms]", log=True)
        panels.append(Panel(robot, name, Axis("tasks", "tasks [1]", step=1.0), axis, curves))
    title = "Fig. 12: absolute times are of other hardware, only the trends compare"
    return Figure("fig12", title, [panels], (12.0, 4.5))


def _solvers(timed: list[dict[str, Any]]) -> list[str]:
    return list(dict.fromkeys(row["solver"] for row in timed))


_TIME = (
    "Other hardware, and another formulation: n unknowns in one compiled call; absolute times do "
    "not compare. `hoap3 bench hierarchy` has all of them, also with bounds"
)
_PLAIN = "The paper's formulation, k·n + n unknowns, on this machine; without what Pinocchio takes"
_TREND = "As the paper: time grows with the tasks and with the joints; only the trend is judged"
