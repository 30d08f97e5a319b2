"""Compiled motion: what the robot does to its joints at each tick."""

from __future__ import annotations

import math

import numpy as np

from hoap3.protocol.messages import FloatArray
from hoap3.protocol.runtime.numba_jit import inlined, kernel

LEAST_COUNT, MOST_COUNT = -32768.0, 32767.0  # of an int16 encoder


@kernel("void(f8[::1], f8, f8, f8[::1], f8[::1], f8[::1], f8[::1])")
def serve(
    command: FloatArray,
    share: float,
    dt: float,
    counts: FloatArray,
    position: FloatArray,
    q: FloatArray,
    dq: FloatArray,
) -> None:
    """Let joints follow `command` for one period, and measure them; all arrays (n,).

    Args:
        command: reference [rad or m].
        share: part of the way that is done in one period; 1 for all of it, bit by bit.
        dt: the period [s].
        counts: of an encoder, per rad or m; 0 where it shows the position itself.
        position: where the joints are, changed in place [rad or m].
        q, dq: what is measured, changed in place [rad or m, and per s].
    """
    for i in range(q.size):
        if share == 1.0:
            position[i] = command[i]
        else:
            position[i] += share * (command[i] - position[i])
        shown = position[i]
        if counts[i] != 0.0:
            shown = min(max(np.rint(shown * counts[i]), LEAST_COUNT), MOST_COUNT) / counts[i]
        dq[i] = (shown - q[i]) / dt
        q[i] = shown


@inlined
def _stop(i: int, lower: FloatArray, upper: FloatArray, q: FloatArray, dq: FloatArray) -> None:
    """Hold a joint at its mechanical stop."""
    if q[i] > upper[i]:
        q[i], dq[i] = upper[i], min(dq[i], 0.0)
    elif q[i] < lower[i]:
        q[i], dq[i] = lower[i], max(dq[i], 0.0)


@kernel("void(f8[::1], f8, b1, f8[::1], f8[::1], f8[::1], f8[::1])")
def advance(
    ddq: FloatArray,
    dt: float,
    exact: bool,
    lower: FloatArray,
    upper: FloatArray,
    q: FloatArray,
    dq: FloatArray,
) -> None:
    """Move with constant accelerations for `dt` [s]; all arrays (n,).

    Args:
        ddq: accelerations [rad/s² or m/s²].
        dt: duration [s].
        exact: q += dt·dq + dt²/2·ddq; else semi-implicit Euler, the velocity first.
        lower, upper: mechanical stops [rad or m].
        q, dq: changed in place [rad or m, and per s].
    """
    for i in range(q.size):
        if exact:
            q[i] += dt * dq[i] + 0.5 * dt * dt * ddq[i]
            dq[i] += dt * ddq[i]
        else:
            dq[i] += dt * ddq[i]
            q[i] += dt * dq[i]
        _stop(i, lower, upper, q, dq)


@kernel("void(f8[::1], f8[::1], f8[::1], f8, f8[::1], f8[::1])")
def joint_friction(
    dq: FloatArray,
    viscous: FloatArray,
    coulomb: FloatArray,
    sliding: float,
    slope_out: FloatArray,
    torque_out: FloatArray,
) -> None:
    """Friction of joints, as torque and as its slope over the velocity; all arrays (n,).

    Args:
        dq: velocities [rad/s or m/s].
        viscous: [N m s/rad].
        coulomb: [N m].
        sliding: speed above which it is Coulomb's.
        slope_out: B [N m s/rad].
        torque_out: −B·dq [N m].
    """
    for i in range(dq.size):
        slope_out[i] = viscous[i] + coulomb[i] / max(abs(dq[i]), sliding)
        torque_out[i] = -slope_out[i] * dq[i]


@kernel("i8(f8[::1], f8[::1], f8[::1], f8[::1])")
def clamp(wanted: FloatArray, lower: FloatArray, upper: FloatArray, out: FloatArray) -> int:
    """Cut `wanted` to its bounds; what is within them is copied bit by bit. All arrays (n,).

    `out` may be `wanted`.

    Returns:
        The number of the first joint that was cut, or -1.
    """
    cut = -1
    for i in range(out.size):
        kept = min(max(wanted[i], lower[i]), upper[i])
        if kept != wanted[i] and cut < 0:
            cut = i
        out[i] = kept
    return cut


@kernel("b1(f8[::1])")
def all_finite(values: FloatArray) -> bool:
    """Whether `values`, (n,), holds neither NaN nor an infinity."""
    for i in range(values.size):  # noqa: SIM110 - a generator does not compile
        if not math.isfinite(values[i]):
            return False
    return True
