"""Gonçalves, Adorno, Crosnier, Fraisse, "Stable-by-Design Kinematic Control Based on Optimization".

IEEE Transactions on Robotics 36(3), 2020. Its experiment, Figs. 4 to 8 and Table I, is done in
three readings of (16): A as printed with e in metres, B as printed with e in centimetres, and C in
metres without 1/√n. Beside it stand Fig. 1, Example 2, and what the paper has no experiment of:
persistent motion, an obstacle, a target beyond the support polygon, and statements of section III;
and the same displacement in MuJoCo, on one held foot and on the robot's own two feet.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib.util import find_spec

from hoap3.tools.reproduce.figures import Figure
from hoap3.tools.reproduce.rows import Row


def remake(say: Callable[[str], None]) -> tuple[list[Figure], list[Row]]:
    """Do the analysis, the experiments, then the timing of Table I."""
    from hoap3.tools.bench.solvers import bench_solvers
    from hoap3.tools.reproduce.papers.qp12 import (
        checks,
        circulation,
        drawings,
        example2,
        experiments,
        fig1,
        obstacle,
        oracle,
        own_feet,
        statements,
        support,
        table,
    )

    say("Fig. 1 and Example 2")
    answers = example2.solve()
    figures = [fig1.draw(), example2.draw(answers)]
    rows = [*fig1.rows(), *example2.rows(answers)]
    rounds, ball, edge = circulation.circulate(say), obstacle.go(say), support.go(say)
    figures += [circulation.draw(rounds), obstacle.draw(ball), support.draw(edge)]
    rows += [*circulation.rows(rounds), *obstacle.rows(ball), *support.rows(edge)]
    rows += statements.rows(say)
    trials = experiments.run_trials(say)
    figures += drawings.draw_all(trials)
    say("the same motions by the oracle")
    expected = oracle.all_trials(), oracle.plain_pinv()
    rows += checks.check_all(trials, experiments.plain_pinv(), *expected)
    if find_spec("mujoco") is None:
        say("on its own feet: left out, as it needs hoap3[mujoco]")
    else:
        held, standing = own_feet.one_foot(say), own_feet.both_feet(say)
        figures.append(own_feet.draw(held, standing))
        rows += own_feet.rows(held, standing, own_feet.too_fast(say))
    say("Table I: timing solvers")
    timed = bench_solvers()
    return [*figures, table.draw(timed)], [*rows, *table.rows(timed)]
