"""Limits of speeds and of margins m ≥ 0, by (25) of QP12 (IEEE T-RO 2020) with h = −m: ṁ ≥ −ηm."""

from __future__ import annotations

import math

from hoap3.protocol.messages import FloatArray
from hoap3.protocol.runtime.numba_jit import Indices, inlined, kernel

RETURN_SHARE = 0.5  # of the fastest return that bounds on the joints leave
AT_END = 1e-9  # of what a row sums up: how near its end an answer counts as held by it
STILL = 1e-12  # of a gradient's largest element [m/rad]: no joint moves it


@inlined
def _clipped(value: float, lower: float, upper: float) -> float:
    """The nearest value in an interval; nan stays nan."""
    if value < lower:
        return lower
    return upper if value > upper else value


@kernel("void(f8[::1], f8[::1], f8[::1], f8[::1])")
def intersect_box(
    lower: FloatArray, upper: FloatArray, lower_out: FloatArray, upper_out: FloatArray
) -> None:
    """Cut intervals down to others; of two that do not meet, the nearest value of the first stays.

    Args:
        lower, upper: (n,) the others.
        lower_out, upper_out: (n,) the intervals, changed in place.
    """
    for i in range(lower.size):
        least, most = lower_out[i], upper_out[i]
        lower_out[i] = _clipped(lower[i], least, most)
        upper_out[i] = _clipped(upper[i], least, most)


@kernel("void(f8[::1], f8[::1], f8[::1], f8, f8[::1], f8[::1])")
def change_within(
    dq: FloatArray,
    speed: FloatArray,
    brake: FloatArray,
    T: float,
    lower_out: FloatArray,
    upper_out: FloatArray,
) -> None:
    """Narrow intervals of q̈ by |q̇ + T·q̈| ≤ ω, as `intersect_box` does.

    Args:
        dq, speed: (n,) q̇ and ω [rad/s or m/s].
        brake: (n,) what a joint that is faster brakes with [rad/s² or m/s²].
        T: period [s].
        lower_out, upper_out: (n,) of q̈, changed in place.
    """
    for i in range(dq.size):
        least, most = lower_out[i], upper_out[i]
        lower_out[i] = _clipped(min((-speed[i] - dq[i]) / T, brake[i]), least, most)
        upper_out[i] = _clipped(max((speed[i] - dq[i]) / T, -brake[i]), least, most)


@kernel("f8(f8[::1], f8[::1], f8[::1], f8, f8, f8[::1], f8[::1], f8[::1])")
def narrow_to_range(
    q: FloatArray,
    least: FloatArray,
    greatest: FloatArray,
    eta: float,
    return_speed: float,
    margins_out: FloatArray,
    lower_out: FloatArray,
    upper_out: FloatArray,
) -> float:
    """Narrow intervals of u by −η(q − q_min) ≤ u ≤ η(q_max − q), as `intersect_box` does.

    Args:
        q, least, greatest: (n,) q, q_min, q_max [rad or m].
        eta: η [1/s].
        return_speed: fastest return from outside [rad/s or m/s].
        margins_out: (2n,) q − q_min, then q_max − q.
        lower_out, upper_out: (n,) of u, changed in place.

    Returns:
        The smallest margin.
    """
    n, smallest, known = q.size, math.inf, True
    for i in range(n):
        from_least, to_greatest = q[i] - least[i], greatest[i] - q[i]
        margins_out[i], margins_out[n + i] = from_least, to_greatest
        smallest = min(smallest, from_least, to_greatest)
        known &= not (math.isnan(from_least) or math.isnan(to_greatest))
        lower, upper = lower_out[i], upper_out[i]
        lower_out[i] = _clipped(min(-eta * from_least, return_speed), lower, upper)
        upper_out[i] = _clipped(max(eta * to_greatest, -return_speed), lower, upper)
    return smallest if known else math.nan


