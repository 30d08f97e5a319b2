"""Powers of two that bring numbers of any size near 1 without rounding them.

Kernels square their inputs: without scaling a gradient of 1e-160 would vanish and one of 1e160
overflow.
"""

from __future__ import annotations

import math

import numpy as np

from hoap3.protocol.runtime.numba_jit import Vector, inlined

MAX = float(np.finfo(np.float64).max)
TINY = float(np.finfo(np.float64).tiny)  # smallest normal number, 2.2e-308


@inlined
def largest(values: Vector) -> float:
    """Largest absolute value of an array of one dimension; inf if one of them is not finite."""
    top = 0.0
    for i in range(values.size):
        magnitude = abs(values[i])
        if not magnitude <= MAX:
            return math.inf
        top = max(top, magnitude)
    return top


@inlined
def power_halves(exponent: int) -> tuple[float, float]:
    """Two factors whose product is 2**exponent, for |exponent| ≤ 2000, where one may overflow."""
    half = exponent // 2
    return math.ldexp(1.0, half), math.ldexp(1.0, exponent - half)


@inlined
def times_power(value: float, exponent: int) -> float:
    """``value * 2**exponent``, rounded only where it is subnormal, ±inf where it overflows."""
    mantissa, own = math.frexp(value)
    if mantissa != 0.0 and own + exponent > 1024:
        return math.copysign(math.inf, value)
    return math.ldexp(mantissa, own + exponent)
