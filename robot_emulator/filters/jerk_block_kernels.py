"""Compiled: a block of joints with limits of jerk, which goes to setpoints or approaches them.

Each loop is over all joints of the block and has no branch in it, so that the processor does
several of them at a time. What cannot be done so, near a wall, is done joint by joint after it.
No joint's motion depends on another's.
"""

from __future__ import annotations

import math

from hoap3.protocol.limits.jerk_takeover_kernels import (
    Limits,
    Motion,
    asked_of,
    brakes_in_time,
    limits_of,
    motion_to,
    plainly_brakes,
)
from hoap3.protocol.runtime.numba_jit import Matrix, Vector, inlined
from hoap3.robot_emulator.filters.jerk_approach_kernels import (
    ANSWER,
    END,
    JOINTS,
    SIDE,
    ask_stop,
    solve_stops,
    whole,
)
from hoap3.robot_emulator.filters.jerk_interval_kernels import (
    as_acceleration,
    far_from_walls,
    moved,
    within_all,
    within_speed,
)

PLANNED = 1.0 - 1e-8
"""Of acceleration and jerk that an approach counts on: what is left corrects what rounding did."""

(
    SETPOINT, BEFORE, EARLIER, FIRST, Q, V, A, LOWER, UPPER, SPEED, MOST_A, JERK,
    J, ONE_PLACE, ONE_VELOCITY, ONE_ACCELERATION, FAST, N,
    START, RATE, CHANGE, NEXT_Q, NEXT_V, NEXT_A, TAKEN, OFFSET, FREE, WORK,
) = range(END, END + 28 * JOINTS, JOINTS)  # fmt: skip
"""Where rows begin in `work`, after those of the approaches; WORK is its length.

The first twelve are what is given: setpoints, those of one, two and three periods ago, the motions,
and the limits. Then come the further fields of `Limits`: J is finite, JERK may not be.

START, RATE and CHANGE are of the setpoint's own motion, OFFSET is its acceleration in units of the
approach. NEXT_Q, NEXT_V and NEXT_A are where the joint goes. TAKEN is 1 where that is the setpoint.
FREE is 1 where no wall is so near that the joint must be looked at by itself. Both are 1 for joints
without a limit of jerk, which are not moved here.
"""


@inlined
def take_in(
    work: Vector,
    begin: int,
    count: int,
    setpoint: Vector,
    history: Matrix,
    limits: Matrix,
    motion: Matrix,
) -> None:
    """Copy what is given of joints from `begin` on; as of `filter_jerk`."""
    for i in range(count):
        work[SETPOINT + i] = setpoint[begin + i]
        work[BEFORE + i], work[EARLIER + i] = history[0, begin + i], history[1, begin + i]
        work[FIRST + i] = history[2, begin + i]
    for i in range(count):
        work[Q + i], work[V + i] = motion[0, begin + i], motion[1, begin + i]
        work[A + i] = motion[2, begin + i]
    for i in range(count):
        work[LOWER + i], work[UPPER + i] = limits[0, begin + i], limits[1, begin + i]
        work[SPEED + i], work[MOST_A + i] = limits[2, begin + i], limits[3, begin + i]
        work[JERK + i] = limits[4, begin + i]
    for i in range(count, whole(count)):  # no joints, but numbers
        for row in range(SETPOINT, JERK, JOINTS):
            work[row + i] = 1.0
        work[JERK + i], work[ANSWER + i] = math.inf, 0.0


@inlined
def hand_out(
    work: Vector,
    begin: int,
    count: int,
    history: Matrix,
    motion: Matrix,
) -> None:
    """Copy where they go, and let the setpoint become the one before."""
    for i in range(count):
        history[2, begin + i], history[1, begin + i] = work[EARLIER + i], work[BEFORE + i]
        history[0, begin + i] = work[SETPOINT + i]
    for i in range(count):
        motion[0, begin + i], motion[1, begin + i] = work[NEXT_Q + i], work[NEXT_V + i]
        motion[2, begin + i] = work[NEXT_A + i]


@inlined
def find_motions(work: Vector, count: int, T: float) -> None:
    """Find where each joint goes from what is given."""
    if _go_to_setpoints(work, count, T) < count:
        _ask_approaches(work, count, T)
        solve_stops(work, count)
        _approach(work, count, T)


@inlined
def _limits(work: Vector, i: int, T: float) -> Limits:
    return Limits(
        work[LOWER + i], work[UPPER + i], work[SPEED + i], work[MOST_A + i], work[J + i], T,
        work[ONE_PLACE + i], work[ONE_VELOCITY + i], work[ONE_ACCELERATION + i],
        work[FAST + i], work[N + i],
    )  # fmt: skip


