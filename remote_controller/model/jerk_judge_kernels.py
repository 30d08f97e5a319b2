"""Compiled: whether a robot with a limit of jerk will take over an answer."""

from __future__ import annotations

import math

from hoap3.protocol.limits.jerk_takeover_kernels import (
    Motion,
    asked_of,
    brakes_in_time,
    motion_to,
    of_joint,
)
from hoap3.protocol.runtime.numba_jit import Matrix, Vector, kernel


@kernel()
def held_by_jerk(
    answer: Vector, answers: Matrix, reference: Vector, references: Matrix, limits: Matrix, T: float
) -> int:
    """How many joints with a limit of jerk the robot will hold back; arrays are (n,) [rad or m].

    Args:
        answer: to the State of now.
        answers: (3, n) those to the States of one, two and three periods ago; moves on by one.
        reference: that the robot applies.
        references: (2, n) those of one and two periods ago; moves on by one.
        limits: (5, n) as of `filter_jerk` of the robot.
        T: period [s].
    """
    held = 0
    for i in range(answer.size):
        q, last, before = reference[i], references[0, i], references[1, i]
        v, history = (q - last) / T, (answers[0, i], answers[1, i], answers[2, i])
        references[1, i], references[0, i] = last, q
        answers[2, i], answers[1, i], answers[0, i] = answers[1, i], answers[0, i], answer[i]
        if not limits[4, i] < math.inf:
            continue
        own, at = of_joint(limits, i, T), Motion(q, v, (v - (last - before) / T) / T)
        s, _start, r, c, slack = asked_of(answer[i], history, q, own)
        kept, motion = motion_to(s, r, c, slack, at, own)
        held += not (kept and brakes_in_time(motion, own)) or s != answer[i]
    return held
