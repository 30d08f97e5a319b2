"""Compiled: what tasks want, and an answer within bounds."""

from __future__ import annotations

import math

from hoap3.protocol.messages import FloatArray
from hoap3.protocol.runtime.numba_jit import kernel


@kernel("f8(f8[:], f8[:], f8[:,:], f8[::1], f8[::1], f8[:,::1])")
def stack(
    error: FloatArray,
    error_rate: FloatArray,
    jacobian: FloatArray,
    errors_out: FloatArray,
    rates_out: FloatArray,
    jacobian_out: FloatArray,
) -> float:
    """Write what is missing to a target, σ* − σ = −e, its rate −∂e/∂t, and the Jacobian.

    Args:
        error, error_rate, jacobian: e (m,), ∂e/∂t (m,) and ∂e/∂q (m, n).
        errors_out, rates_out, jacobian_out: written, (m,), (m,) and (m, n).

    Returns:
        |e|.
    """
    square = 0.0
    for row in range(error.size):
        square += error[row] * error[row]
        errors_out[row], rates_out[row] = -error[row], -error_rate[row]
        for i in range(jacobian.shape[1]):
            jacobian_out[row, i] = jacobian[row, i]
    return math.sqrt(square)


@kernel("f8(f8[::1], f8, f8[::1], f8[::1], f8[::1])")
def cut(
    dq: FloatArray, share: float, lower: FloatArray, upper: FloatArray, out: FloatArray
) -> float:
    """Write share·dq, cut to bounds, all (n,); the least distance from one of them."""
    margin = math.inf
    for i in range(dq.size):
        out[i] = min(max(share * dq[i], lower[i]), upper[i])
        margin = min(margin, out[i] - lower[i], upper[i] - out[i])
    return margin
