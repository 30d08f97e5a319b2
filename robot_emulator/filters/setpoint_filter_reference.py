"""What becomes of setpoints on their way into a robot, in plain numpy; all arrays are (n,).

`position_kernels` is compared with it. `setpoint_limits_oracle` has how a joint stops.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.limits.setpoint_limits_oracle import own_start, room_left, stopping_speed

Array = NDArray[np.float64]


def own_motion(
    setpoint: Array, before: Array, limits: Array, T: float, q: Array
) -> tuple[Array, Array]:
    """The setpoint s within the range, and where its motion began; NaN is where the joint is."""
    s, last = np.clip([setpoint, before], limits[0], limits[1])
    start = np.where(np.isnan(before), s, own_start(last, s, limits[2], T))
    return np.where(np.isnan(setpoint), q, s), np.where(np.isnan(setpoint), q, start)


def filtered(
    setpoint: Array, before: Array, limits: Array, T: float, q: Array, v: Array
) -> tuple[Array, Array]:
    """Next place and velocity: s where the joint can go there and on, else an approach of it.

    The approach adds to the setpoint's own velocity what can be stopped from on the way to where
    that motion began. It stays near v and the greatest speed, and stops before the ends.

    Args:
        setpoint, before: asked for now, and one period ago.
        limits: (4, n) as of `setpoint_limits_oracle.velocity_bounds`.
        T: period.
        q, v: where the joint is, and its velocity.
    """
    lower, upper, speed, A = limits
    s, start = own_motion(setpoint, before, limits, T, q)
    taken = room_left(s, start, q, v, limits, T) >= 0.0
    least, most = v - A * T, v + A * T
    apart = start - q
    w = (s - start) / T + np.sign(apart) * stopping_speed(np.abs(apart), A, T)
    w = np.clip(np.clip(w, -speed, speed), least, most)
    up = np.maximum(np.minimum(w, stopping_speed(upper - q, A, T)), least)
    down = np.minimum(np.maximum(w, -stopping_speed(q - lower, A, T)), most)
    w = np.where(taken, (s - q) / T, np.where(w > 0.0, up, np.where(w < 0.0, down, w)))
    return np.where(taken, s, np.clip(q + w * T, lower, upper)), w
