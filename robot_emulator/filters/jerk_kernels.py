"""Compiled safety filter of a robot with a limit of jerk: any stream becomes a motion within all.

At each tick a joint has an interval of accelerations: within its greatest one, no farther than JT
from the last one, such that it can be released before the velocity is too great, and such that the
joint can brake before its walls (`jerk_limits_kernels`). The interval is never empty, whatever the
setpoint asks for, and an acceleration of it is taken: docs/jerk.md has the proof.
"""

from __future__ import annotations

import math

from hoap3.protocol.robot.jerk.jerk_limits_kernels import (
    below_wall,
    brake_rise,
    release_reserve,
    within_velocity,
)
from hoap3.protocol.robot.jerk.jerk_takeover_kernels import (
    Limits,
    Motion,
    asked_of,
    of_joint,
    taken,
)
from hoap3.protocol.robot.setpoint_limits_kernels import (
    JointLimits,
    stopping_speed,
    within,
)
from hoap3.protocol.runtime.numba_jit import Matrix, Vector, inlined, kernel
from hoap3.robot_emulator.filters.jerk_approach_kernels import (
    ANSWER,
    JOINT,
    JOINTS,
    OFFSET,
    ask_stop,
    solve_stops,
)
from hoap3.robot_emulator.filters.position_kernels import follow_one

PLANNED = 1.0 - 1e-8
"""Of acceleration and jerk that an approach counts on: what is left corrects what rounding did."""


@inlined
def within_all(wanted: float, at: Motion, own: Limits) -> float:
    """The next acceleration nearest to the wanted one that keeps all limits now and later."""
    u, x, N = at.v * own.velocity, at.a * own.acceleration, own.N
    least, most = max(x - 1.0, -N), min(x + 1.0, N)
    asked = wanted * own.acceleration
    y, far = within(asked, least, most), abs(at.q)
    fast = own.fast - release_reserve(far * own.place, own.fast, y)
    side, bound = (1.0, least) if y > 0.0 else (-1.0, -most)
    y = side * max(within_velocity(side * u, side * y, fast), bound)
    up, down = (own.upper - at.q) * own.place, (at.q - own.lower) * own.place
    y = below_wall(u, y, least, up, max(far, abs(own.upper)) * own.place, N)
    y = -below_wall(-u, -y, -most, down, max(far, abs(own.lower)) * own.place, N)
    step = own.J * own.T
    a = wanted if y == asked else y * step
    return within(a, max(at.a - step, -own.A), min(at.a + step, own.A))


@inlined
def moved(a: float, at: Motion, own: Limits) -> Motion:
    """One period with an acceleration."""
    v = within(at.v + a * own.T, -own.speed, own.speed)
    return Motion(within(at.q + v * own.T, own.lower, own.upper), v, a)


@inlined
def approach_unit(own: Limits) -> float:
    """What turns accelerations into those of an approach, in units of what it counts on."""
    more = 1.0 / PLANNED
    return own.acceleration * more


@inlined
def ask_approach(
    work: Vector,
    asked: int,
    left: int,
    start: float,
    r: float,
    c: float,
    at: Motion,
    own: Limits,
) -> int:
    """Ask what brings a joint nearer to a setpoint that comes from `start`, so as to meet it there.

    The joint does as one at rest does whose place, velocity and acceleration are the differences
    from the setpoint's, with what the setpoint's acceleration leaves of A; see `ask_stop`.
    """
    more, unit = 1.0 / PLANNED, approach_unit(own)
    x, y, N = at.a * unit, c * unit, own.A * unit
    u, away = (at.v - r) * own.velocity * more + y, (start - at.q) * own.place * more
    least, most = max(x - more, -N) - y, min(x + more, N) - y
    work[OFFSET + asked] = y
    greatest = max(own.N - abs(y), 0.125 * own.N)
    return ask_stop(work, asked, left, u, x - y, away, least, most, greatest)