@inlined
def _set_limits(work: Vector, i: int, T: float) -> Limits:
    own = limits_of(
        work[LOWER + i], work[UPPER + i], work[SPEED + i], work[MOST_A + i], work[JERK + i], T
    )
    work[J + i], work[FAST + i], work[N + i] = own.J, own.fast, own.N
    work[ONE_PLACE + i], work[ONE_VELOCITY + i] = own.place, own.velocity
    work[ONE_ACCELERATION + i] = own.acceleration
    return own


@inlined
def _at(work: Vector, i: int) -> Motion:
    return Motion(work[Q + i], work[V + i], work[A + i])


@inlined
def _set_next(work: Vector, i: int, motion: Motion) -> None:
    work[NEXT_Q + i], work[NEXT_V + i], work[NEXT_A + i] = motion


@inlined
def _go_to_setpoints(work: Vector, count: int, T: float) -> int:
    """Go where setpoints can be taken over: how many can."""
    for i in range(whole(count)):
        own, at = _set_limits(work, i, T), _at(work, i)
        earlier = work[BEFORE + i], work[EARLIER + i], work[FIRST + i]
        s, start, r, c, slack = asked_of(work[SETPOINT + i], earlier, at.q, own)
        kept, motion = motion_to(s, r, c, slack, at, own)
        _set_next(work, i, motion)
        work[START + i], work[RATE + i], work[CHANGE + i] = start, r, c
        work[TAKEN + i] = 1.0 if kept | (not work[JERK + i] < math.inf) else 0.0
        free = plainly_brakes(motion, own) | (not work[JERK + i] < math.inf)
        work[FREE + i] = 1.0 if free else 0.0
    taken = 0
    for i in range(count):
        if work[TAKEN + i] > work[FREE + i]:  # but for a wall that may be too near
            motion = Motion(work[NEXT_Q + i], work[NEXT_V + i], work[NEXT_A + i])
            work[TAKEN + i] = 1.0 if brakes_in_time(motion, _limits(work, i, T)) else 0.0
        taken += 1 if work[TAKEN + i] > 0.0 else 0
    return taken


@inlined
def _unit(own: Limits) -> float:
    """What turns accelerations into those of an approach, in units of what it counts on."""
    more = 1.0 / PLANNED
    return own.acceleration * more


@inlined
def _ask_approaches(work: Vector, count: int, T: float) -> None:
    """Ask what brings joints nearer to setpoints, so as to meet them there.

    A joint does as one at rest does whose place, velocity and acceleration are the differences
    from the setpoint's, with what the setpoint's acceleration leaves of A; see `ask_stop`.
    """
    more = 1.0 / PLANNED
    for i in range(whole(count)):
        own, at = _limits(work, i, T), _at(work, i)
        unit = _unit(own)
        x, y, planned = at.a * unit, work[CHANGE + i] * unit, own.A * unit
        u = (at.v - work[RATE + i]) * own.velocity * more + y
        away = (work[START + i] - at.q) * own.place * more
        least, most = max(x - more, -planned) - y, min(x + more, planned) - y
        greatest = max(own.N - abs(y), 0.125 * own.N)
        work[OFFSET + i] = y
        ask_stop(work, i, not work[TAKEN + i] > 0.0, u, x - y, away, least, most, greatest)


@inlined
def _wanted(work: Vector, i: int, own: Limits) -> float:
    """The acceleration of an approach."""
    found: float = work[OFFSET + i] + work[SIDE + i] * work[ANSWER + i]
    return found / _unit(own)


@inlined
def _approach(work: Vector, count: int, T: float) -> None:
    """Go as the approaches want to, as far as all limits allow."""
    for i in range(whole(count)):
        own, at = _limits(work, i, T), _at(work, i)
        wanted, goes = _wanted(work, i, own), work[TAKEN + i] > 0.0
        y = within_speed(wanted, at, own)
        q, v, a = moved(as_acceleration(y, wanted, at, own), at, own)
        work[FREE + i] = 1.0 if goes | far_from_walls(y, at, own) else 0.0
        work[NEXT_Q + i] = work[NEXT_Q + i] if goes else q
        work[NEXT_V + i] = work[NEXT_V + i] if goes else v
        work[NEXT_A + i] = work[NEXT_A + i] if goes else a
    for i in range(count):
        if not work[FREE + i] > 0.0:
            own, at = _limits(work, i, T), _at(work, i)
            _set_next(work, i, moved(within_all(_wanted(work, i, own), at, own), at, own))
