"""Compiled: V = ½ eᵀWe of a task, its gradient and its explicit rate."""

from __future__ import annotations

from hoap3.protocol.messages import FloatArray
from hoap3.protocol.runtime.numba_jit import kernel


@kernel("UniTuple(f8, 2)(f8[::1], f8[:,::1], f8[::1], f8[::1], f8[::1], f8[:,::1], f8[::1])")
def quadratic(
    error: FloatArray,
    jacobian: FloatArray,
    error_rate: FloatArray,
    roots: FloatArray,
    error_out: FloatArray,
    jacobian_out: FloatArray,
    gradient_out: FloatArray,
) -> tuple[float, float]:
    """V and ∂V/∂t; weighted error, Jacobian and gradient are written.

    Args:
        error, jacobian, error_rate: e (m,), ∂e/∂q (m, n) and ∂e/∂t (m,).
        roots: (m,) roots of the diagonal of W.
        error_out, jacobian_out: √W·e and √W·∂e/∂q.
        gradient_out: ∇V = (∂e/∂q)ᵀWe, (n,).

    Returns:
        V = ½ eᵀWe and ∂V/∂t = eᵀW ∂e/∂t.
    """
    m, n = jacobian.shape
    value, rate = 0.0, 0.0
    for i in range(n):
        gradient_out[i] = 0.0
    for row in range(m):
        weighted = roots[row] * error[row]
        error_out[row] = weighted
        value += 0.5 * weighted * weighted
        rate += weighted * roots[row] * error_rate[row]
        for i in range(n):
            slope = roots[row] * jacobian[row, i]
            jacobian_out[row, i] = slope
            gradient_out[i] += slope * weighted
    return value, rate
