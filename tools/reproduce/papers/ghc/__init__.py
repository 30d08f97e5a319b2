"""Liu, Tan, Padois, "Generalized Hierarchical Control", Autonomous Robots 40(1), 2015.

Table 1 and Figs. 1 to 11 are closed loops of the shipped controllers `ghc` and `hqp`, in lockstep
with the emulator's rigid body; Fig. 12 is timed.
"""

from hoap3.tools.reproduce.papers import Made, Say


def remake(say: Say) -> Made:
    """Do all runs, and time solutions."""
    from hoap3.tools.reproduce.papers.ghc import figures, rows, runs, times

    found = runs.run_all(say)
    say("Fig. 12: timing")
    timed = times.measure()
    return (
        [*figures.draw_all(found), times.draw(timed)],
        [*rows.rows(found), *times.rows(timed)],
    )
