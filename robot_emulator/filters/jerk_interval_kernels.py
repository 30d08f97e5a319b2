"""Compiled: accelerations after which a joint keeps all limits, and the nearest to a wanted one.

They are within the joint's greatest one, no farther than JT from the last one, such that they can
be released before the velocity is too great, and such that the joint can brake before its walls.
There always are some: docs/internals/proofs.md has the proof.
"""

from __future__ import annotations

from hoap3.protocol.limits.jerk_limits_kernels import (
    below_wall,
    far_from_wall,
    release_reserve,
    within_velocity,
)
from hoap3.protocol.limits.jerk_takeover_kernels import Limits, Motion, rooms
from hoap3.protocol.limits.setpoint_limits_kernels import within
from hoap3.protocol.runtime.numba_jit import inlined


@inlined
def within_speed(wanted: float, at: Motion, own: Limits) -> float:
    """The next acceleration nearest to the wanted one but for the walls, in JT."""
    u, x, N = at.v * own.velocity, at.a * own.acceleration, own.N
    least, most = max(x - 1.0, -N), min(x + 1.0, N)
    y = within(wanted * own.acceleration, least, most)
    fast = own.fast - release_reserve(abs(at.q) * own.place, own.fast, y)
    upwards = y > 0.0
    side, bound = 1.0 if upwards else -1.0, least if upwards else -most
    return side * max(within_velocity(side * u, side * y, fast), bound)


@inlined
def far_from_walls(y: float, at: Motion, own: Limits) -> bool:
    """Whether no wall stands in the way of a next acceleration y [JT] by far."""
    u = at.v * own.velocity
    up, above, down, below = rooms(at.q, own)
    free, _reserve = far_from_wall(u, y, up, above, own.N)
    also, _reserve = far_from_wall(-u, -y, down, below, own.N)
    return free & also


@inlined
def within_walls(y: float, at: Motion, own: Limits) -> float:
    """As much of a next acceleration y [JT] as the walls allow."""
    u, x, N = at.v * own.velocity, at.a * own.acceleration, own.N
    up, above, down, below = rooms(at.q, own)
    y = below_wall(u, y, max(x - 1.0, -N), up, above, N)
    return -below_wall(-u, -y, -min(x + 1.0, N), down, below, N)


@inlined
def as_acceleration(y: float, wanted: float, at: Motion, own: Limits) -> float:
    """What y [JT] is in [rad/s² or m/s²], within all: bit by bit the one wanted if it is that."""
    step = own.J * own.T
    a = wanted if y == wanted * own.acceleration else y * step
    return within(a, max(at.a - step, -own.A), min(at.a + step, own.A))


@inlined
def within_all(wanted: float, at: Motion, own: Limits) -> float:
    """The next acceleration nearest to the wanted one that keeps all limits now and later."""
    y = within_speed(wanted, at, own)
    return as_acceleration(within_walls(y, at, own), wanted, at, own)


@inlined
def moved(a: float, at: Motion, own: Limits) -> Motion:
    """One period with an acceleration."""
    v = within(at.v + a * own.T, -own.speed, own.speed)
    return Motion(within(at.q + v * own.T, own.lower, own.upper), v, a)
