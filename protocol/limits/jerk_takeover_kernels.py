"""Compiled: which setpoints a robot with a limit of jerk takes over.

Both sides judge with it, as with `setpoint_limits_kernels`: the robot what it applies, a controller
what it certifies.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from hoap3.protocol.limits.jerk_limits_kernels import (
    able_to_brake,
    plainly_able_to_brake,
    release,
)
from hoap3.protocol.limits.setpoint_limits_kernels import rounding, within
from hoap3.protocol.runtime.numba_jit import Matrix, inlined

WITHOUT = 4.0
"""Of A/T: a jerk that no change of acceleration has, for joints without a limit."""

SLACKS = 4.0
"""Units of the last place of a position that a third difference of roundings may make."""


class Limits(NamedTuple):
    """Of one joint [rad, s or m, s], and what turns its motion into the units of the brakes.

    Attributes:
        lower, upper: positions.
        speed, A, J: greatest velocity, acceleration and jerk.
        T: period.
        place, velocity, acceleration: one over JT³, JT² and JT.
        fast, N: `speed` and A in these units.
    """

    lower: float
    upper: float
    speed: float
    A: float
    J: float
    T: float
    place: float
    velocity: float
    acceleration: float
    fast: float
    N: float


class Motion(NamedTuple):
    """Of one joint: place, and velocity and acceleration over the last period."""

    q: float
    v: float
    a: float


@inlined
def limits_of(lower: float, upper: float, speed: float, A: float, jerk: float, T: float) -> Limits:
    """Limits of a joint whose jerk may be inf: without a limit of it."""
    J = jerk if jerk < math.inf else WITHOUT * A / T
    acceleration = 1.0 / (J * T)
    velocity = acceleration / T
    place = velocity / T
    return Limits(
        lower, upper, speed, A, J, T,
        place, velocity, acceleration, speed * velocity, A * acceleration,
    )  # fmt: skip


@inlined
def of_joint(limits: Matrix, i: int, T: float) -> Limits:
    """Column i of (5, n) limits."""
    return limits_of(limits[0, i], limits[1, i], limits[2, i], limits[3, i], limits[4, i], T)


@inlined
def asked_of(
    setpoint: float, history: tuple[float, float, float], q: float, own: Limits
) -> tuple[float, float, float, float, float]:
    """What a setpoint asks of a joint at q: s, and its own motion.

    Beyond a limit it is the limit that counts, and for what is no place the one where the joint is.
    After a jump, which is what no joint within these limits does, it is at rest at s.

    Args:
        setpoint, history: what is asked for, and what was so one, two and three periods ago.
        q: where the joint is.
        own: limits.

    Returns:
        s, where its last step began, its velocity, its acceleration; and the slack of velocities
        because of rounding.
    """
    s = within(setpoint, own.lower, own.upper)
    some = (not math.isnan(setpoint)) & (abs(s) < math.inf)
    s = s if some else q
    before, earlier, first = history
    known = some & (not (math.isnan(before) | math.isnan(earlier) | math.isnan(first)))
    before = within(before, own.lower, own.upper)
    earlier = within(earlier, own.lower, own.upper)
    first = within(first, own.lower, own.upper)
    slack, per_s = rounding(s, q, own.T), 1.0 / own.T
    near = SLACKS * slack * per_s
    r, last = (s - before) * per_s, (before - earlier) * per_s
    c, b = (r - last) * per_s, (last - (earlier - first) * per_s) * per_s
    moves = (
        known
        & (abs(r) <= own.speed + slack)
        & (own.speed + slack < math.inf)
        & (abs(c) <= own.A + near)
        & (abs(c - b) <= own.J * own.T + 2.0 * near)
    )
    return s, before if moves else s, r if moves else 0.0, c if moves else 0.0, slack


@inlined
def motion_to(
    s: float, r: float, c: float, slack: float, at: Motion, own: Limits
) -> tuple[bool, Motion]:
    """How a joint goes to s in one period; and whether it may, but for its walls.

    That is: within all other limits, and able to go on with velocity r + cT and then acceleration
    c, as the setpoint does. NaN is not.
    """
    per_s = 1.0 / own.T
    w, near, step = (s - at.q) / own.T, SLACKS * slack * per_s, own.J * own.T
    a = (w - at.v) / own.T
    onward = (r + c * own.T - w) * per_s
    fast, u, x = own.speed + slack, w * own.velocity, a * own.acceleration
    eased = abs(u) + release(abs(x)) <= own.fast + SLACKS * slack * own.velocity
    kept = (
        (own.lower <= s)
        & (s <= own.upper)
        & (abs(w) <= fast)
        & (fast < math.inf)
        & (abs(a - at.a) <= step + near)
        & (abs(a) <= own.A + near)
        & (abs(onward - a) <= step + 2.0 * near)
        & (abs(c - onward) <= step + 2.0 * near)
        & (abs(onward) <= own.A + 2.0 * near)
        & ((not x * u > 0.0) | eased)
    )
    return kept, Motion(s, w, a)


@inlined
def rooms(q: float, own: Limits) -> tuple[float, float, float, float]:
    """Up to the upper wall, and how far from 0 that or the joint is; down to the lower likewise."""
    up, down, far = (own.upper - q) * own.place, (q - own.lower) * own.place, abs(q)
    return up, max(far, abs(own.upper)) * own.place, down, max(far, abs(own.lower)) * own.place


@inlined
def plainly_brakes(at: Motion, own: Limits) -> bool:
    """Whether a joint can brake before its walls by far."""
    u, x = at.v * own.velocity, at.a * own.acceleration
    up, above, down, below = rooms(at.q, own)
    higher = plainly_able_to_brake(u, x, up, above, own.N)
    return higher & plainly_able_to_brake(-u, -x, down, below, own.N)


@inlined
def brakes_in_time(at: Motion, own: Limits) -> bool:
    """Whether a joint can brake before its walls."""
    u, x = at.v * own.velocity, at.a * own.acceleration
    up, above, down, below = rooms(at.q, own)
    if not able_to_brake(u, x, up, above, own.N):
        return False
    return able_to_brake(-u, -x, down, below, own.N)
