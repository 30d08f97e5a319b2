"""Gonçalves, Adorno, Crosnier, Fraisse, "Stable-by-Design Kinematic Control Based on Optimization".

IEEE Transactions on Robotics 36(3), 2020: Figs. 4 to 8 and Table I. Everything is done twice: in
case A with Ψ as printed, and in case C without its 1/√n, which is what the figures fit.
"""

from __future__ import annotations

from collections.abc import Callable

from tools.reproduce.figures import Figure
from tools.reproduce.rows import Row


def remake(say: Callable[[str], None]) -> tuple[list[Figure], list[Row]]:
    """Do the experiments, then the timing of Table I."""
    from tools.bench.solvers import bench_solvers  # noqa: PLC0415 - these load numba and Pinocchio
    from tools.reproduce.papers.qp12 import checks, drawings, experiments, table  # noqa: PLC0415

    trials = experiments.run_trials(say)
    say("Table I: timing solvers")
    timed = bench_solvers()
    figures = [*drawings.draw_all(trials), table.draw(timed)]
    return figures, [*checks.check_all(trials, experiments.plain_pinv()), *table.rows(timed)]
