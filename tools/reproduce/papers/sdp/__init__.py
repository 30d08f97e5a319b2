"""Marti-Saumell et al., "Multi-task closed-loop inverse kinematics stability through SDP".

J. Marti-Saumell, A. Santamaria-Navarro, C. Ocampo-Martinez, J. Andrade-Cetto; SDP is semidefinite
programming. Figs. 1 to 7 are runs of a UR5 by Euler's method, as the paper's: kinematics, gains and
nothing else, with the solvers that the controllers `clik` and `clik_sdp` have.
"""

from hoap3.tools.reproduce.papers import Made, Say


def remake(say: Say) -> Made:
    """Do the runs, by the solvers and by the oracle."""
    from hoap3.tools.reproduce.papers.sdp import figures, oracle, rows, runs

    say("Figs. 1 to 7: the UR5 with constant gains, β̃ = 2 and 8, other limits and periods")
    found = runs.run_all()
    say("The same runs by the oracle: plain numpy, about a minute")
    return figures.draw_all(found), rows.rows(found, oracle.run_all())
