"""Gonçalves, Adorno, Crosnier, Fraisse, "Stable-by-Design Kinematic Control Based on Optimization".

IEEE Transactions on Robotics 36(3), 2020. Its experiment, Figs. 4 to 8 and Table I, is done in
three readings of (16): A as printed with e in metres, B as printed with e in centimetres, and C in
metres without 1/√n.
"""

from hoap3.tools.reproduce.papers import Made, Say


def remake(say: Say) -> Made:
    """Do all motions, by the controllers and by the oracle, and time solvers."""
    from hoap3.tools.bench.solvers import bench_solvers
    from hoap3.tools.reproduce.papers.qp12 import fig1, figures, oracle, rows, runs, times

    trials, plain = runs.run_trials(say), runs.plain_pinv()
    say("the same motions by the oracle")
    expected = rows.rows(trials, plain, oracle.all_trials(), oracle.plain_pinv())
    say("Table I: timing solvers")
    timed = times.rows(bench_solvers())
    return [fig1.draw(), *figures.draw_all(trials)], [*fig1.rows(), *expected, *timed]
