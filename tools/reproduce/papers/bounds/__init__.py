"""Del Prete, "Joint Position and Velocity Bounds in Discrete-Time Acceleration/Torque Control".

IEEE Robotics and Automation Letters 3(1), 2018. Figs. 1 to 3 are about one joint's states, Fig. 4
moves one joint, and Fig. 5 is the left arm of Baxter under task-space inverse dynamics. What moves
does so with the shipped bounds and the shipped controllers.
"""

from __future__ import annotations

from collections.abc import Callable

from hoap3.tools.reproduce.figures import Figure
from hoap3.tools.reproduce.rows import Row


def remake(say: Callable[[str], None]) -> tuple[list[Figure], list[Row]]:
    """Do the sets, then the motions."""
    from hoap3.tools.reproduce.papers.bounds import (
        elbow,
        elbow_figure,
        one_joint,
        one_joint_figure,
        orderings,
        regions,
        viable_set,
    )

    say("Fig. 1: what is viable")
    figures, rows = [viable_set.draw()], viable_set.rows()
    say("Fig. 2: orderings of the accelerations")
    shares = orderings.count_all()
    figures.append(orderings.draw(shares))
    rows += orderings.rows(shares)
    say("Fig. 3: which bound is the least")
    found = regions.classify()
    figures.append(regions.draw(found))
    rows += regions.rows(found)
    say("Fig. 4: one joint")
    runs = one_joint.run_all()
    figures.append(one_joint_figure.draw(runs))
    rows += one_joint.rows(runs)
    arms = elbow.run_all(say)
    figures.append(elbow_figure.draw(arms))
    rows += elbow.rows(arms)
    return figures, rows
