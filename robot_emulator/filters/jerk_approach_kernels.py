"""Compiled: accelerations that bring joints to rest at their setpoints, of many joints at once.

Each is found by Newton's method: 1 to 7 steps, and each of them a long chain of roots and
quotients. One loop does a step of all joints that are left, and has no branch in it, so that the
processor does several of them at a time. No joint's answer depends on another's.
"""

from __future__ import annotations

from hoap3.protocol.limits.jerk_limits_kernels import MOST_STEPS_OF_NEWTON, stop_way
from hoap3.protocol.limits.setpoint_limits_kernels import within
from hoap3.protocol.runtime.numba_jit import Vector, inlined

NEAR = 1e-9  # of JT: what is as near as that to a solution on one straight piece is on it
EDGE = 1e-7  # of JT: on such a way no stop's derivative grows eightfold

JOINTS = 32
"""How many problems at once; a row of `work` has as many numbers."""

LANES = 8
"""How many numbers a processor works out at once, at most: what is left over is slow."""

U, AWAY, LEAST, MOST, GREATEST, FOUND, PLACE, OPEN, SIDE, ANSWER, END = range(
    0, 11 * JOINTS, JOINTS
)
"""Where rows begin in `work`.

Up to OPEN they are of problems, and move up as others are solved; those of ANSWER are of all that
were asked, in their order. From END on is room for whoever asks.
"""


@inlined
def whole(count: int) -> int:
    """As many lanes as it takes, but no part of a handful."""
    return (count + LANES - 1) // LANES * LANES


@inlined
def ask_stop(
    work: Vector,
    i: int,
    asked: bool,
    u: float,
    x: float,
    away: float,
    least: float,
    most: float,
    N: float,
) -> None:
    """Pose problem i: the acceleration after which the stop ends `away`, or nearest to it.

    Where the stop ends rises with it, convex where the stop is downwards and concave where it is
    upwards. Newton's method passes the solution once at most, and then comes nearer from one side.
    It begins where the stop goes on as it did.

    Args:
        work: at least (END,).
        i: which.
        asked: whether anybody wants to know.
        u, x: velocity and acceleration over the last period.
        away: how far away the place to stop at is.
        least, most: of the next acceleration.
        N: greatest acceleration of the stop.
    """
    back = away < 0.0
    side = -1.0 if back else 1.0
    u, x, away = side * u, side * x, side * away
    least, most = -most if back else least, -least if back else most
    ahead = max(most, 0.0)
    top = max(u + most + 0.5 * ahead * ahead, 0.0)
    steps = ahead + top / N + N + 2.0
    far = u + most + top * steps <= away
    eased = (x < 0.0) & (u <= 0.5 * x * (x - 1.0))
    guess = x + 1.0 if eased | (u + 0.5 * top * steps <= away) else x - 1.0
    work[U + i], work[AWAY + i], work[GREATEST + i] = u, away, N
    work[LEAST + i], work[MOST + i] = least, most
    work[FOUND + i], work[SIDE + i] = most if far else within(guess, least, most), side
    work[PLACE + i], work[OPEN + i] = i, 1.0 if asked & (not far) else 0.0


@inlined
def solve_stops(work: Vector, count: int) -> None:
    """Solve as many problems, each as of `ask_stop`, and write what was asked for to ANSWER."""
    left = _still_open(work, count)
    for _ in range(MOST_STEPS_OF_NEWTON):
        if left == 0:
            break
        for i in range(whole(left)):
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
        work[ANSWER + int(work[PLACE + i])] = work[FOUND + i]
        again = work[OPEN + i]
        for row in range(U, OPEN, JOINTS):
            work[row + still] = work[row + i]
        still += 1 if again > 0.0 else 0
    return still
