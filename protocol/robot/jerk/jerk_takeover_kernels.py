"""Compiled: which setpoints a robot with a limit of jerk takes over.

Both sides judge with it, as with `setpoint_limits_kernels`: the robot what it applies, a controller
what it certifies.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from hoap3.protocol.robot.jerk.jerk_limits_kernels import able_to_brake, release
from hoap3.protocol.robot.setpoint_limits_kernels import rounding, within
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
def of_joint(limits: Matrix, i: int, T: float) -> Limits:
    """Column i of (5, n) limits."""
    speed, A, J = limits[2, i], limits[3, i], limits[4, i]
    if not math.inf > J:
        J = WITHOUT * A / T
    acceleration = 1.0 / (J * T)
    velocity = acceleration / T
    place = velocity / T
    return Limits(
        limits[0, i], limits[1, i], speed, A, J, T,
        place, velocity, acceleration, speed * velocity, A * acceleration,
    )  # fmt: skip


@inlined
def own_motion(
    s: float, history: tuple[float, float, float], slack: float, own: Limits
) -> tuple[float, float, float]:
    """Where the setpoint's last step began, its velocity and its acceleration.

    After a jump, which is what no joint within these limits does, it is at rest at s.

    Args:
        s, history: the setpoint, and those of one, two and three periods ago.
        slack: of velocities, because of rounding.
        own: limits.
    """
    before, earlier, first = history
    per_s = 1.0 / own.T
    near = SLACKS * slack * per_s
    r, last = (s - before) * per_s, (before - earlier) * per_s
    c, b = (r - last) * per_s, (last - (earlier - first) * per_s) * per_s
    moves = (
        (abs(r) <= own.speed + slack)
        & (own.speed + slack < math.inf)
        & (abs(c) <= own.A + near)
        & (abs(c - b) <= own.J * own.T + 2.0 * near)
    )
    return before if moves else s, r if moves else 0.0, c if moves else 0.0


@inlined
def asked_of(
    setpoint: float, history: tuple[float, float, float], q: float, own: Limits
) -> tuple[float, float, float, float, float]:
    """What a setpoint asks of a joint at q: s, and its own motion.

    Beyond a limit it is the limit that counts, and for what is no place the one where the joint is.

    Returns:
        s, where its last step began, its velocity, its acceleration; and the slack of velocities
        because of rounding.
    """
    s = within(setpoint, own.lower, own.upper)
    if math.isnan(setpoint) or not abs(s) < math.inf:
        return q, q, 0.0, 0.0, rounding(q, q, own.T)
    before, earlier, first = history
    slack = rounding(s, q, own.T)
    if math.isnan(before) or math.isnan(earlier) or math.isnan(first):
        return s, s, 0.0, 0.0, slack
    inside = (
        within(before, own.lower, own.upper),
        within(earlier, own.lower, own.upper),
        within(first, own.lower, own.upper),
    )
    start, r, c = own_motion(s, inside, slack, own)
    return s, start, r, c, slack


@inlined
def taken(
    s: float, r: float, c: float, slack: float, at: Motion, own: Limits
) -> tuple[bool, Motion]:
    """Whether a joint can go to s in one period and do on the next what is asked for; its motion.

    That is: within all limits, able to brake before all of them, and able to go on with velocity
    r + cT and then acceleration c, as the setpoint does. NaN is not.
    """
    per_s = 1.0 / own.T
    w, near, step = (s - at.q) / own.T, SLACKS * slack * per_s, own.J * own.T
    a = (w - at.v) / own.T
    onward = (r + c * own.T - w) * per_s
    fast = own.speed + slack
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
    )
    if not kept:
        return False, at
    u, x = w * own.velocity, a * own.acceleration
    if x * u > 0.0 and abs(u) + release(abs(x)) > own.fast + SLACKS * slack * own.velocity:
        return False, at
    up, down, far = (own.upper - s) * own.place, (s - own.lower) * own.place, abs(s)
    if not able_to_brake(u, x, up, max(far, abs(own.upper)) * own.place, own.N):
        return False, at
    if not able_to_brake(-u, -x, down, max(far, abs(own.lower)) * own.place, own.N):
        return False, at
    return True, Motion(s, w, a)
