"""Inputs along the pseudo-inverse: u ∝ −J⁺ e, the baseline of the papers.

``solve_pinv_plain``: u = −gain J⁺ e.
``solve_pinv``: the same direction, as long as V = |e|²/2 demands: eᵀ J u = −decrease. That is
QP12's constraint, so both decrease V alike and may be compared; QP12 is Gonçalves et al., IEEE
T-RO 2020, whose Table I compares them.

J⁺ = Jᵀ (J Jᵀ)⁻¹ by a Cholesky factorisation of the m×m matrix, where the rows of J are well apart.
That is judged without units: each pivot relative to its own diagonal entry is the squared sine of
a row's angle to the rows before it. Their product is det K, K = J Jᵀ for rows of length 1. As
tr K = m, no eigenvalue is above m, and those but the least multiply to less than e (their mean is
m/(m − 1) at most): cond K < e·m/product (van der Sluis: Cholesky's error knows only this one).

Where that product is below ``WELL_APART``, or the rows' lengths are too unequal, the rows of
[J | e] are rotated until those of J are orthogonal (one-sided Jacobi, Hestenes 1958): an
accurate singular value decomposition that never squares J. Singular values up to
``RANK_TOLERANCE`` times the largest count as zero, so that u is the true pseudo-inverse of the
part that has numerically full rank. Both ways agree where they meet.
"""

from __future__ import annotations

import math

from hoap3.protocol.runtime.numba_jit import Indices, Matrix, Vector, inlined, kernel
from hoap3.remote_controller.solvers.base.status import (
    BAD_INPUT,
    BAD_SHAPE,
    INFEASIBLE,
    OK,
    OUT_OF_RANGE,
)
from hoap3.remote_controller.solvers.linalg.scaling_kernels import (
    MAX,
    largest,
    power_halves,
    times_power,
)

RANK_TOLERANCE = 1e-12  # far above the rounding of a kinematic chain, far below any real posture
WELL_APART = 1e-3
EQUAL_LENGTHS = 1e-12  # of squared rows
ORTHOGONAL = 4e-15  # cosine of an angle that is rounding
NEGLIGIBLE = 1e-60  # squared length, relative to rows of length about 1
SWEEPS = 30  # convergence is quadratic; about six suffice


def work_shape(m: int, n: int) -> tuple[int, int]:
    """Shape of the work array for m task rows and n joints: [J | e | factor of J Jᵀ | y]."""
    return m, n + m + 2


@inlined
def solve_pinv(
    jacobian: Matrix, error: Vector, decrease: float, work: Matrix, out: Vector
) -> tuple[int, int]:
    """Write the u ∝ −J⁺ e with eᵀ J u = −decrease; for other kernels to call.

    Args:
        jacobian: J, shape (m, n).
        error: e, shape (m,).
        decrease: −V̇ to be reached, any sign.
        work: scratch, shape ``work_shape(m, n)``; may hold anything.
        out: u, shape (n,). All zeros where the status is not ``OK``, untouched where it is
            ``BAD_SHAPE``.

    Returns:
        Status and numerical rank of J. ``INFEASIBLE``: Jᵀe = 0 (|J J⁺ e| ≤ ``RANK_TOLERANCE`` |e|)
        and the decrease is not; ``BAD_INPUT``: something is not finite; ``BAD_SHAPE``;
        ``OUT_OF_RANGE``: u overflows.
    """
    status, rank, exponent_j, exponent_e, rate = _direction(jacobian, error, work, out)
    if status == BAD_SHAPE:
        return status, rank
    if status == OK and not abs(decrease) <= MAX:
        status = BAD_INPUT
    if status == OK and decrease != 0.0:
        if rate > 0.0:
            scale = times_power(decrease, -exponent_j - exponent_e) / rate
            return _scaled(scale, out), rank
        status = INFEASIBLE
    out[:] = 0.0
    return status, rank


