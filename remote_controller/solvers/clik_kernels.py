"""Closed-loop inverse kinematics of prioritised tasks, as matrices.

Marti-Saumell et al., (7): for tasks J_1 … J_h in the order of their priorities and errors e,

    dq = B Λ e,   B = [J_1⁺ | N_1 J_2⁺ | … | N_{h−1} J_h⁺],   Λ diagonal,

where N_i projects onto what the first i tasks leave free. The errors then follow ė = −L Λ e with
L = [J_1; …; J_h] B, block lower triangular.

All is computed in an orthonormal basis Q of the rows, J = R Q: what task i adds to the basis is
Q_i, and N_{i−1} J_i⁺ = Q_iᵀ M_i, so that L_ki = R_ki M_i, and no projector is ever formed.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from protocol.compilation import inlined, kernel
from remote_controller.solvers.dense_kernels import add, add_rows, dot, not_finite, orthogonalise

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

RANK = 1e-8  # of a row's length: less than that of it outside the rows before is nothing
AGAIN = 0.5  # of the squared length: where less is left, rounding counts, and once more removes it
ROUNDING = 1e-13  # of the product of two lengths: a dot product up to that is 0


@kernel("UniTuple(f8, 2)(f8[::1], f8[:,::1], i8, f8[::1])")
def _reduce(row: Array, basis: Array, count: int, factors: Array) -> tuple[float, float]:
    """Take the first `count` rows of the basis out of a row (Gram and Schmidt, twice if need be).

    Adds what it took to the factors; returns the lengths before and after.
    """
    whole = dot(row, row)
    before = whole
    for _ in range(2):
        for p in range(count):
            share = dot(basis[p], row)
            factors[p] += share
            add(row, -share, basis[p])
        left = dot(row, row)
        if left > AGAIN * before:
            break
        before = left
    return math.sqrt(whole), math.sqrt(left)


@inlined
def _divide(row: Array, size: float) -> None:
    inverse = 1.0 / size
    for j in range(row.size):
        row[j] *= inverse


@inlined
def _plain_inverse(own: Array, d: int, first: int, last: int, T: Array, target: Array) -> bool:
    """Rows of M_iᵀ into target from [R_i | damping·I] = T·P; False where rows are dependent.

    own: [R_i | damping·I], its first d rows; overwritten by P.
    """
    for a in range(d):
        for b in range(d):
            T[a, b] = 0.0
        whole, left = _reduce(own[a], own, a, T[a])
        if not left > RANK * whole:
            return False
        T[a, a] = left
        _divide(own[a], left)
    for q in range(d):
        a = d - 1 - q
        row = target[a]
        for p in range(first, last):
            row[p] = own[a, p]
        for b in range(a + 1, d):
            add(row[first:last], -T[b, a], target[b, first:last])
        _divide(row[first:last], T[a, a])
    return True


@inlined
def _deficient_inverse(R: Array, own: Array, d: int, first: int, last: int, target: Array) -> None:
    """The same from orthogonal rows A with AᵀA = RᵀR: R⁺ = Aᵀ diag(|A_k|⁻⁴) A Rᵀ.

    R: the task's rows; own: A, written.
    """
    longest = 0.0
    for a in range(d):
        for p in range(own.shape[1]):
            own[a, p] = R[a, p] if p < last else 0.0
    orthogonalise(own, d)
    for a in range(d):
        longest = max(longest, dot(own[a], own[a]))
        for p in range(first, last):
            target[a, p] = 0.0
    for k in range(d):
        square = dot(own[k], own[k])
        if square > RANK * RANK * longest:
            for a in range(d):
                share = dot(own[k, :last], R[a, :last]) / (square * square)
                add(target[a, first:last], share, own[k, first:last])


@inlined
def _close_loop(
    offsets: Indices, weights: Array, R: Array, M: Array, lengths: Array, L: Array
) -> None:
    """The lower block triangle of L = D R Mᵀ D⁻¹."""
    n = R.shape[0]
    for a in range(n):
        lengths[a] = math.sqrt(dot(R[a], R[a]))
    for task in range(offsets.size - 1):
        for i in range(offsets[task], offsets[task + 1]):
            size = ROUNDING * math.sqrt(dot(M[i], M[i]))
            for a in range(offsets[task], n):
                entry = dot(R[a], M[i])
                kept = abs(entry) > size * lengths[a]
                L[a, i] = entry * weights[a] / weights[i] if kept else 0.0


@kernel(
    "i8(f8[:,::1], i8[::1], f8, f8[::1], f8[:,::1], f8[:,::1], f8[:,::1], f8[:,::1], f8[:,::1],"
    " f8[:,::1], f8[:,::1])"
)
def prioritised(  # noqa: PLR0912 - one task after the other
    jacobian: Array,
    offsets: Indices,
    damping: float,
    weights: Array,
    L: Array,
    B: Array,
    Q: Array,
    R: Array,
    M: Array,
    T: Array,
    own: Array,
) -> int:
    """Write L and Bᵀ.

    Args:
        jacobian: all tasks' rows, (n, joints).
        offsets: where each task begins, and n; (h + 1,).
        damping: d: J_iᵀ(J_i J_iᵀ + d²I)⁻¹ stands for J_i⁺; 0 for the pseudoinverse. L is that of
            the law with the damping, so that what is proved of L holds.
        weights: square roots D of the weights of the errors, (n,): L is D L D⁻¹.
        L: (n, n), written. Entries that are rounding are 0.
        B: Bᵀ, (n, joints), written.
        Q: scratch, (n, joints).
        R, M, T: scratch, (n, n).
        own: scratch, (n, 2n).

    Returns:
        The rank of the stacked Jacobian.
    """
    (n, joints), rank = jacobian.shape, 0
    for task in range(offsets.size - 1):
        start, d, first = offsets[task], offsets[task + 1] - offsets[task], rank
        for i in range(start, start + d):
            for p in range(n):
                R[i, p], M[i, p] = 0.0, 0.0
            if rank == joints:
                for p in range(rank):
                    R[i, p] = dot(Q[p], jacobian[i])
                continue
            row = Q[rank]
            for j in range(joints):
                row[j] = jacobian[i, j]
            whole, left = _reduce(row, Q, rank, R[i])
            if left > RANK * whole:
                R[i, rank] = left
                _divide(row, left)
                rank += 1
        for a in range(d):
            for p in range(2 * n):
                own[a, p] = R[start + a, p] if p < rank else 0.0
            own[a, n + a] = damping
        rows = R[start : start + d]
        if not _plain_inverse(own, d, first, rank, T, M[start : start + d]):
            _deficient_inverse(rows, own, d, first, rank, M[start : start + d])
        for i in range(start, start + d):
            for j in range(joints):
                B[i, j] = 0.0
            add_rows(B[i], M[i], Q, first, rank, 0)
            for a in range(start):
                L[a, i] = 0.0
    _close_loop(offsets, weights, R, M, T[0], L)
    return rank


@inlined
def unfit(jacobian: Array, errors: Array, rates: Array, weights: Array, limits: Array) -> bool:
    """Whether a value is not finite, or the limits do not allow to stand still."""
    found = not_finite(errors) or not_finite(rates) or not_finite(weights)
    for i in range(jacobian.shape[0]):
        found = found or not_finite(jacobian[i]) or not weights[i] > 0.0
    for r in range(limits.shape[1]):
        found = found or not (limits[0, r] <= 0.0 <= limits[1, r])
    return found


@inlined
def feed_forward(B: Array, rates: Array, limits: Array, speed: Array) -> float:
    """Write B·rates, shortened until it keeps the limits; returns the factor."""
    n, share = B.shape[0], 1.0
    for r in range(speed.size):
        speed[r] = 0.0
    add_rows(speed, rates, B, 0, n, 0)
    for r in range(speed.size):
        if speed[r] > limits[1, r]:
            share = min(share, limits[1, r] / speed[r])
        if speed[r] < limits[0, r]:
            share = min(share, limits[0, r] / speed[r])
    if share < 1.0:
        for r in range(speed.size):
            speed[r] = min(max(share * speed[r], limits[0, r]), limits[1, r])
    return share
