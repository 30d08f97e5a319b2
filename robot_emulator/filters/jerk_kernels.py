"""Compiled safety filter of a robot with a limit of jerk: any stream becomes a motion within all.

At each tick a joint has an interval of accelerations: within its greatest one, no farther than JT
from the last one, such that it can be released before the velocity is too great, and such that the
joint can brake before its walls (`jerk_limits_kernels`). The interval is never empty, whatever the
setpoint asks for, and an acceleration of it is taken: docs/jerk.md has the proof.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from hoap3.protocol.robot.jerk_limits_kernels import (
    able_to_brake,
    below_wall,
    brake_rise,
    next_for_stop,
    release,
    within_velocity,
)
from hoap3.protocol.robot.setpoint_limits_kernels import (
    JointLimits,
    rounding,
    stopping_speed,
    within,
)
from hoap3.protocol.runtime.numba_jit import Matrix, Vector, inlined, kernel
from hoap3.robot_emulator.filters.position_kernels import follow_one

SLACKS = 4.0
"""Units of the last place of a position that a third difference of roundings may make."""


class Limits(NamedTuple):
    """Of one joint: positions, and greatest speed, acceleration and jerk [rad, s or m, s]."""

    lower: float
    upper: float
    speed: float
    A: float
    J: float


class Motion(NamedTuple):
    """Of one joint: place, and velocity and acceleration over the last period."""

    q: float
    v: float
    a: float


@inlined
def of_joint(limits: Matrix, i: int) -> Limits:
    """Column i of (5, n) limits."""
    return Limits(limits[0, i], limits[1, i], limits[2, i], limits[3, i], limits[4, i])


@inlined
def own_motion(
    s: float, before: float, earlier: float, q: float, own: Limits, T: float
) -> tuple[float, float, float]:
    """Where the setpoint's last step began, its velocity and its acceleration.

    After a jump, which is what is faster than the joint, or accelerates more, it is at rest at s.
    """
    slack = rounding(s, q, T)
    r = (s - before) / T
    c = (r - (before - earlier) / T) / T
    if abs(r) <= own.speed + slack and abs(c) <= own.A + SLACKS * slack / T:
        return before, r, c
    return s, 0.0, 0.0


@inlined
def within_all(wanted: float, at: Motion, own: Limits, T: float) -> float:
    """The next acceleration nearest to the wanted one that keeps all limits now and later."""
    J = own.J
    scale = 1.0 / (J * T * T * T)
    u, x, N = at.v * T * scale, at.a * T * T * scale, own.A * T * T * scale
    fast = own.speed * T * scale
    least, most = max(x - 1.0, -N), min(x + 1.0, N)
    asked = wanted * T * T * scale
    y = within(asked, least, most)
    if y > 0.0:
        y = max(within_velocity(u, y, fast), least)
    elif y < 0.0:
        y = min(-within_velocity(-u, -y, fast), most)
    far = abs(at.q)
    up, down = (own.upper - at.q) * scale, (at.q - own.lower) * scale
    y = below_wall(u, y, least, up, max(far, abs(own.upper)) * scale, N)
    y = -below_wall(-u, -y, -most, down, max(far, abs(own.lower)) * scale, N)
    a = wanted if y == asked else y * J * T
    return within(a, max(at.a - J * T, -own.A), min(at.a + J * T, own.A))


@inlined
def moved(a: float, at: Motion, own: Limits, T: float) -> Motion:
    """One period with an acceleration."""
    v = within(at.v + a * T, -own.speed, own.speed)
    return Motion(within(at.q + v * T, own.lower, own.upper), v, a)


@inlined
def taken(s: float, r: float, c: float, at: Motion, own: Limits, T: float) -> tuple[bool, Motion]:
    """Whether a joint can go to s in one period and do on the next what is asked for; its motion.

    That is: within all limits, able to brake before all of them, and able to go on with velocity
    r + cT and then acceleration c, as the setpoint does. NaN is not.
    """
    w, slack = (s - at.q) / T, rounding(s, at.q, T)
    a, change, near = (w - at.v) / T, own.J * T, SLACKS * slack / T
    if not (own.lower <= s <= own.upper and abs(w) <= own.speed + slack):
        return False, at
    if not (abs(a - at.a) <= change + near and abs(a) <= own.A + near):
        return False, at
    tight = within(a, max(at.a - change, -own.A), min(at.a + change, own.A))
    v = w if tight == a else at.v + tight * T
    v = within(v, -own.speed, own.speed)
    onward = (r + c * T - v) / T
    near += near
    if abs(onward - tight) > change + near or abs(c - onward) > change + near:
        return False, at
    if abs(onward) > own.A + near:
        return False, at
    scale = 1.0 / (own.J * T * T * T)
    u, x, N = v * T * scale, tight * T * T * scale, own.A * T * T * scale
    fast = (own.speed + SLACKS * slack) * T * scale
    if x * u > 0.0 and abs(u) + release(abs(x)) > fast:
        return False, at
    up, down = (own.upper - s) * scale, (s - own.lower) * scale
    far = abs(s)
    if not able_to_brake(u, x, up, max(far, abs(own.upper)) * scale, N):
        return False, at
    if not able_to_brake(-u, -x, down, max(far, abs(own.lower)) * scale, N):
        return False, at
    return True, Motion(s, v, tight)


@inlined
def approached(
    start: float, r: float, c: float, at: Motion, own: Limits, T: float
) -> Motion:
    """One period nearer to a setpoint that comes from `start`, so that it can be met there."""
    scale = 1.0 / (own.J * T * T * T)
    x, N, y = at.a * T * T * scale, own.A * T * T * scale, c * T * T * scale
    u, away = (at.v - r) * T * scale + y, (start - at.q) * scale
    least, most = max(x - 1.0, -N) - y, min(x + 1.0, N) - y
    left = max(N - abs(y), 0.125 * N)
    wanted = y + next_for_stop(u, away, least, most, left)
    return moved(within_all(wanted * own.J * T, at, own, T), at, own, T)


@inlined
def followed(
    setpoint: float, before: float, earlier: float, at: Motion, own: Limits, T: float
) -> Motion:
    """One period of a joint; see `filter_jerk`."""
    s = within(setpoint, own.lower, own.upper)
    start, r, c = own_motion(
        s, within(before, own.lower, own.upper), within(earlier, own.lower, own.upper), at.q, own, T
    )
    if not (setpoint == setpoint and abs(s) < math.inf):
        s = start = at.q
        r = c = 0.0
    elif before != before or earlier != earlier:
        start, r, c = s, 0.0, 0.0
    there, motion = taken(s, r, c, at, own, T)
    if there:
        return motion
    return approached(start, r, c, at, own, T)


@kernel()
def filter_jerk(
    setpoint: Vector,
    before: Vector,
    earlier: Vector,
    limits: Matrix,
    T: float,
    value: Vector,
    velocity: Vector,
    acceleration: Vector,
) -> int:
    """Move `value` to the setpoint, or as near and as fast as the limits allow; arrays are (n,).

    What is `taken` is so bit by bit. A joint without a limit of jerk moves as of `filter_setpoint`.

    Args:
        setpoint, before, earlier: what is asked for, and what was so one period and two periods
            ago [rad or m]. Beyond a limit it is the limit that counts, and for NaN the place
            where a joint is.
        limits: (5, n) least and greatest position, greatest speed, acceleration and jerk; inf: no
            limit of jerk.
        T: period [s].
        value: applied reference, changed in place.
        velocity, acceleration: of the reference over the last period, changed in place.

    Returns:
        The number of the first joint that was held back, or -1.
    """
    held = -1
    for i in range(value.size):
        own, at = of_joint(limits, i), Motion(value[i], velocity[i], acceleration[i])
        if own.J < math.inf:
            at = followed(setpoint[i], before[i], earlier[i], at, own, T)
            value[i], velocity[i], acceleration[i] = at
        else:
            plain = JointLimits(own.lower, own.upper, own.speed, own.A)
            q, w = follow_one(setpoint[i], before[i], at.q, at.v, plain, T)
            value[i], velocity[i], acceleration[i] = q, w, (w - at.v) / T
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
        own, at = of_joint(limits, i), Motion(value[i], velocity[i], acceleration[i])
        if not own.J < math.inf:
            own = Limits(own.lower, own.upper, own.speed, own.A, 4.0 * own.A / T)
        a = (wanted[i] - at.v) / T
        found = within_all(a, at, own, T)
        if found == a:
            at = Motion(within(at.q + wanted[i] * T, own.lower, own.upper), wanted[i], a)
        else:
            rest = -math.copysign(stopping_speed(abs(at.v), own.J, T), at.v)
            at = moved(within_all(rest, at, own, T), at, own, T)
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
        own = of_joint(limits, i)
        jerk = own.J if own.J < math.inf else 4.0 * own.A / T
        unit = jerk * T * T * T
        u, x, N = velocity[i] * T / unit, acceleration[i] * T * T / unit, own.A * T * T / unit
        highest[i] = value[i] + brake_rise(u, x, N)[0] * unit
        lowest[i] = value[i] - brake_rise(-u, -x, N)[0] * unit
