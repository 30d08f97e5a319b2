"""The compiled parts of the general problem (3): the cheap answer, the scaled rows, the proof.

    min  Φ(u)   subject to   ∇V·u + ∂V/∂t = −ρΨ,  A u ≤ b,  C u = c,  lower ≤ u ≤ upper

Gonçalves et al., IEEE T-RO 2020. Everything is scaled to y = W u with W = diag(weights), the
gradient to s = W⁻¹∇V/top with top = max|W⁻¹∇V|, and every row of A W⁻¹ and C W⁻¹ to length 1.
QP12's Φ is divided by 1 − γ, κ|y|₁ + ½|y|² with κ = γ/(1 − γ): y, right sides and multipliers are
then all of the size of a weighted speed, or of κ.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from hoap3.protocol.runtime.numba_jit import Indices, Matrix, Vector, inlined, kernel
from hoap3.remote_controller.solvers.base.status import (
    BAD_INPUT,
    BAD_SHAPE,
    CANNOT_DESCEND,
    DESCENDS_FASTER,
    OK,
    STATIONARY,
    ZERO_GRADIENT,
)
from hoap3.remote_controller.solvers.linalg.scaling_kernels import MAX, TINY, largest
from hoap3.remote_controller.solvers.qp12.bounded_qp12_kernels import (
    bounded_kkt_residual,
    bounds_fit,
    most_decrease,
    solve_bounded_qp12,
)

STILL, FREE, CLAMPED, QP = 0, 1, 2, 3
RATE, RHO, MARGIN, RESIDUAL = 0, 1, 2, 3  # places in `result`
NO_BOUND = 1e30  # what QP solvers take for infinity
LARGEST_RHO = 1e9  # stands for infinity where Ψ is zero or nearly so
AT_REST = 1e-12  # a fall of V, divided by top, that is no motion
ROUNDING = 1e-14  # of a row, relative to the sum of its terms' sizes
NORM, MAXIMUM, SQUARES = 0, 1, 2  # kinds of objective: qp12, largest speed, least squares


@kernel()
def find_rho(decrease: float, psi: float, drift: float) -> float:
    """ρ = −V̇/Ψ, where V̇ = drift − decrease; within ±`LARGEST_RHO`, 1 where nothing is asked."""
    fall = decrease - drift
    if fall == 0.0 and psi == 0.0:
        return 1.0
    if abs(fall) >= LARGEST_RHO * psi:
        return math.copysign(LARGEST_RHO, fall)
    return fall / psi


@kernel()
def rate_status(decrease: float, asked: float, drift: float, top: float, can_rest: bool) -> int:
    """What it means that V falls by `decrease` (without drift) instead of `asked`.

    top is the size of the gradient that the rates belong to: max|∇V| here, 1 for rates that are
    divided by max|W⁻¹∇V| already.

    Returns:
        `OK`: as asked, or more slowly; `DESCENDS_FASTER`: than asked, for the bounds leave no less;
        `STATIONARY`: where the robot may rest and no u makes V fall; `CANNOT_DESCEND`: V rises.
    """
    if decrease == asked:
        return OK
    if decrease > asked:
        return DESCENDS_FASTER
    rest = AT_REST * top
    if can_rest and abs(drift) <= rest and decrease <= rest:
        return STATIONARY
    return OK if decrease - drift >= -rest else CANNOT_DESCEND


class Problem(NamedTuple):
    """(3): ∇V·u + ∂V/∂t = −ρΨ, A u ≤ b, C u = c, lower ≤ u ≤ upper.

    Attributes:
        gradient: ∇V, (n,).
        psi: Ψ ≥ 0.
        drift: ∂V/∂t, (18).
        A: (m, n).
        b: (m,), inf where a row is off.
        C: (k, n).
        c: (k,).
        lower: (n,).
        upper: (n,).
    """

    gradient: Vector
    psi: float
    drift: float
    A: Matrix
    b: Vector
    C: Matrix
    c: Vector
    lower: Vector
    upper: Vector


@inlined
def fits(size: Indices, weights: Vector, problem: Problem) -> int:
    """`OK`, `BAD_SHAPE`, or `BAD_INPUT`: something is not finite, or no u is within the bounds."""
    gradient, psi, drift, A, b, C, c, lower, upper = problem
    n = weights.size
    if not (
        size[0] == n
        and size[1] == b.size
        and size[2] == c.size
        and gradient.size == n
        and lower.size == n
        and upper.size == n
        and A.shape[1] == n
        and A.shape[0] == b.size
        and C.shape[1] == n
        and C.shape[0] == c.size
    ):
        return BAD_SHAPE
    good = 0.0 <= psi <= MAX and abs(drift) <= MAX and largest(gradient) <= MAX
    for i in range(n):
        good &= TINY <= weights[i] <= MAX
        good &= lower[i] <= upper[i] and lower[i] <= MAX and upper[i] >= -MAX
    for j in range(b.size):
        good &= b[j] >= -MAX  # inf switches the row off; NaN and −inf are refused
        if b[j] <= MAX:
            good &= largest(A[j]) <= MAX
    for j in range(c.size):
        good &= abs(c[j]) <= MAX and largest(C[j]) <= MAX
    return OK if good else BAD_INPUT


@inlined
def least_margin(
    A: Matrix, b: Vector, lower: Vector, upper: Vector, u: Vector
) -> tuple[float, bool]:
    """Smallest b − A u and distance to a bound, in their own units; whether u keeps all rows."""
    margin, kept = math.inf, True
    for i in range(u.size):
        margin = min(margin, upper[i] - u[i], u[i] - lower[i])
    for j in range(b.size):
        if b[j] <= MAX:
            given, size = 0.0, abs(b[j])
            for i in range(u.size):
                given += A[j, i] * u[i]
                size += abs(A[j, i] * u[i])
            margin = min(margin, b[j] - given)
            kept &= b[j] - given >= -ROUNDING * size
    return margin, kept


@inlined
def rate_of(gradient: Vector, u: Vector) -> float:
    """∇V·u."""
    rate = 0.0
    for i in range(u.size):
        rate += gradient[i] * u[i]
    return rate


@kernel()
def try_closed_form(
    size: Indices,
    gradient: Vector,
    psi: float,
    drift: float,
    ceiling: float,
    gamma: float,
    A: Matrix,
    b: Vector,
    C: Matrix,
    c: Vector,
    lower: Vector,
    upper: Vector,
    work: Matrix,
    out: Vector,
    result: Vector,
) -> tuple[int, int]:
    """Check the problem; answer it where the optimum within the bounds keeps all rows.

    That optimum is QP12's, by exact clamping, with the ρ that the bounds allow. If it keeps rows
    that were left out of the search, it is the optimum with them too, and so is its ρ.

    Args:
        size: n, m and k.
        gradient: ∇V, (n,).
        psi: Ψ ≥ 0.
        drift: ∂V/∂t.
        ceiling: largest ρ, usually 1.
        gamma: of QP12; negative for another objective, for which only the checks are made.
        A: (m, n).
        b: (m,), inf switches a row off.
        C: (k, n).
        c: (k,).
        lower: (n,).
        upper: (n,).
        work: of `solve_bounded_qp12`, weights in its first row.
        out: u, (n,); zeros unless answered.
        result: ∇V·u + ∂V/∂t, ρ, smallest margin, KKT residual; (4,).

    Returns:
        Status, and path: `QP` where the answer has to be searched for.
    """
    status = fits(size, work[0], Problem(gradient, psi, drift, A, b, C, c, lower, upper))
    if status == OK and not gamma <= 1.0:
        status = BAD_INPUT
    result[RATE], result[RHO], result[MARGIN] = 0.0, 0.0, -math.inf
    result[RESIDUAL] = math.inf
    out[:] = 0.0
    if status != OK:
        return status, STILL
    result[RATE] = drift
    result[MARGIN], can_rest = least_margin(A, b, lower, upper, out)
    can_rest &= bounds_fit(lower, upper) and largest(c) == 0.0
    top, asked = largest(gradient), ceiling * psi + drift
    if top == 0.0 and asked != 0.0:
        result[RHO] = find_rho(0.0, psi, drift)
        if can_rest:
            result[RESIDUAL] = 0.0
        return ZERO_GRADIENT, STILL if can_rest else QP
    if gamma < 0.0 or c.size > 0 or not bounds_fit(lower, upper):
        return OK, QP
    decrease = min(asked, most_decrease(gradient, lower, upper, True))
    decrease = max(decrease, -most_decrease(gradient, lower, upper, False))
    verdict = rate_status(decrease, asked, drift, top, can_rest)
    if verdict == STATIONARY:
        result[RESIDUAL] = 0.0
        return STATIONARY, STILL
    status, clamped = solve_bounded_qp12(gradient, decrease, gamma, lower, upper, work, out)
    if status != OK:
        out[:] = 0.0
        return status, STILL
    margin, kept = least_margin(A, b, lower, upper, out)
    if not kept:
        return OK, QP
    result[RATE] = rate_of(gradient, out) + drift
    result[RHO] = ceiling if decrease == asked else find_rho(decrease, psi, drift)
    result[MARGIN] = margin
    result[RESIDUAL] = bounded_kkt_residual(gradient, decrease, gamma, lower, upper, out, work)
    return verdict, CLAMPED if clamped > 0 else FREE


@inlined
def _normalise(row: Vector, euclidean: bool) -> float:
    """Divide a row by its length, or by its largest entry; that, 0 for a row of zeros."""
    size = largest(row)
    if size == 0.0:
        return 0.0
    length = size
    if euclidean:
        squares = 0.0
        for i in range(row.size):
            squares += (row[i] / size) ** 2
        length = size * math.sqrt(squares)
    for i in range(row.size):
        row[i] /= length
    return length


@kernel()
def fill_kernel(
    gradient: Vector,
    A: Matrix,
    b: Vector,
    C: Matrix,
    c: Vector,
    lower: Vector,
    upper: Vector,
    weights: Vector,
    kind: int,
    rows: Matrix,
    least: Vector,
    most: Vector,
    qp_rows: Matrix,
    qp_least: Vector,
    qp_most: Vector,
) -> tuple[float, int]:
    """Write the scaled problem for the LP, and once more in the variables of the QP.

    The order of rows is A, s, C. A rows that are switched off, or zero with b ≥ 0, are left out,
    but with `MAXIMUM`, whose own rows follow, kept as 0 with NO_BOUND. The limits of s are left to
    others. With kind `NORM` the QP has 2n variables,
    y = p − m with p, m ≥ 0; with `MAXIMUM` n + 1, the last of them max|y|; else y itself.

    Args:
        gradient: ∇V, (n,); the problem must have passed `try_closed_form`.
        A: (m, n).
        b: (m,).
        C: (k, n).
        c: (k,).
        lower: (n,).
        upper: (n,).
        weights: (n,).
        kind: of objective.
        rows: (m + 1 + k, n).
        least: of y and the rows, (n + m + 1 + k,).
        most: likewise.
        qp_rows: (m + 1 + k or more, variables).
        qp_least: of the variables and their rows.
        qp_most: likewise.

    Returns:
        top = max|W⁻¹∇V|, which s was divided by, and how many rows of A were written.
    """
    n, m, k = gradient.size, b.size, c.size
    split = kind == NORM
    variables = qp_rows.shape[1]
    for i in range(n):
        least[i] = max(lower[i] * weights[i], -NO_BOUND)
        most[i] = min(upper[i] * weights[i], NO_BOUND)
        qp_least[i] = max(least[i], 0.0) if split else least[i]
        qp_most[i] = max(most[i], 0.0) if split else most[i]
        if split:
            qp_least[n + i] = max(-most[i], 0.0)
            qp_most[n + i] = max(-least[i], 0.0)
    top = 0.0
    for i in range(n):
        top = max(top, abs(gradient[i] / weights[i]))
    row, used = 0, 0
    for j in range(m + 1 + k):
        side = b[j] if j < m else (c[j - m - 1] if j > m else 0.0)
        if j < m and not side <= MAX and kind != MAXIMUM:
            continue
        for i in range(n):
            entry = A[j, i] if j < m else (C[j - m - 1, i] if j > m else gradient[i])
            rows[row, i] = entry / weights[i] if side <= MAX else 0.0
        length = _normalise(rows[row], j != m)
        if length > 0.0:
            side /= length
        elif j < m and side >= 0.0:
            if kind != MAXIMUM:
                continue
            side = NO_BOUND
        most[n + row] = min(max(side, -NO_BOUND), NO_BOUND)
        least[n + row] = most[n + row] if j > m else -NO_BOUND
        qp_most[variables + row], qp_least[variables + row] = most[n + row], least[n + row]
        for i in range(n):
            qp_rows[row, i] = rows[row, i]
            if split:
                qp_rows[row, n + i] = -rows[row, i]
        row += 1
        used += j < m
    return top, used


@kernel("f8(f8[::1], f8[::1])")
def forced_kernel(least: Vector, most: Vector) -> float:
    """Fastest speed that a limit asks for [of W u]; 0 or less: y = 0 keeps them all.

    Args:
        least: of y and the rows.
        most: likewise.
    """
    forced = -math.inf
    for i in range(least.size):
        forced = max(forced, least[i], -most[i])
    return forced


@kernel()
def finish_kernel(
    y: Vector,
    gradient: Vector,
    psi: float,
    drift: float,
    A: Matrix,
    b: Vector,
    lower: Vector,
    upper: Vector,
    weights: Vector,
    out: Vector,
    result: Vector,
) -> None:
    """Write u = W⁻¹y, within its bounds to the last bit, with V̇, ρ and the smallest margin."""
    for i in range(y.size):
        out[i] = min(max(y[i] / weights[i], lower[i]), upper[i])
    rate = rate_of(gradient, out)
    result[RATE] = rate + drift
    result[RHO] = find_rho(-rate, psi, drift)
    result[MARGIN], _ = least_margin(A, b, lower, upper, out)
