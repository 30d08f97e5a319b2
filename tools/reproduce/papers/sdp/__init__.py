"""Marti-Saumell et al., "Multi-task closed-loop inverse kinematics stability through SDP".

J. Marti-Saumell, A. Santamaria-Navarro, C. Ocampo-Martinez, J. Andrade-Cetto; SDP is semidefinite
programming. Figs. 1 to 7 are runs of a UR5 by Euler's method, as the paper's: kinematics, gains and
nothing else, with the solvers that the controllers `clik` and `clik_sdp` have. Beside them stand
what the paper claims and does not show, where it is wrong, and a humanoid, which it has not.
"""

from __future__ import annotations

from collections.abc import Callable

from hoap3.tools.reproduce.figures import Figure
from hoap3.tools.reproduce.rows import Row


def remake(say: Callable[[str], None]) -> tuple[list[Figure], list[Row]]:
    """Do the runs of the UR5, then those of the humanoid."""
    from hoap3.tools.reproduce.papers.sdp import (
        claims,
        conventions,
        corrections,
        drawings,
        humanoid,
        oracle,
        runs,
        table,
    )

    ur5 = runs.run_all(say)
    figures = drawings.draw_all(ur5)
    say("The same runs by the oracle: plain numpy, about a minute")
    expected = oracle.run_all()
    rows = [*table.rows(ur5, expected), *claims.rows(ur5, expected)]
    say("Other frames, and the UR5 of the emulator")
    rows += conventions.rows(ur5.fast, conventions.run_all())
    say("What the paper has wrong")
    rows += corrections.rows(ur5)
    whole_body = humanoid.run_all(say)
    figures.append(humanoid.draw(whole_body))
    return figures, [*rows, *humanoid.rows(whole_body)]
