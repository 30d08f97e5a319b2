"""Liu, Tan, Padois, "Generalized Hierarchical Control", Autonomous Robots 40(1), 2015.

Table 1 and Figs. 1 to 11 are closed loops of the shipped controllers `ghc`, `hqp` and `weighted`,
in lockstep with the emulator's rigid body; Fig. 12 is timed. Exact are priorities by (15) and the
bounds of Fig. 8; errors, torques and jerk depend on targets, start and inertia, which are not
printed.
"""

from __future__ import annotations

from collections.abc import Callable

from hoap3.tools.reproduce.figures import Figure
from hoap3.tools.reproduce.rows import Row


def remake(say: Callable[[str], None]) -> tuple[list[Figure], list[Row]]:
    """Do the runs, then the timing of Fig. 12."""
    from hoap3.tools.reproduce.papers.ghc import (
        alphas,
        compromise,
        errors_figure,
        lemniscate,
        networks,
        pressing,
        switching,
        table1,
        times,
    )

    runs = switching.run_all(say)
    both = {switching.FAST_S: runs.fast, switching.SLOW_S: runs.slow}
    figures = [
        alphas.draw(both),
        errors_figure.errors("fig2", "Fig. 2: HQP", runs.hqp),
        errors_figure.errors("fig3", "Fig. 3: GHC", runs.fast, switching.FAST_S),
        errors_figure.errors("fig4", "Fig. 4: GHC", runs.slow, switching.SLOW_S),
        errors_figure.jerk(runs.shown),
    ]
    rows = [*alphas.rows(both), *table1.rows(runs), *switching.jerk_rows(runs.shown)]
    eight, alone = lemniscate.run_all(say)
    figures += lemniscate.draw(eight)
    rows += [*lemniscate.rows(eight), *lemniscate.rows_alone(alone)]
    pressed = pressing.press(say=say)
    figures += pressing.draw(pressed)
    rows += pressing.rows(pressed)
    by_alpha, by_weight = compromise.run_all(say)
    figures.append(compromise.draw(by_alpha, by_weight))
    rows += compromise.rows(by_alpha, by_weight)
    say("Fig. 12: timing")
    timed = times.measure()
    return [*figures, times.draw(timed)], [*rows, *networks.rows(), *times.rows(timed)]
