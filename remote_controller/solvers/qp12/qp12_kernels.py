"""QP12 without a QP solver: the answer, and the residual that certifies it.

    min  γ|u|₁ + (1−γ)/2 |u|²   subject to   gradient·u = −decrease

Gonçalves, Adorno, Crosnier, Fraisse, "Stable-by-Design Kinematic Control Based on Optimization",
IEEE T-RO 2020, equation (26). The form of the answer is that of Proposition 6, but neither (28)
nor Algorithm 1 is evaluated as printed: λa − γ cancels when u is small or γ near 1. With
a = |gradient|, A = max a, b = |decrease|, κ = γ/(1−γ) and t = max|u|,

    |u_i| = max(0, (a_i t − κ (A − a_i)) / A),     Σ a_i² t = A b + κ Σ a_i (A − a_i)

where the sums run over the joints that move: λ_M = ((1−γ) t + γ)/A, which is (28) for the joint
with a_i = A, put into (28), and that into the constraint, Σ a_i |u_i| = b. No term of the sums is
negative, so the error is a few units in the last place of t, for every γ and every scale.

Which joints move is found by Newton's method on Σ a_i |u_i|(t) = b, whose left side is convex,
piecewise linear and increasing in t. It starts at t = b/A, which is never too small (A t ≤ b), so
t only falls and joints only drop out: the exact set after at most n rounds, usually two. This
replaces Algorithm 1 and the sort of Algorithm 2.

γ = 1 means the limit γ → 1: the joints tied for the largest gradient share the work evenly, where
Remark 7 takes one of them, M = 1. Both are optimal.
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
from hoap3.remote_controller.solvers.linalg.scaling_kernels import (
    MAX,
    TINY,
    largest,
    power_halves,
    times_power,
)

LARGEST = 2.0**1020  # of b, where ½ ≤ A < 1: leaves room for the sums
SMALL = 2.0**-900  # below, b and κ are lifted by 2^LIFT, and so is u, to keep clear of underflow
LIFT = 200
NOTHING = 2.0**-1000  # u of a lifted b below this rounds to zero once it is lowered again


@inlined
def _solve_for_tau(gradient: Vector, A: float, b: float, kappa_per_A: float) -> float:
    """Solve f(τ) = Σ a max(0, a τ − κ/A (A − a)) = b for τ = t/A.

    f is convex and rises, and A² τ ≤ f(τ) = b, so that Newton's method from b/A² falls to τ from
    above; each round drops the joints that do not move at its τ. With cost = κ/A (A − a) the piece
    of f there is weight·τ − Σ a·cost, weight = Σ a², and supply = b + Σ a·cost.
    """
    tau = b / (A * A)
    moving = gradient.size + 1
    while True:
        supply, weight, still_moving = b, 0.0, 0
        for i in range(gradient.size):
            a = abs(gradient[i])
            cost = kappa_per_A * (A - a)
            moves = a * tau > cost
            supply += a * cost if moves else 0.0  # no branch: nothing predicts which joints move
            weight += a * a if moves else 0.0
            still_moving += moves
        if still_moving >= moving:
            return tau
        moving = still_moving
        tau = supply / weight


@inlined
def solve_qp12(gradient: Vector, decrease: float, gamma: float, out: Vector) -> int:
    """Solve one QP12; for other kernels to call.

    Args:
        gradient: ∇V, shape (n,).
        decrease: −V̇ to be reached, ρΨ in the paper; any sign, u is odd in it.
        gamma: 0 (even) to 1 (sparse). κ = γ/(1−γ) has the unit of u.
        out: u, shape (n,). All zeros where the status is not ``OK``, untouched where it is
            ``BAD_SHAPE``. May be ``gradient`` itself.

    Returns:
        ``OK``, with zeros where max|u| would underflow; ``INFEASIBLE``: the gradient is zero, the
        decrease is not; ``BAD_INPUT``: something is not finite, or γ not in [0, 1]; ``BAD_SHAPE``;
        ``OUT_OF_RANGE``: max|u| could exceed about 1e307.
    """
    n = gradient.size
    if out.size != n:
        return BAD_SHAPE
    top = largest(gradient)
    if not (top <= MAX and abs(decrease) <= MAX and 0.0 <= gamma <= 1.0):
        out[:] = 0.0
        return BAD_INPUT
    if decrease == 0.0 or top == 0.0:
        out[:] = 0.0
        return OK if decrease == 0.0 else INFEASIBLE

    # From here on a and b are scaled by the same power of two, which makes 1/2 ≤ A < 1.
    A, exponent = math.frexp(top)
    lift = 0
    b = times_power(abs(decrease), -exponent)
    if b < SMALL:
        lift = LIFT
        b = times_power(abs(decrease), LIFT - exponent)
    if b > LARGEST or b < NOTHING:
        out[:] = 0.0
        return OUT_OF_RANGE if b > LARGEST else OK

    kappa_per_A = math.ldexp(gamma, lift) / (1.0 - gamma) / A if gamma < 1.0 else 0.0
    first, second = power_halves(-exponent)  # first·second = 2^−exponent
    for i in range(n):
        counts = gamma < 1.0 or abs(gradient[i]) == top  # γ = 1: least norm over the tied joints
        out[i] = gradient[i] * first * second if counts else 0.0
    tau = _solve_for_tau(out, A, b, kappa_per_A)
    sign = math.ldexp(1.0 if decrease < 0.0 else -1.0, -lift)  # of u_i·gradient_i, unlifted
    for i in range(n):
        a = abs(out[i])
        x = a * tau - kappa_per_A * (A - a)  # (28) of QP12, in the form above
        out[i] = math.copysign(x, out[i]) * sign if x > 0.0 else 0.0
    return OK


@inlined
def qp12_kkt_residual(gradient: Vector, decrease: float, gamma: float, u: Vector) -> float:
    """How far u is from optimal, relative and without units; for other kernels to call.

    Optimality, (31) and (32) of the paper, means: the constraint holds, no joint moves up its
    gradient, and with x = −sign(decrease)·sign(gradient)·u, a, A and κ as above and t the x of
    (the first of) the joints with a_i = A,

        x_i = w_i,   w_i = max(0, (a_i t − κ (A − a_i)) / A).

    The residual is the larger of

        primal         |gradient·u + decrease| / (Σ |gradient_i u_i| + |decrease|)
        stationarity   max_i |x_i − w_i| / max_i |u_i|

    For γ = 1 every x ≥ 0 on the tied joints is optimal: w_i = max(0, x_i) where a_i = A, else 0.
    If decrease = 0, or the gradient is zero, it is 0 for u = 0 = decrease and 1 otherwise. Inputs
    that cannot be judged (not finite, γ outside [0, 1], unlike sizes) give inf; NaN is never
    returned. Speeds below 2.2e-308, where doubles lose digits, count as rounding.

    It bounds the error: |u − u*| ≤ 4 n · residual · |u*| in the largest component, to first order,
    for every γ < 1. For with r the residual x is w(t) up to r |u|, so Σ a_i w_i(t) misses b by at
    most 2 r b + n A r |u|. It rises with t by A or more, and b ≤ n A |u*|, so t is wrong by at most
    3 n r |u*|, w by no more than t, and x by r |u| more than w. A stationarity measured in the
    objective's own terms would say nothing near γ = 1. Rounding alone gives about n · 1e-16.
    """
    n = gradient.size
    if u.size != n:
        return math.inf
    top, span = largest(gradient), largest(u)
    if not (top <= MAX and span <= MAX and abs(decrease) <= MAX and 0.0 <= gamma <= 1.0):
        return math.inf
    if decrease == 0.0 or top == 0.0:
        return 0.0 if decrease == 0.0 and span == 0.0 else 1.0

    A, exponent = math.frexp(top)
    first, second = power_halves(-exponent)  # first·second = 2^−exponent
    b = times_power(abs(decrease), -exponent)
    kappa_per_A = gamma / (1.0 - gamma) / A if gamma < 1.0 else 0.0
    sign = 1.0 if decrease < 0.0 else -1.0  # of u_i·gradient_i
    t = 0.0
    for i in range(n):
        if abs(gradient[i]) == top:
            t = math.copysign(1.0, gradient[i]) * sign * u[i]
            break

    power, total, deviation = -b, b, 0.0
    for i in range(n):
        a = abs(gradient[i]) * first * second
        x = math.copysign(1.0, gradient[i]) * sign * u[i]
        if gamma < 1.0:
            wanted = max(0.0, a * (t / A) - kappa_per_A * (A - a))
        else:
            wanted = max(0.0, x) if abs(gradient[i]) == top else 0.0
        power += a * x
        total += a * abs(x)
        deviation = max(deviation, abs(x - wanted))
    residual = max(abs(power) / max(total, TINY), deviation / max(span, TINY))
    return residual if residual <= MAX else math.inf


@kernel()
def qp12_kernel(
    n: int, gradient: Vector, decrease: float, gamma: float, out: Vector
) -> tuple[int, float]:
    """``solve_qp12`` for n joints; status and KKT residual, inf where the status is not ``OK``."""
    status = solve_qp12(gradient, decrease, gamma, out) if gradient.size == n else BAD_SHAPE
    if status != OK:
        return status, math.inf
    return status, qp12_kkt_residual(gradient, decrease, gamma, out)
