"""Proof of an answer to the general problem (3), from its multipliers and no solver's word.

Gonçalves et al., IEEE T-RO 2020, (3); scaled as in `lyapunov_qp_kernels`.
"""

from __future__ import annotations

import math

from hoap3.protocol.runtime.numba_jit import Matrix, Vector, kernel
from hoap3.remote_controller.solvers.linalg.scaling_kernels import MAX, TINY, largest
from hoap3.remote_controller.solvers.lyapunov_qp.lyapunov_qp_kernels import MAXIMUM, NO_BOUND, NORM

ROUNDING = 1e-9  # of max|y|: what is beyond a limit by so little is not
TIED = 1e-9  # of max|y|: joints as fast as that by this much are among the fastest


@kernel()
def residual_kernel(  # noqa: PLR0912 - one branch for each kind and each side
    y: Vector,
    pull: Vector,
    multipliers: Vector,
    rows: Matrix,
    least: Vector,
    most: Vector,
    m: int,
    target: float,
    kind: int,
    kappa: float,
    equality: bool,
    wanted: Vector,
) -> tuple[float, float]:
    """How far y is from optimal for its multipliers, computed without any solver; what it breaks.

    With r = pull − rowsᵀ·multipliers, which would be y if there were no bounds and no kink in Φ,

        y_i = the point within its bounds nearest to sign(r_i)·max(0, |r_i| − κ)      (`NORM`)
        y_i = the point within its bounds and ±max|y| nearest to r_i, where what max|y| cuts off,
              |r_i| − max|y|, adds up to κ                                             (`MAXIMUM`)
        y_i = the point within its bounds nearest to r_i                               (`SQUARES`)

    an inequality has a multiplier ≥ 0, and it or the slack is 0: min(multiplier, slack) = 0; and
    s·y is its target. The residual is the largest deviation from all that, relative to max|y|, or
    to a thousandth of the largest bound where that is more. The deviation of y_i may also be
    relative to a millionth of κ or of the largest multiplier: it is a difference of such numbers.
    How far y is beyond a bound is no such difference, however large they are.
    inf instead of NaN.

    The second number is by how much y is beyond a bound or a row at the most, less 1e-9 of max|y|,
    whatever the multipliers are, if they are finite; the target is not among the rows.

    Args:
        y: (n,).
        pull: y − ∂φ/∂y, φ the smooth part of the objective, (n,); 0 for `NORM` and `MAXIMUM`, where
            φ = ½|y|²: Φ of (26) is divided by 1 − γ, max|y| by 1e-6.
        multipliers: of the rows, (m + 1 + k,).
        rows: (m + 1 + k, n), of which row m is s.
        least: of y and the rows.
        most: likewise.
        m: number of inequality rows.
        target: of s·y.
        kind: of objective.
        kappa: κ, the weight of |y|₁, γ/(1 − γ) (`NORM`), or of max|y|, 1e6 (`MAXIMUM`).
        equality: whether s·y must be equal to its target, or may be less.
        wanted: scratch, (n,).
    """
    n, count = y.size, rows.shape[0]
    span, widest, worst, broken = largest(y), 0.0, 0.0, 0.0
    if not (span <= MAX and largest(multipliers) <= MAX and largest(pull) <= MAX):
        return math.inf, math.inf
    for i in range(n):
        wanted[i] = pull[i]
        broken = max(broken, least[i] - y[i], y[i] - most[i])
        for bound in (least[i], most[i]):
            if abs(bound) < NO_BOUND:
                widest = max(widest, abs(bound))
    for j in range(count):
        given, multiplier = 0.0, multipliers[j]
        for i in range(n):
            given += rows[j, i] * y[i]
            wanted[i] -= rows[j, i] * multiplier
        if j == m:
            miss = given - target
            inactive = abs(target) >= NO_BOUND
            if inactive:
                worst = max(worst, abs(multiplier))
            elif equality:
                worst = max(worst, abs(miss))
            else:
                worst = max(worst, abs(min(multiplier, -miss)))
        elif j > m:
            worst = max(worst, abs(given - most[n + j]))
            broken = max(broken, abs(given - most[n + j]))
        elif most[n + j] >= NO_BOUND:
            worst = max(worst, abs(multiplier))
        else:
            worst = max(worst, abs(min(multiplier, most[n + j] - given)))
            broken = max(broken, given - most[n + j])
    surely, perhaps, tied, away = 0.0, 0.0, 0, 0.0
    for i in range(n):
        low, high, r = least[i], most[i], wanted[i]
        if kind == NORM:
            r = math.copysign(max(0.0, abs(r) - kappa), r)
        elif kind == MAXIMUM:
            cut = max(0.0, abs(r) - span)
            if abs(y[i]) >= span * (1.0 - TIED):
                perhaps += cut
                tied += 1
            limit = high if r > 0.0 else -low
            surely += cut if limit > span * (1.0 + TIED) else 0.0
            low, high = max(low, -span), min(high, span)
        away = max(away, abs(y[i] - min(max(r, low), high)))
    if kind == MAXIMUM:
        short = kappa - perhaps if span > 0.0 else 0.0
        away = max(away, max(short, surely - kappa) / max(tied, 1))
    scale = max(span, 1e-3 * widest, TINY)
    numbers = max(scale, 1e-6 * max(kappa, largest(multipliers)))
    residual = max(max(worst, broken) / scale, away / numbers)
    return residual if residual <= MAX else math.inf, broken - ROUNDING * span


@kernel("f8(f8[::1], f8[::1], f8, f8, f8)")
def misjudged_kernel(y: Vector, slope: Vector, price: float, fall: float, held: float) -> float:
    """How far the fall −s·y is from what its price is worth, relative to y.

    Either its limit holds it back, or the price alone stands for its multiplier.

    Args:
        y: (n,).
        slope: s, (n,).
        price: of the fall; negative: of a rise.
        fall: the limit of −s·y.
        held: multiplier of the limit.
    """
    held *= math.copysign(1.0, fall)  # < 0 where the limit holds
    short = fall
    for i in range(y.size):
        short += slope[i] * y[i]
    wrong = max(held, min(abs(held), abs(short)))
    scale = max(largest(y), 1e-6 * abs(price))
    return wrong / scale if scale > 0.0 else wrong
