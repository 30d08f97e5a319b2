"""Compiled: tasks with a negligible gradient, and tasks that make no progress."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.messages import FloatArray
from hoap3.protocol.runtime.numba_jit import inlined, kernel

NEGLIGIBLE = 1e-6  # of |J|·|e|: a gradient |Jᵀe| up to this counts as 0
SLOW_PER_S = 1e-3  # of V: a task whose V falls no faster makes no progress
AT_LIMIT = 1e-6  # from a bound [rad/s or rad/s²; m/s or m/s²]
FLAT, STUCK, HELD = 1, 2, 4

Flags = NDArray[np.bool_]


@inlined
def _slope(errors: FloatArray, jacobian: FloatArray, first: int, end: int, i: int) -> float:
    """Component i of Jᵀe."""
    slope = 0.0
    for row in range(first, end):
        slope += jacobian[row, i] * errors[row]
    return slope


@kernel(
    "i8(f8[::1], f8[:,::1], i8[:,::1], f8, f8[::1], f8[::1], f8[::1], f8[::1], f8[::1],"
    " f8[:,::1], f8, b1[::1], b1[::1], b1[:,::1])"
)
def find_progress(
    errors: FloatArray,
    jacobian: FloatArray,
    spans: NDArray[np.int64],
    sign: float,
    velocity: FloatArray,
    decided: FloatArray,
    lower: FloatArray,
    upper: FloatArray,
    reference: FloatArray,
    ends: FloatArray,
    T: float,
    flat_out: Flags,
    stuck_out: Flags,
    held_out: Flags,
) -> int:
    """Find tasks with |Jᵀe| ≤ 1e-6·|J|·|e|, and others whose V = ½|e|² does not fall.

    Args:
        errors: ±e of all tasks, (m,); `sign` is that of e in it.
        jacobian: ∂e/∂q, (m, n), with the Frobenius norm as |J|.
        spans: first row of each task and the row after its last, (k, 2).
        velocity: of the joints, (n,).
        decided: what `lower` and `upper` bound, (n,): the velocity or the acceleration.
        reference, ends: (n,), and (2, n) positions that the robot does not go beyond.
        T: period [s].
        flat_out, stuck_out: which tasks, (k,).
        held_out: (k, n), joints at a bound that the gradient of a stuck task points beyond.

    Returns:
        Sum of FLAT, STUCK and HELD, where there are any.
    """
    found, n = 0, velocity.size
    held_out[:] = False
    for k in range(spans.shape[0]):
        first, end = spans[k]
        square, size, slope, fall = 0.0, 0.0, 0.0, 0.0
        for row in range(first, end):
            square += errors[row] * errors[row]
            for i in range(n):
                size += jacobian[row, i] * jacobian[row, i]
        for i in range(n):
            g = sign * _slope(errors, jacobian, first, end, i)
            least = min((ends[0, i] - reference[i]) / T, 0.0)
            most = max((ends[1, i] - reference[i]) / T, 0.0)
            slope += g * g
            fall -= g * min(max(velocity[i], least), most)
        bound = NEGLIGIBLE * NEGLIGIBLE * size * square
        flat_out[k] = square > 0.0 and slope <= bound < math.inf
        stuck_out[k] = square > 0.0 and not flat_out[k] and fall <= SLOW_PER_S * 0.5 * square
        found |= (FLAT if flat_out[k] else 0) | (STUCK if stuck_out[k] else 0)
        for i in range(n if stuck_out[k] else 0):
            g = sign * _slope(errors, jacobian, first, end, i)
            high = min(upper[i] - decided[i], (ends[1, i] - reference[i]) / T - velocity[i])
            low = min(decided[i] - lower[i], velocity[i] - (ends[0, i] - reference[i]) / T)
            if g * g > bound / n and (high if g < 0.0 else low) <= AT_LIMIT:
                held_out[k, i] = True
                found |= HELD
    return found