@inlined
def solve_pinv_plain(
    jacobian: Matrix, error: Vector, gain: float, work: Matrix, out: Vector
) -> tuple[int, int]:
    """Write u = −gain J⁺ e; for other kernels to call.

    Arguments and result are those of ``solve_pinv``, with a gain [1/s] in place of the decrease;
    never ``INFEASIBLE``.
    """
    status, rank, exponent_j, exponent_e, _ = _direction(jacobian, error, work, out)
    if status == OK and abs(gain) <= MAX:
        return _scaled(times_power(gain, exponent_e - exponent_j), out), rank
    if status != BAD_SHAPE:
        out[:] = 0.0
    return BAD_INPUT if status == OK else status, rank


@inlined
def _scaled(scale: float, out: Vector) -> int:
    """Multiply by −scale, in place."""
    status = OK
    for j in range(out.size):
        u = -scale * out[j] if out[j] != 0.0 else 0.0
        if not abs(u) <= MAX:
            status = OUT_OF_RANGE
        out[j] = u
    if status != OK:
        out[:] = 0.0
    return status


@inlined
def _direction(
    jacobian: Matrix, error: Vector, work: Matrix, out: Vector
) -> tuple[int, int, int, int, float]:
    """Write w = J'⁺ e' into out, for J' = J 2^-exponent_j and e' = e 2^-exponent_e near 1.

    Returns:
        Status (``OK``, ``BAD_INPUT``, ``BAD_SHAPE``), rank, exponent_j, exponent_e, and
        rate = e'ᵀ J' w, which is 0 exactly where no input changes |e|.
    """
    m, n = jacobian.shape
    rows, columns = work.shape
    if error.size != m or out.size != n or rows != m or columns != n + m + 2:
        return BAD_SHAPE, 0, 0, 0, 0.0
    top_j, top_e = 0.0, largest(error)
    for i in range(m):
        top_j = max(top_j, largest(jacobian[i]))
    if not (top_j <= MAX and top_e <= MAX):
        return BAD_INPUT, 0, 0, 0, 0.0
    out[:] = 0.0
    if top_j == 0.0:
        return OK, 0, 0, 0, 0.0

    exponent_j, exponent_e = math.frexp(top_j)[1], math.frexp(top_e)[1]
    first_j, second_j = power_halves(-exponent_j)
    first_e, second_e = power_halves(-exponent_e)
    for i in range(m):
        for j in range(n):
            work[i, j] = jacobian[i, j] * first_j * second_j
        work[i, n] = error[i] * first_e * second_e

    if _factorise(work, m, n):
        rank, reached = m, True
        _solve_factorised(work, m, n, out)
    else:
        _orthogonalise(work, m, n)
        rank, reached = _sum_orthogonal(work, m, n, out)
    rate = 0.0
    if reached:
        for j in range(n):
            slope = 0.0
            for i in range(m):
                slope += work[i, j] * work[i, n]
            rate += slope * out[j]
    return OK, rank, exponent_j, exponent_e, rate


@inlined
def _product(work: Matrix, i: int, k: int, n: int) -> float:
    """Scalar product of rows i and k of J, in four sums that the processor forms side by side."""
    s0, s1, s2, s3 = 0.0, 0.0, 0.0, 0.0
    for j in range(0, n - 3, 4):
        s0 += work[i, j] * work[k, j]
        s1 += work[i, j + 1] * work[k, j + 1]
        s2 += work[i, j + 2] * work[k, j + 2]
        s3 += work[i, j + 3] * work[k, j + 3]
    for j in range(n - n % 4, n):
        s0 += work[i, j] * work[k, j]
    return (s0 + s1) + (s2 + s3)


