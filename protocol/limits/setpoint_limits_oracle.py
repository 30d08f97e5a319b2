"""What a joint can do that goes in straight lines from tick to tick, by what it means.

`setpoint_limits_kernels`, and those of the constraint and of the filter that use it, are compared
with it. Plain numpy, no formula for braking: steps are summed up, speeds are found by halving. All
arrays are (n,), one joint each; what the kernels reserve for rounding is left out.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

HALVINGS = 70


def way(w: Array, A: Array, T: float) -> Array:
    """What braking from w takes: T (w + (w − AT) + (w − 2AT) + …)."""
    k = np.arange(np.max(w / (A * T), initial=0.0) + 1.0)[:, None]
    return np.asarray(T * np.maximum(w - k * (A * T), 0.0).sum(axis=0))


def stopping_speed(room: Array, A: Array, T: float) -> Array:
    """The largest w ≥ 0 with way(w) ≤ room; way(w) is at least wT, and w²/2A."""
    room = np.maximum(room, 0.0)
    low, high = np.zeros_like(room), np.minimum(room / T, np.sqrt(2.0 * A * room))
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        stops = way(middle, A, T) <= room
        low, high = np.where(stops, middle, low), np.where(stops, high, middle)
    return low


def velocity_bounds(q: Array, v: Array, limits: Array, T: float) -> tuple[Array, Array]:
    """Least and greatest next velocity: near the last one, not too fast, able to stop in time.

    limits: (4, n) least and greatest q, greatest speed, and A. One that is too fast to stop in
    time has the nearest to it that there is.
    """
    lower, upper, speed, A = limits
    least, most = (np.clip(v + side * A * T, -speed, speed) for side in (-1.0, 1.0))
    most = np.minimum(most, np.where(most > 0.0, stopping_speed(upper - q, A, T), np.inf))
    least = np.maximum(least, np.where(least < 0.0, -stopping_speed(q - lower, A, T), -np.inf))
    nearest = np.where(v > 0.0, most, least)
    return np.where(least > most, nearest, least), np.where(least > most, nearest, most)


def own_start(before: Array, s: Array, speed: Array, T: float) -> Array:
    """Where the setpoint's motion to s began: at the one before, or, after a jump, at s."""
    return np.asarray(np.where(np.abs(s - before) <= speed * T, before, s))


def room_left(s: Array, start: Array, q: Array, v: Array, limits: Array, T: float) -> Array:
    """By how much speed a joint could do more than go to s and on as s moves; < 0: it cannot.

    It can where w = (s − q)/T is within the limits, leaves it able to stop, and differs by no more
    than AT from v, as the setpoint's own velocity after it, from `start` to s, does from w.
    """
    lower, upper, speed, A = limits
    w, own = (s - q) / T, (s - start) / T
    wall = stopping_speed(np.where(w > 0.0, upper - q, q - lower), A, T) - np.abs(w)
    near = A * T - np.maximum(np.abs(w - v), np.abs(own - w))
    inside = np.minimum(s - lower, upper - s) / T
    return np.asarray(
        np.minimum.reduce([inside, speed - np.abs(w), near, np.where(w == 0.0, np.inf, wall)])
    )
