"""Compiled: how a joint brakes whose acceleration may change by JT a period, and how it stops.

The reference goes in straight lines from tick to tick: q' = q + Tw', w' = w + Tα', and α' differs
from α by no more than JT. Here T, J and the place are 1, 1 and 0: positions are told in units of
JT³, velocities u in JT², accelerations x in JT, and N = A/(JT) is the greatest.

The *maximal brake* goes on with x − 1, x − 2, …, −N, −N, …: no motion rises less. The *stop* comes
to rest, with no acceleration left, and does so as soon as can be: it brakes harder and harder, and
then releases by 1 a period.

Both are sums of steps; which steps they are is found by square roots, and their length is linear
in u and x as long as these are the same. So in x, when u changes along with it, they are made of
straight pieces, of which the brake's are convex: Newton's method ends at the exact solution.
"""

from __future__ import annotations

import math

import numpy as np

from hoap3.protocol.limits.setpoint_limits_kernels import ULP, stopping_speed
from hoap3.protocol.runtime.numba_jit import inlined

MOST_STEPS_OF_NEWTON = 60  # it ends sooner; this is for what rounding may do
ROUNDINGS = 8.0  # units of the last place of a position, in a step


@inlined
def release(x: float) -> float:
    """Velocity that is gained while an acceleration x ≥ 0 is released: (x − 1) + (x − 2) + …."""
    m: float = np.ceil(x) - 1.0
    return m * x - 0.5 * m * (m + 1.0)


@inlined
def brake_rise(u: float, x: float, N: float) -> tuple[float, float, float]:
    """How much higher than now a joint gets under the maximal brake, at the least 0.

        u_i = u + (x − 1) + … + (x − i),   i ≤ N + x;   then N less each period

    Args:
        u, x: velocity and acceleration over the last period.
        N: greatest acceleration.

    Returns:
        The rise, the sum of u_i up to the last that is positive; its derivative by x, where u
        changes as x does; how many steps it takes.
    """
    apex = x - 0.5
    height = apex * apex + 2.0 * u
    if not height > 0.0:
        return 0.0, 0.0, 0.0
    k, h = np.floor(apex + math.sqrt(height)), 0.0
    steeper = max(0.0, np.floor(N + x))
    if k < 0.0:
        return 0.0, 0.0, 0.0
    capped = k >= steeper
    if capped:
        k = steeper
    rise = k * u + 0.5 * k * (k + 1.0) * (x - (k + 2.0) / 3.0)
    if capped:
        end = u + k * x - 0.5 * k * (k + 1.0)
        h = max(0.0, np.floor(end / N))
        rise += h * end - 0.5 * N * h * (h + 1.0)
    if not rise > 0.0:
        return 0.0, 0.0, 0.0
    return rise, 0.5 * k * (k + 3.0) + h * (1.0 + k), k + h


@inlined
def stop_way(u: float, x: float, N: float) -> tuple[float, float]:
    """Where the stop ends, from where the joint is now, and the derivative of that as above.

    With b = −x, downwards if what is left of u after a release of x is positive:

        u_i = u − (b + 1) − … − (b + i),   b + i ≤ N,   as long as b + i can be released in time,

    then N less each period likewise, then what is just enough to be released to rest.
    """
    left = u + math.copysign(release(abs(x)), x)
    side = 1.0 if left >= 0.0 else -1.0
    u, b = side * u, -side * x
    m = np.ceil(b) - 1.0
    f = b - m
    inside = u + 0.5 * m * (m + 1.0) + m * f + f * f
    k = max(np.floor(math.sqrt(max(inside, 0.0)) - b), 0.0, -m - 1.0)
    steeper = max(0.0, np.floor(N - b))
    fast = u - steeper * b - 0.5 * steeper * (steeper + 1.0)
    h = max(0.0, np.floor((fast - release(N)) / N)) if k >= steeper else 0.0
    k = min(k, steeper)
    end = u - k * b - 0.5 * k * (k + 1.0)
    way = k * u - 0.5 * k * (k + 1.0) * (b + (k + 2.0) / 3.0)
    way += h * end - 0.5 * N * h * (h + 1.0)
    end -= h * N
    end = max(end, 0.0)
    n = max(1.0, np.ceil(0.5 * (math.sqrt(1.0 + 8.0 * end) - 1.0)))
    last = end / n + 0.5 * (n - 1.0)
    way += n * (n - 1.0) * (0.5 * last - (2.0 * n - 1.0) / 6.0)
    slope = 0.5 * k * (k + 3.0) + (1.0 + k) * (h + 0.5 * (n - 1.0))
    return side * way, slope


