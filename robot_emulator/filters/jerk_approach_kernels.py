"""Compiled: accelerations that bring joints to rest at their setpoints, of many joints at once.

Each is found by Newton's method: 1 to 7 steps, and each of them a long chain of roots and
quotients. One loop does a step of all joints that are left, and has no branch in it, so that the
processor does several of them at a time. No joint's answer depends on another's.
"""

from __future__ import annotations

from hoap3.protocol.robot.jerk.jerk_limits_kernels import MOST_STEPS_OF_NEWTON, stop_way
from hoap3.protocol.robot.setpoint_limits_kernels import within
from hoap3.protocol.runtime.numba_jit import Vector, inlined

NEAR = 1e-9  # of JT: what is as near as that to a solution on one straight piece is on it
EDGE = 1e-7  # of JT: on such a way no stop's derivative grows eightfold

JOINTS = 32
"""How many problems at once; a row of `work` has as many numbers."""

U, AWAY, LEAST, MOST, GREATEST, FOUND, OPEN, SIDE, PLACE, ANSWER, JOINT, OFFSET, WORK = range(
    0, 13 * JOINTS, JOINTS
)
"""Where rows begin in `work`.

Up to PLACE they are of problems that are open, which move up as others are solved; from ANSWER on
of all that were asked, in their order. JOINT and OFFSET are for whoever asks. WORK is the length.
"""


@inlined
def ask_stop(
    work: Vector,
    asked: int,
    left: int,
    u: float,
    x: float,
    away: float,
    least: float,
    most: float,
    N: float,
) -> int:
    """Ask for the acceleration after which the stop ends `away`, or nearest to it.

    Where the stop ends rises with it, convex where the stop is downwards and concave where it is
    upwards. Newton's method passes the solution once at most, and then comes nearer from one side.
    It begins where the stop goes on as it did.

    Args:
        work: (WORK,).
        asked, left: how many were asked already, and how many of them are open.
        u, x: velocity and acceleration over the last period.
        away: how far away the place to stop at is.
        least, most: of the next acceleration.
        N: greatest acceleration of the stop.

    Returns:
        How many are open now.
    """
    side = -1.0 if away < 0.0 else 1.0
    u, x, away = side * u, side * x, side * away
    least, most = (-most if side < 0.0 else least), (-least if side < 0.0 else most)
    ahead = max(most, 0.0)
    top = max(u + most + 0.5 * ahead * ahead, 0.0)
    steps = ahead + top / N + N + 2.0
    far = u + most + top * steps <= away
    eased = (x < 0.0) & (u <= 0.5 * x * (x - 1.0))
    guess = x + 1.0 if eased | (u + 0.5 * top * steps <= away) else x - 1.0
    work[U + left], work[AWAY + left], work[GREATEST + left] = u, away, N
    work[LEAST + left], work[MOST + left] = least, most
    work[FOUND + left], work[SIDE + left] = within(guess, least, most), side
    work[PLACE + left], work[ANSWER + asked] = asked, side * most
    return left + (0 if far else 1)


@inlined
def solve_stops(work: Vector, left: int) -> None:
    """Solve the problems that are open, each as of `ask_stop`, and write what was asked for."""
    for _ in range(MOST_STEPS_OF_NEWTON):
        if left == 0:
            break
        for i in range(left):
            u, y, N = work[U + i], work[FOUND + i], work[GREATEST + i]
            way, slope = stop_way(u + y, y, N)
            step = (u + y + way - work[AWAY + i]) / (1.0 + slope)
            nearer = within(y - step, work[LEAST + i], work[MOST + i])
            gone = abs(nearer - y)
            beyond = (gone <= EDGE) & (8.0 * gone < abs(step))  # so it stays at this bound
            work[FOUND + i] = nearer
            work[OPEN + i] = 0.0 if (gone <= NEAR) | beyond else 1.0
        left = _still_open(work, left)


@inlined
def _still_open(work: Vector, left: int) -> int:
    """Write down where the problems have got to, and move up those that are open: how many."""
    still = 0
    for i in range(left):
        work[ANSWER + int(work[PLACE + i])] = work[SIDE + i] * work[FOUND + i]
        again = work[OPEN + i]
        for row in range(U, ANSWER, JOINTS):
            work[row + still] = work[row + i]
        still += 1 if again > 0.0 else 0
    return still
