"""The input of least ℓp norm that makes V decrease as demanded, in closed form for every p > 0.

    min  |u|_p   subject to   gradient·u = −decrease

Gonçalves et al., IEEE T-RO 2020, Example 2 and (9). As printed, |a|^{1/(p−1)} leaves the range of
doubles near p = 1. With r_i = |gradient_i|/A, A = max|gradient|, and s = |decrease|/A every power
is of a number up to 1, and the denominator is 1 or more:

    |u_i| = s r_i^{1/(p−1)} / Σ r_j^{p/(p−1)}      p > 1; p = ∞ has the exponents 0 and 1
    |u_1| = s, all others 0                         0 < p ≤ 1, r_1 = 1
"""

from __future__ import annotations

import math

from hoap3.protocol.runtime.numba_jit import Vector, inlined, kernel
from hoap3.remote_controller.solvers.base.status import (
    BAD_INPUT,
    BAD_SHAPE,
    INFEASIBLE,
    OK,
    OUT_OF_RANGE,
)
from hoap3.remote_controller.solvers.linalg.scaling_kernels import MAX, largest

LARGEST = 2.0**1020  # of |decrease|/A


@inlined
def solve_lp_norm(gradient: Vector, decrease: float, p: float, out: Vector) -> int:
    """Solve one; for other kernels to call.

    Where |gradient| is largest for several joints, p > 1 treats them alike (the answer is unique);
    for p = 1 every share among them is optimal, for p < 1 each of them alone; the first is taken.

    Args:
        gradient: ∇V, shape (n,).
        decrease: −V̇ to be reached; any sign, u is odd in it.
        p: > 0, may be inf.
        out: u, shape (n,). Zeros where the status is not `OK`, untouched if it is `BAD_SHAPE`.

    Returns:
        `OK`; `INFEASIBLE`: the gradient is zero, the decrease is not; `BAD_INPUT`: gradient or
        decrease not finite, or p not above 0; `BAD_SHAPE`; `OUT_OF_RANGE`: beyond 1e307.
    """
    n = gradient.size
    if out.size != n:
        return BAD_SHAPE
    top = largest(gradient)
    if not (top <= MAX and abs(decrease) <= MAX and p > 0.0):
        out[:] = 0.0
        return BAD_INPUT
    if decrease == 0.0 or top == 0.0:
        out[:] = 0.0
        return OK if decrease == 0.0 else INFEASIBLE
    size = decrease / top
    if not abs(size) <= LARGEST:
        out[:] = 0.0
        return OUT_OF_RANGE
    if p <= 1.0:
        found = False
        for i in range(n):
            first = not found and abs(gradient[i]) == top
            found = found or first
            out[i] = -math.copysign(size, size * math.copysign(1.0, gradient[i])) if first else 0.0
        return OK
    power = 1.0 / (p - 1.0)
    total = 0.0
    for i in range(n):
        ratio = abs(gradient[i]) / top
        share = ratio**power if ratio > 0.0 else 0.0
        total += ratio * share
        out[i] = math.copysign(share, gradient[i])
    size /= total
    for i in range(n):
        out[i] = -size * out[i] if out[i] != 0.0 else 0.0
    return OK


@inlined
def lp_norm_residual(gradient: Vector, decrease: float, p: float, u: Vector) -> float:
    """How far u is from optimal; for other kernels to call.

    The larger of the relative error of the equation and of the gap

        1 − |decrease| / (|gradient|_q |u|_p),   1/p + 1/q = 1,   q = ∞ for p ≤ 1,

    which Hölder's inequality makes non-negative, and zero for an optimal u only. It is of second
    order in an error of u where 2 ≤ p < ∞, and for 1 < p < 2 where no gradient_i is 0; of first
    order for p = ∞. inf where nothing can be judged, never NaN.
    """
    n = gradient.size
    top, span = largest(gradient), largest(u)
    if not (u.size == n and top <= MAX and span <= MAX and abs(decrease) <= MAX and p > 0.0):
        return math.inf
    if decrease == 0.0 or top == 0.0 or span == 0.0:
        return 0.0 if decrease == 0.0 and span == 0.0 else 1.0
    q = math.inf if p <= 1.0 else (p / (p - 1.0) if p <= MAX else 1.0)
    needed = abs(decrease) / top / span
    given, total, sum_p, sum_q = 0.0, 0.0, 0.0, 0.0
    for i in range(n):
        ratio, share = gradient[i] / top, u[i] / span
        given += ratio * share
        total += abs(ratio * share)
        sum_p += abs(share) ** p if p <= MAX and share != 0.0 else 0.0
        sum_q += abs(ratio) ** q if q <= MAX and ratio != 0.0 else 0.0
    norm_p = sum_p ** (1.0 / p) if p <= MAX else 1.0
    norm_q = sum_q ** (1.0 / q) if q <= MAX else 1.0
    sign = 1.0 if decrease > 0.0 else -1.0
    error = abs(given * sign + needed) / (total + needed)
    gap = abs(1.0 - needed / (norm_p * norm_q))
    residual = max(error, gap)
    return residual if residual <= MAX else math.inf


@kernel()
def lp_norm_kernel(
    n: int, gradient: Vector, decrease: float, p: float, out: Vector
) -> tuple[int, float]:
    """`solve_lp_norm` for n joints; status and residual, inf where the status is not `OK`."""
    status = solve_lp_norm(gradient, decrease, p, out) if gradient.size == n else BAD_SHAPE
    if status != OK:
        return status, math.inf
    return status, lp_norm_residual(gradient, decrease, p, out)
