"""Compiled bounds of the acceleration: what keeps a joint able to stay within its limits.

Del Prete, "Joint Position and Velocity Bounds in Discrete-Time Acceleration/Torque Control of
Robot Manipulators", IEEE RA-L 2018, Algorithms 1 to 3, in a form with three terms a side: (24), or
(19) and (20) where E < 0; (23); and ±q̈^max. `viability_bounds_oracle` says the same without a
formula. The paper's δt is T here, q̈^max is A, q̈ is a, and q̇(δt) is w.

With room D = q_max − q and braking A, the largest velocity from which a joint stops in time is
√(2AD), (8). An acceleration a is held for T. If the joint still moves towards the limit after it,
then w = v + aT must satisfy w² ≤ 2A(D − T(v + w)/2): (24) squared, with q(T) = q + T(v + w)/2. With
E = D − Tv/2, what would be left if w were 0, that is w² + ATw − 2AE ≤ 0, (26) in w, whose positive
root, (28), rationalised so that nothing cancels, is

    w = 4E / (T (1 + √(1 + 8E/(AT²))))

E ≥ 0 is q̈₃^M ≥ q̈₁^M of Algorithm 1; then (20) is w ≤ 2E/T and follows from (24), in which A
may be a share of q̈^max. If E < 0 the joint has to turn round
within T, and the turning point is what matters: a = −v²/(2D), (19). The lower side is the upper one
seen in a mirror.

−ε ≤ E < 0 counts as 0 ≤ E, and (24) is continued by w = 2E/T, with its value and slope at 0: a
state that rounding put just outside would be
kicked back with all the joint has, again and again, and never rest. So would one that a motion put
there that is not quite what was asked for: for those ε is as large as the caller likes.
"""

from __future__ import annotations

import math

from hoap3.protocol.messages import FloatArray
from hoap3.protocol.runtime.numba_jit import inlined, kernel

ROUNDING = 64.0 * 2.0**-52  # ε relative to the largest of |q| and its finite limits
OK, NOT_FINITE, BAD_SHAPE = 0, 1, 2
LEAST, GREATEST, SPEED, UP, DOWN, SIZE = 0, 1, 2, 3, 4, 5  # rows of `limits`


@inlined
def _most(
    room: float,
    v: float,
    speed: float,
    forward: float,
    brake: float,
    share: float,
    T: float,
    epsilon: float,
) -> float:
    """Largest acceleration towards a limit.

    Args:
        room: D, ≥ 0 inside.
        v, speed: velocity towards the limit, and the largest one.
        forward, brake: largest acceleration towards the limit, and away from it.
        share: of `brake` that stopping in time counts on.
        T: for which it is held.
        epsilon: of E.
    """
    left = room - T * v / 2.0  # E
    if left == math.inf:
        a = math.inf
    elif left >= -epsilon:
        w = 2.0 * left / T  # −ε ≤ E ≤ 0
        if left > 0.0:  # (24)
            w = 2.0 * w / (1.0 + math.sqrt(1.0 + 8.0 * left / (share * brake * T * T)))
        a = (w - v) / T
    elif v > 0.0:
        a = -v * v / (2.0 * room) if room > 0.0 else -brake  # (19)
    else:  # outside, and not on the way out: back at the limit after T, (20)
        a = 2.0 * (room - T * v) / (T * T)
    # (23), and |q̈| ≤ q̈^max
    return min(max(min(a, (speed - v) / T), -brake), forward)


@inlined
def _agreed(lower: float, upper: float, below: float, above: float) -> tuple[float, float]:
    """Bounds that do not cross: outside what leads back, inside the middle (it is rounding).

    below, above: room to the lower and to the upper limit; negative outside.
    """
    if lower <= upper:
        return lower, upper
    if above < 0.0:
        return lower, lower
    if below < 0.0:
        return upper, upper
    middle = 0.5 * (lower + upper)
    return middle, middle


@inlined
def _judged(
    q: FloatArray, dq: FloatArray, n: int, lower_out: FloatArray, upper_out: FloatArray
) -> tuple[int, int]:
    """Whether the bounds of a state can be computed, and the joint that is not finite."""
    if not (q.size == n and dq.size == n and lower_out.size == n and upper_out.size == n):
        return BAD_SHAPE, -1
    for i in range(n):
        if not (math.isfinite(q[i]) and math.isfinite(dq[i])):
            return NOT_FINITE, i
    return OK, -1


@kernel("Tuple((i8, i8))(f8[::1], f8[::1], f8[:,::1], f8, f8, f8, f8[::1], f8[::1])")
def acceleration_bounds_kernel(
    q: FloatArray,
    dq: FloatArray,
    limits: FloatArray,
    T: float,
    share: float,
    softness: float,
    lower_out: FloatArray,
    upper_out: FloatArray,
) -> tuple[int, int]:
    """Write the least and greatest acceleration that may be held for T; lower ≤ upper always.

    Args:
        q, dq: (n,) positions and velocities [rad, rad/s or m, m/s].
        limits: (6, n) by row: `LEAST` and `GREATEST` position, greatest `SPEED`, greatest
            acceleration `UP` and `DOWN` (both positive), and the `SIZE` of the larger finite
            position limit.
        T: [s].
        share: of the accelerations that stopping in time counts on.
        softness: least ε [rad or m].
        lower_out, upper_out: (n,) [rad/s² or m/s²]; untouched unless `OK`.

    Returns:
        `OK`, `NOT_FINITE` or `BAD_SHAPE`, and the joint that is not finite.
    """
    n = limits.shape[1]
    status, joint = _judged(q, dq, n, lower_out, upper_out)
    if status != OK:
        return status, joint
    for i in range(n):
        below, above = q[i] - limits[LEAST, i], limits[GREATEST, i] - q[i]
        speed, up, down = limits[SPEED, i], limits[UP, i], limits[DOWN, i]
        epsilon = max(ROUNDING * max(limits[SIZE, i], abs(q[i])), softness)
        most = _most(above, dq[i], speed, up, down, share, T, epsilon)
        least = -_most(below, -dq[i], speed, down, up, share, T, epsilon)
        lower_out[i], upper_out[i] = _agreed(least, most, below, above)
    return OK, -1


@kernel("Tuple((i8, i8))(f8[::1], f8[::1], f8[:,::1], f8, f8[::1], f8[::1])")
def naive_bounds_kernel(
    q: FloatArray,
    dq: FloatArray,
    limits: FloatArray,
    T: float,
    lower_out: FloatArray,
    upper_out: FloatArray,
) -> tuple[int, int]:
    """Write the bounds of (2), which look one step ahead only; arguments as above.

    Where they cross, the upper one wins, cut to what the joint can do.
    """
    n = limits.shape[1]
    status, joint = _judged(q, dq, n, lower_out, upper_out)
    if status != OK:
        return status, joint
    for i in range(n):
        up, down, speed, v = limits[UP, i], limits[DOWN, i], limits[SPEED, i], dq[i]
        most = min((speed - v) / T, 2.0 * (limits[GREATEST, i] - q[i] - T * v) / (T * T))
        least = max((-speed - v) / T, 2.0 * (limits[LEAST, i] - q[i] - T * v) / (T * T))
        upper_out[i] = min(max(most, -down), up)
        lower_out[i] = min(max(least, -down), upper_out[i])
    return OK, -1