@inlined
def _factorise(work: Matrix, m: int, n: int) -> bool:
    """Write the Cholesky factor of J Jᵀ; False where it could not be trusted."""
    start = n + 1
    shortest, longest, apart = math.inf, 0.0, 1.0
    for i in range(m):
        length = _product(work, i, i, n)
        shortest, longest = min(shortest, length), max(longest, length)
        if shortest <= EQUAL_LENGTHS * longest:
            return False
        rest = length
        for k in range(i):
            part = _product(work, i, k, n)
            for h in range(k):
                part -= work[i, start + h] * work[k, start + h]
            part /= work[k, start + k]
            work[i, start + k] = part
            rest -= part * part
        apart *= rest / length
        if not apart >= WELL_APART:
            return False
        work[i, start + i] = math.sqrt(rest)
    return True


@inlined
def _solve_factorised(work: Matrix, m: int, n: int, out: Vector) -> None:
    """Solve L Lᵀ y = e and add Jᵀ y to out."""
    start, y = n + 1, n + 1 + m
    for i in range(m):
        rest = work[i, n]
        for k in range(i):
            rest -= work[i, start + k] * work[k, y]
        work[i, y] = rest / work[i, start + i]
    for i in range(m - 1, -1, -1):
        rest = work[i, y]
        for k in range(i + 1, m):
            rest -= work[k, start + i] * work[k, y]
        work[i, y] = rest / work[i, start + i]
        for j in range(n):
            out[j] += work[i, j] * work[i, y]


@inlined
def _orthogonalise(work: Matrix, m: int, n: int) -> None:
    """Rotate the rows of [J | e] in pairs until those of J are orthogonal."""
    for _ in range(SWEEPS):
        rotated = False
        for p in range(m - 1):
            for q in range(p + 1, m):
                pp, qq = _product(work, p, p, n), _product(work, q, q, n)
                pq = _product(work, p, q, n)
                if min(pp, qq) < NEGLIGIBLE or abs(pq) <= ORTHOGONAL * math.sqrt(pp * qq):
                    continue
                rotated = True
                zeta = (qq - pp) / (2.0 * pq)
                tangent = math.copysign(1.0, zeta) / (abs(zeta) + math.sqrt(1.0 + zeta * zeta))
                cosine = 1.0 / math.sqrt(1.0 + tangent * tangent)
                sine = cosine * tangent
                for j in range(n + 1):
                    x, y = work[p, j], work[q, j]
                    work[p, j] = cosine * x - sine * y
                    work[q, j] = sine * x + cosine * y
        if not rotated:
            break


@inlined
def _sum_orthogonal(work: Matrix, m: int, n: int, out: Vector) -> tuple[int, bool]:
    """Add Σ row_i e_i/|row_i|² over the rows that count; rank, and if |J J⁺ e| is not rounding."""
    start = n + 1
    longest = 0.0
    for i in range(m):
        work[i, start] = _product(work, i, i, n)
        longest = max(longest, work[i, start])
    rank, within, whole = 0, 0.0, 0.0
    for i in range(m):
        whole += work[i, n] * work[i, n]
        if work[i, start] > RANK_TOLERANCE * RANK_TOLERANCE * longest:
            rank += 1
            within += work[i, n] * work[i, n]
            factor = work[i, n] / work[i, start]
            for j in range(n):
                out[j] += factor * work[i, j]
    return rank, within > RANK_TOLERANCE * RANK_TOLERANCE * whole


@kernel()
def pinv_kernel(
    jacobian: Matrix, error: Vector, decrease: float, work: Matrix, out: Vector, rank: Indices
) -> int:
    """``solve_pinv`` with the rank written into ``rank``, shape (1,)."""
    status, rank[0] = solve_pinv(jacobian, error, decrease, work, out)
    return status


@kernel()
def pinv_plain_kernel(
    jacobian: Matrix, error: Vector, gain: float, work: Matrix, out: Vector, rank: Indices
) -> int:
    """``solve_pinv_plain`` with the rank written into ``rank``, shape (1,)."""
    status, rank[0] = solve_pinv_plain(jacobian, error, gain, work, out)
    return status