@kernel()
def filter_jerk(
    setpoint: Vector,
    history: Matrix,
    limits: Matrix,
    T: float,
    value: Vector,
    velocity: Vector,
    acceleration: Vector,
    work: Vector,
) -> int:
    """Move `value` to the setpoint, or as near and as fast as the limits allow; arrays are (n,).

    What is `taken` is so bit by bit. A joint without a limit of jerk moves as of `filter_setpoint`.

    Args:
        setpoint: what is asked for [rad or m]. Beyond a limit it is the limit that counts, and for
            NaN the place where a joint is.
        history: (3, n) what was so one, two and three periods ago; the setpoint is added.
        limits: (5, n) least and greatest position, greatest speed, acceleration and jerk; inf: no
            limit of jerk.
        T: period [s].
        value: applied reference, changed in place.
        velocity, acceleration: of the reference over the last period, changed in place.
        work: (WORK,) room for the problems of `jerk_approach_kernels`; nothing is kept in it.

    Returns:
        The number of the first joint that was held back, or -1.
    """
    held = -1
    for first in range(0, value.size, JOINTS):
        last = min(first + JOINTS, value.size)
        asked, left = 0, 0
        for i in range(first, last):
            at, before = Motion(value[i], velocity[i], acceleration[i]), history[0, i]
            if limits[4, i] < math.inf:
                own, earlier = of_joint(limits, i, T), (before, history[1, i], history[2, i])
                s, start, r, c, slack = asked_of(setpoint[i], earlier, at.q, own)
                there, motion = taken(s, r, c, slack, at, own)
                if there:
                    value[i], velocity[i], acceleration[i] = motion
                else:
                    left = ask_approach(work, asked, left, start, r, c, at, own)
                    work[JOINT + asked] = i
                    asked += 1
            else:
                plain = JointLimits(limits[0, i], limits[1, i], limits[2, i], limits[3, i])
                q, w = follow_one(setpoint[i], before, at.q, at.v, plain, T)
                value[i], velocity[i], acceleration[i] = q, w, (w - at.v) / T
            history[2, i], history[1, i], history[0, i] = history[1, i], before, setpoint[i]
        solve_stops(work, left)
        for place in range(asked):
            i = int(work[JOINT + place])
            own, at = of_joint(limits, i, T), Motion(value[i], velocity[i], acceleration[i])
            wanted = (work[OFFSET + place] + work[ANSWER + place]) / approach_unit(own)
            value[i], velocity[i], acceleration[i] = moved(within_all(wanted, at, own), at, own)
        for i in range(first, last):
            if value[i] != setpoint[i] and held < 0:
                held = i
    return held


@kernel()
def steer(
    wanted: Vector,
    limits: Matrix,
    T: float,
    value: Vector,
    velocity: Vector,
    acceleration: Vector,
) -> int:
    """Go on with the velocities wanted, (n,), as far as the limits allow; see `filter_jerk`.

    A joint that cannot do so comes to rest as fast as it can.

    Returns:
        The number of the first joint that was held back, or -1.
    """
    held = -1
    for i in range(value.size):
        own, at = of_joint(limits, i, T), Motion(value[i], velocity[i], acceleration[i])
        a = (wanted[i] - at.v) / T
        if within_all(a, at, own) == a:
            at = Motion(within(at.q + wanted[i] * T, own.lower, own.upper), wanted[i], a)
        else:
            rest = -math.copysign(stopping_speed(abs(at.v), own.J, T), at.v)
            at = moved(within_all(rest, at, own), at, own)
            if held < 0:
                held = i
        value[i], velocity[i], acceleration[i] = at
    return held


@kernel()
def brake_ends(
    limits: Matrix,
    T: float,
    value: Vector,
    velocity: Vector,
    acceleration: Vector,
    lowest: Vector,
    highest: Vector,
) -> None:
    """Where joints get at least, whatever they do: least and greatest places, (n,) each."""
    for i in range(value.size):
        own = of_joint(limits, i, T)
        u, x = velocity[i] * own.velocity, acceleration[i] * own.acceleration
        highest[i] = value[i] + brake_rise(u, x, own.N)[0] / own.place
        lowest[i] = value[i] - brake_rise(-u, -x, own.N)[0] / own.place