@inlined
def brake_steps(u: float, x: float, N: float) -> tuple[float, float]:
    """The greatest velocity that is left after braking begins, and no fewer steps than it takes.

    u + x²/2 is not exceeded, and N ramps it down in no more than N/2 + (u + x²/2)/N steps.
    """
    ahead = max(x, 0.0)
    top = u + 0.5 * ahead * ahead
    return top, ahead + 0.5 * N + top / N + 2.0


@inlined
def brake_reserve(place: float, way: float, steps: float) -> float:
    """Room that rounding may cost in so many steps to a place, over a way.

    Each step is rounded, and a setpoint's own acceleration is known to some units of the last
    place of a position, which a brake of n steps turns into n²/2 of them.
    """
    return ULP * (place + way) * steps * (8.0 + steps)


@inlined
def release_reserve(place: float, fast: float, x: float) -> float:
    """Velocity that rounding may cost while an acceleration x is released, from a place on."""
    steps = 1.0 + abs(x)
    return ROUNDINGS * ULP * (place + fast * (3.0 + steps)) * steps


@inlined
def far_from_wall(u: float, x: float, room: float, place: float, N: float) -> tuple[bool, float]:
    """Whether a joint plainly is able to brake in time after a next x; and the reserve for that.

    Args:
        u: velocity over the last period.
        x: next acceleration.
        room: up to the wall.
        place: where the wall and the joint are at most, from 0.
        N: greatest acceleration.
    """
    top, steps = brake_steps(u + x, x, N)
    reserve = brake_reserve(place, top * steps, steps)
    return (not top > 0.0) | (u + x + top * steps + reserve <= room), reserve


@inlined
def below_wall(u: float, x: float, least: float, room: float, place: float, N: float) -> float:
    """As much of the next x, but no less than `least`, as leaves a joint able to brake in time.

    The others are as of `far_from_wall`.
    """
    far, reserve = far_from_wall(u, x, room, place, N)
    return x if far else most_for_wall(u, room - reserve, least, x, N)


@inlined
def plainly_able_to_brake(u: float, x: float, room: float, place: float, N: float) -> bool:
    """Whether the maximal brake from velocity u and acceleration x ends within `room` by far."""
    top, steps = brake_steps(u, x, N)
    rise = top * steps
    ends = (not top > 0.0) | (rise + brake_reserve(place, rise, steps) <= room)
    return ends & (room >= 0.0)


@inlined
def able_to_brake(u: float, x: float, room: float, place: float, N: float) -> bool:
    """Whether the maximal brake from velocity u and acceleration x ends within `room`."""
    if plainly_able_to_brake(u, x, room, place, N):
        return True
    rise, _slope, steps = brake_rise(u, x, N)
    return rise + ROUNDINGS * ULP * (place + rise) * steps <= room


@inlined
def most_for_wall(u: float, room: float, least: float, most: float, N: float) -> float:
    """Largest next x from `least` to `most` whose maximal brake rises by no more than `room`.

    Newton's method from above, on a convex function: no step passes the solution.
    """
    x = most
    for _ in range(MOST_STEPS_OF_NEWTON):
        rise, slope, _steps = brake_rise(u + x, x, N)
        beyond = u + x + rise - room
        if not beyond > 0.0:
            return x
        nearer = x - beyond / (1.0 + slope)
        if nearer <= least:
            return least
        if not nearer < x:
            return x
        x = nearer
    return x


@inlined
def within_velocity(u: float, x: float, most: float) -> float:
    """As much of x > 0 as can be released before the velocity, now u, is above `most`."""
    free = u + 0.5 * x * (x + 1.0) + 0.125 <= most
    return x if free else min(x, stopping_speed(most - u, 1.0, 1.0))
