"""Compiled safety filter: any stream of setpoints becomes a motion within the limits.

At each tick a joint has an interval of velocities: within its greatest speed, no farther than A·T
from the last one, and such that it can still stop before its walls. The interval is never empty
(`setpoint_limits_kernels`), whatever the setpoint asks for, and a velocity of it is taken.
"""

from __future__ import annotations

import math

from hoap3.protocol.limits.setpoint_limits_kernels import (
    INSIDE,
    SAME,
    ULP,
    JointLimits,
    approach_speed,
    own_start,
    taken_over,
    within,
)
from hoap3.protocol.messages import FloatArray
from hoap3.protocol.runtime.numba_jit import inlined, kernel


@inlined
def follow_one(
    setpoint: float, before: float, q: float, v: float, limits: JointLimits, T: float
) -> tuple[float, float]:
    """Where one joint goes, and how fast; see `filter_setpoint`."""
    lower, upper, speed, A = limits
    change = A * T
    s = within(setpoint, lower, upper)
    start = own_start(within(before, lower, upper), s, q, speed, T)
    if math.isnan(setpoint) or not abs(s) < math.inf:
        s = start = q
    elif math.isnan(before):
        start = s
    if taken_over(s, start, q, v, limits, T):
        tight = change - 2.0 * ULP * (abs(v) + change)
        # kept without the slack that `taken_over` grants to the rounding of (s − q)/T
        return s, within((s - q) / T, max(-speed, v - tight), min(speed, v + tight))
    A, apart = INSIDE * A, start - q
    along, least, most = (s - start) / T, v - A * T, v + A * T
    fast = abs(along) + min(speed, max(-least, most))  # no more is of use
    w = along + math.copysign(approach_speed(fast, abs(apart), s, speed, A, T), apart)
    w = within(within(w, -speed, speed), least, most)
    if w > 0.0:
        w = max(approach_speed(w, upper - q, upper, speed, A, T), least)
    elif w < 0.0:
        w = min(-approach_speed(-w, q - lower, lower, speed, A, T), most)
    return within(q + w * T, lower, upper), w


@kernel("i8(f8[::1], f8[::1], f8[:,::1], f8, f8[::1], f8[::1])")
def filter_setpoint(
    setpoint: FloatArray,
    before: FloatArray,
    limits: FloatArray,
    T: float,
    value: FloatArray,
    velocity: FloatArray,
) -> int:
    """Move `value` to the setpoint, or as near and as fast as the limits allow; arrays are (n,).

    A joint follows the setpoint's own motion as soon as it is there; until then it approaches it
    so that it can stop at it. What is `taken_over` is so bit by bit.

    Args:
        setpoint, before: what is asked for, and what was asked for one period ago [rad or m].
            Beyond a limit it is the limit that counts, and for NaN the place where a joint is.
        limits: (4, n) least and greatest position, greatest speed, greatest acceleration.
        T: period [s].
        value: applied reference, changed in place.
        velocity: of the reference over the last period, changed in place [rad/s or m/s].

    Returns:
        The number of the first joint that was held back, or -1.
    """
    held = -1
    for i in range(value.size):
        limit = JointLimits(limits[0, i], limits[1, i], limits[2, i], limits[3, i])
        value[i], velocity[i] = follow_one(setpoint[i], before[i], value[i], velocity[i], limit, T)
        if held < 0 and not abs(value[i] - setpoint[i]) <= SAME:
            held = i
    return held
