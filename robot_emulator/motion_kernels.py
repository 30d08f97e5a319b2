"""Compiled motion: what the robot does to its joints at each tick."""

from __future__ import annotations

import math

import numpy as np

from protocol.compilation import kernel
from protocol.messages import FloatArray

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


@kernel("b1(f8[::1])")
def all_finite(values: FloatArray) -> bool:
    """Whether `values`, (n,), holds neither NaN nor an infinity."""
    for i in range(values.size):  # noqa: SIM110 - a generator does not compile
        if not math.isfinite(values[i]):
            return False
    return True