@kernel("Tuple((f8, i8))(f8[::1], f8, f8, f8, f8[:,::1], f8[::1])")
def limit_rows(
    margins: FloatArray,
    eta: float,
    reserve: float,
    return_speed: float,
    A_out: FloatArray,
    b_out: FloatArray,
) -> tuple[float, int]:
    """Write b of rows −∇m·u ≤ b, and switch off those outside that no joint can help.

    b = η max(m − reserve, 0) inside, m ≥ 0; b = max(ηm, −return_speed) < 0 outside.

    Args:
        margins: (s,) m [m].
        eta: η [1/s].
        reserve: kept inside [m].
        return_speed: fastest return from outside [m/s].
        A_out: (s, n) −∇m [m/rad].
        b_out: (s,) [m/s].

    Returns:
        The smallest margin, and how many rows outside no joint can help.
    """
    smallest, immovable, known = math.inf, 0, True
    for row in range(margins.size):
        margin = margins[row]
        smallest = min(smallest, margin)
        known &= not math.isnan(margin)
        if margin >= 0.0:
            b_out[row] = eta * max(margin - reserve, 0.0)
            continue
        b_out[row] = max(eta * margin, -return_speed)
        top = 0.0
        for element in A_out[row]:
            top = max(top, abs(element))
        if top < STILL:
            A_out[row, :], b_out[row] = 0.0, math.inf
            immovable += 1
    return (smallest if known else math.nan), immovable


@kernel("Tuple((f8, i8))(f8[::1], f8[::1], f8[::1], f8, f8, f8, f8[:,::1], f8[::1])")
def limit_accelerations(
    margins: FloatArray,
    dq: FloatArray,
    bend: FloatArray,
    eta: float,
    reserve: float,
    return_speed: float,
    A_out: FloatArray,
    upper_out: FloatArray,
) -> tuple[float, int]:
    """Write the right-hand sides 2ηṁ + η²·room − Ȧ·q̇ of rows A·q̈, with A = −∇m, ṁ = −A·q̇.

    room = max(m − r, 0) inside, m ≥ 0; room = max(m, −return_speed/η) < 0 outside. Rows that no
    joint can help are switched off.

    Args:
        margins: (s,) m [m].
        dq: (n,) q̇ [rad/s or m/s].
        bend: (s,) Ȧ·q̇ [m/s²].
        eta: η [1/s].
        reserve: r, kept inside [m].
        return_speed: twice the speed that a return from outside settles at [m/s].
        A_out: (s, n) −∇m [m/rad].
        upper_out: (s,) [m/s²].

    Returns:
        The smallest margin, and how many rows outside no joint can help.
    """
    smallest, immovable, known = math.inf, 0, True
    for row in range(margins.size):
        margin = margins[row]
        smallest = min(smallest, margin)
        known &= not math.isnan(margin)
        top, rate = 0.0, 0.0
        for i in range(dq.size):
            top = max(top, abs(A_out[row, i]))
            rate -= A_out[row, i] * dq[i]
        if top < STILL:
            A_out[row, :], upper_out[row] = 0.0, math.inf
            immovable += margin < 0.0
            continue
        room = max(margin - reserve, 0.0) if margin >= 0.0 else max(margin, -return_speed / eta)
        upper_out[row] = 2.0 * eta * rate + eta * eta * room - bend[row]
    return (smallest if known else math.nan), immovable


@kernel("void(f8[:,::1], f8[::1], f8[::1], f8[::1])")
def slow_returns(A: FloatArray, b: FloatArray, lower: FloatArray, upper: FloatArray) -> None:
    """Ask for no faster return from outside than half of what the joints can do.

    Args:
        A: (s, n).
        b: (s,), changed in place where it is negative.
        lower, upper: (n,) of u.
    """
    for row in range(b.size):
        if not b[row] < 0.0:
            continue
        fastest = 0.0
        for i in range(lower.size):
            if A[row, i] != 0.0:
                fastest += min(A[row, i] * lower[i], A[row, i] * upper[i])
        b[row] = max(b[row], RETURN_SHARE * fastest)


@kernel("i8(f8[:,::1], f8[::1], f8[::1], f8[::1], i8[::1])")
def held_rows(
    rows: FloatArray, lower: FloatArray, upper: FloatArray, x: FloatArray, owners: Indices
) -> int:
    """Bit i: x, (n,), is at an end of a row that is i's, and no equation.

    Args:
        rows, lower, upper: (s, n), (s,), (s,) lower ≤ rows·x ≤ upper.
        x: (n,).
        owners: (s,) whose each row is.
    """
    held = 0
    for row in range(owners.size):
        if lower[row] == upper[row] or (math.isinf(lower[row]) and math.isinf(upper[row])):
            continue
        value, size = 0.0, 1.0
        for i in range(x.size):
            value += rows[row, i] * x[i]
            size += abs(rows[row, i] * x[i])
        if min(value - lower[row], upper[row] - value) <= AT_END * size:
            held |= 1 << owners[row]
    return held
