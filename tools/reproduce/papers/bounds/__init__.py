"""Del Prete, "Joint Position and Velocity Bounds in Discrete-Time Acceleration/Torque Control".

IEEE Robotics and Automation Letters 3(1), 2018. Figs. 1 to 3 are about one joint's states, Fig. 4
moves one joint, and Fig. 5 is the left arm of Baxter under task-space inverse dynamics. What moves
does so with the shipped bounds and the shipped controllers.
"""

from hoap3.tools.reproduce.papers import Made, Say


def remake(say: Say) -> Made:
    """Find the viable states, the orderings and the regions, and do all motions."""
    from hoap3.tools.reproduce.papers.bounds import elbow, figures, joint, rows

    say("Figs. 1 to 3: what is viable, orderings of the accelerations, and the least bound")
    shares, regions = joint.count_all(), joint.classify()
    say("Fig. 4: one joint")
    runs, arms = joint.run_all(), elbow.run_all(say)
    drawn = [
        figures.draw_viable(),
        figures.draw_regions(regions),
        figures.draw_motions(runs),
        figures.draw_elbow(arms),
    ]
    return drawn, rows.rows(shares, regions, runs, arms)
