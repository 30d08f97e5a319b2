"""What becomes of setpoints on their way into a robot with a limit of jerk, in plain numpy.

`jerk_kernels` is compared with it; all arrays are (n,). `jerk_limits_oracle` has how a joint
brakes and stops.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.limits import jerk_limits_oracle as plain

Array = NDArray[np.float64]
Motion = tuple[Array, Array, Array]


def own_motion(setpoint: Array, history: Array, limits: plain.Limits, T: float) -> Motion:
    """Where the setpoint's last step began, its velocity and acceleration; at rest after a jump.

    A jump is what no joint within the limits of speed, acceleration and jerk does.
    """
    lower, upper, speed, A, J = limits
    s, before, earlier, first = np.clip([setpoint, *history], lower, upper)
    r, c = (s - before) / T, (s - 2.0 * before + earlier) / T**2
    third = (s - 3.0 * before + 3.0 * earlier - first) / T**3
    moves = (np.abs(r) <= speed) & (np.abs(c) <= A) & (np.abs(third) <= J)
    return np.where(moves, before, s), np.where(moves, r, 0.0), np.where(moves, c, 0.0)


def room_left(setpoint: Array, history: Array, limits: plain.Limits, T: float, at: Motion) -> Array:
    """By how much acceleration a joint could do more than go to the setpoint; < 0: it cannot.

    It can where that is within all limits, leaves it able to brake before them, and on the next
    period it can have the setpoint's own velocity, and on the one after that its acceleration.
    """
    lower, upper, speed, A, J = limits
    (q, v, a), step = at, J * T
    _, r, c = own_motion(setpoint, history, limits, T)
    w = (setpoint - q) / T
    next_a = (w - v) / T
    onward = (r + c * T - w) / T
    least, most = plain.acceleration_bounds(q, v, a, limits, T)
    return np.asarray(
        np.minimum.reduce(
            [
                most - next_a,
                next_a - least,
                (speed - np.abs(w)) / T,
                step - np.abs(onward - next_a),
                step - np.abs(c - onward),
                A - np.abs(onward),
                np.minimum(setpoint - lower, upper - setpoint) / T**2,
            ]
        )
    )


def filtered(setpoint: Array, history: Array, limits: plain.Limits, T: float, at: Motion) -> Array:
    """The next acceleration: that of the setpoint where the joint can go there, else an approach.

    The approach is the stop that ends at the setpoint, as seen from the setpoint, with what the
    setpoint's own acceleration leaves of A; and then what keeps all limits.

    Args:
        setpoint, history: asked for now, and (3, n) one, two and three periods ago.
        limits: (5, n) as of `jerk_limits_oracle.acceleration_bounds`.
        T: period.
        at: place of the joint, and its velocity and acceleration over the last period.
    """
    lower, upper, speed, A, J = limits
    q, v, a = at
    there = room_left(setpoint, history, limits, T, at) >= 0.0
    start, r, c = own_motion(setpoint, history, limits, T)
    near = np.maximum(a - J * T, -A) - c, np.minimum(a + J * T, A) - c
    left = np.maximum(A - np.abs(c), A / 8.0)
    own = lower, upper, speed, left, J
    wanted = c + plain.next_for_stop(start - q, v - r + c * T, near, own, T)
    least, most = plain.acceleration_bounds(q, v, a, limits, T)
    kept = np.clip(wanted, least, np.maximum(most, least))
    return np.asarray(np.where(there, ((setpoint - q) / T - v) / T, kept))
