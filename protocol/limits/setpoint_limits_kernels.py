"""Compiled: what a position-commanded robot takes over from a setpoint, and what it holds back.

The reference goes in straight lines from tick to tick, with velocity w over one of them. It may
change by A·T from one to the next, so from w a joint needs

    T (w + (w − AT) + (w − 2AT) + …)

to come to rest. The largest w for which that is no more than D is `stopping_speed`. Whoever never
exceeds it towards a limit, D away, keeps to that limit: braking from w ≤ stopping_speed(D) leaves
w − AT ≤ stopping_speed(D − wT), so there is always a next velocity that is allowed.

Both sides judge with these lines: the robot what it applies, a controller what it certifies.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from hoap3.protocol.runtime.numba_jit import inlined

ULP = 2.0**-52  # of a double, relative
SAME = 1e-12  # rad or m: a setpoint that is missed by no more is followed, but for rounding
INSIDE = 1.0 - 1e-12  # of the acceleration is counted on in braking, because of rounding
MOST_STEPS = 2.0**25  # nothing here takes longer to brake


@inlined
def within(value: float, least: float, most: float) -> float:
    """The nearest to `value` from `least` to `most`; `most` where they contradict each other."""
    return min(max(value, least), most)


@inlined
def rounding(s: float, q: float, T: float) -> float:
    """By how much rounding may spoil (s − q) / T less that of the period before.

    Each is half a unit of s = q + wT, and of the product, the difference and the quotient. Who
    goes from −w to w all the time, just as fast as is allowed, is not held back for that.
    """
    return ULP * (max(abs(s), abs(q)) + 3.0 * abs(s - q)) / T


@inlined
def stopping_speed(room: float, acceleration: float, T: float) -> float:
    """Largest velocity from which a joint comes to rest within `room`, in steps of T.

    Braking takes n steps, the least integer with D ≤ AT²·n(n + 1)/2, and

        w = (D/T + AT·n(n − 1)/2) / n

    Args:
        room: D [rad or m]; none at or below 0. What takes more than `MOST_STEPS` does not count.
        acceleration: A [rad/s² or m/s²].
        T: period [s].
    """
    change = acceleration * T
    room = min(room, change * T * (0.5 * MOST_STEPS * MOST_STEPS))
    if not room > 0.0:
        return 0.0
    steps = max(1.0, math.ceil((math.sqrt(1.0 + 8.0 * (room / T / change)) - 1.0) / 2.0))
    return (room / T + change * steps * (steps - 1.0) / 2.0) / steps


@inlined
def brake_reserve(place: float, room: float, speed: float, acceleration: float, T: float) -> float:
    """Room that rounding may cost while a joint brakes to `place`, from `speed` at most.

    Meanwhile it is as far away as that takes, or as it is now, `room`, whichever is less.
    """
    if not abs(place) < math.inf:
        return 0.0  # there is no such wall
    steps = min(speed / (acceleration * T), MOST_STEPS) + 2.0
    return 8.0 * ULP * steps * (abs(place) + min(0.5 * steps * speed * T, max(room, 0.0)))


@inlined
def approach_speed(
    wanted: float, room: float, place: float, speed: float, acceleration: float, T: float
) -> float:
    """As much of `wanted` ≥ 0 as lets a joint stop at `place`, that is `room` away.

    Braking keeps a reserve of room, which the last step may use. A square root is only taken where
    w²/2A + wT/2 + AT²/8, which is what braking takes at most, is more than there is.

    Args:
        wanted: velocity towards the place.
        room, place: [rad or m].
        speed: the joint never is faster.
        acceleration: of braking.
        T: period [s].
    """
    left = room - brake_reserve(place, room, speed, acceleration, T)
    if 0.5 * wanted * (wanted / acceleration + T) + acceleration * T * T / 8.0 <= left:
        return wanted
    last = min(max(room, 0.0) / T, acceleration * T)
    return min(wanted, max(last, stopping_speed(left, acceleration, T)))


@inlined
def own_start(before: float, s: float, q: float, speed: float, T: float) -> float:
    """Where the motion starts that leads to s: the setpoint before, or s itself after a jump.

    A jump is what is faster than `speed`, and whatever comes after NaN.
    """
    way = abs(s - before)
    return before if way < math.inf and way <= (speed + rounding(s, q, T)) * T else s


class JointLimits(NamedTuple):
    """Of one joint.

    Attributes:
        lower, upper: positions [rad or m].
        speed: the greatest [rad/s or m/s].
        acceleration: A, the greatest [rad/s² or m/s²].
    """

    lower: float
    upper: float
    speed: float
    acceleration: float


@inlined
def taken_over(s: float, start: float, q: float, v: float, limits: JointLimits, T: float) -> bool:
    """Whether a joint can go from q to s in one period and do on the next what is asked for.

    That is: within all limits, able to stop before the next wall, and able to go on as the
    setpoint itself moves, from `start` to s. NaN is not.

    Args:
        s: setpoint.
        start: `own_start` of s.
        q, v: applied reference, and its velocity over the last period.
        limits: see there.
        T: period [s].
    """
    lower, upper, speed, acceleration = limits
    w, change, slack = (s - q) / T, acceleration * T, rounding(s, q, T)
    if not (abs(w) < math.inf and lower <= s <= upper and abs(w) <= speed + slack):
        return False
    if not (abs(w - v) <= change + slack and abs(start - q) <= change * T):
        return False
    brake = INSIDE * acceleration
    if w > 0.0:
        return w <= approach_speed(w, upper - q, upper, speed, brake, T)
    return -w <= approach_speed(-w, q - lower, lower, speed, brake, T)
