"""Closed-loop inverse kinematics of prioritised tasks, as matrices.

Marti-Saumell et al., (7): for tasks J_1 … J_h in the order of their priorities and errors e,

    dq = B Λ e,   B = [J_1⁺ | N_1 J_2⁺ | … | N_{h−1} J_h⁺],   Λ diagonal,

where N_i projects onto what the first i tasks leave free. The errors then follow ė = −L Λ e with
L = [J_1; …; J_h] B, block lower triangular.

All is computed in an orthonormal basis Q of the rows, J = R Q: what task i adds to the basis is
Q_i, and N_{i−1} J_i⁺ = Q_iᵀ M_iᵀ, so that L = R Mᵀ, and no projector is ever formed.
`clik_reference` has the same with projectors, as it is printed.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from hoap3.protocol.runtime.numba_jit import Indices, Matrix, Vector, inlined, kernel
from hoap3.remote_controller.solvers.linalg.dense_kernels import (
    MAX,
    add,
    add_rows,
    dot,
    not_finite,
    orthogonalise,
)

RANK = 1e-8  # of a row's length: less than that of it outside the rows before is nothing
AGAIN = 0.5  # of the squared length: where less is left, rounding counts, and once more removes it
ONE, TWO, THREE = np.uint64(1), np.uint64(2), np.uint64(3)
SINGULAR = 1e-3  # a pivot of L, which is 1 where a task has all that it needs
ROUNDING = 1e-13  # of the product of two lengths: a dot product up to that is 0


class Basis(NamedTuple):
    """The stacked Jacobian, (n, joints), in an orthonormal basis of its rows; all is written.

    Attributes:
        Q: (n, joints), Q Qᵀ = I; as many of its rows count as the Jacobian's rank says.
        R: (n, n), J = R Q; row i ends with what task i adds to the basis.
        M: (n, n), Bᵀ = M Q; row i is 0 outside what its task adds.
        T: (n, n), lower triangular, [R_i | d I] = T P for the task at hand.
        P: (n, 2n), its orthonormal rows; where R_i has dependent ones, orthogonal A, AᵀA = R_iᵀR_i.
        lengths: (n,), |R_i| of each row.
    """

    Q: Matrix
    R: Matrix
    M: Matrix
    T: Matrix
    P: Matrix
    lengths: Vector


@inlined
def _product(A: Matrix, a: int, B: Matrix, b: int, last: int) -> float:
    """Inner product of what A[a] and B[b] begin with, in four partial sums of a fixed order.

    Here and below rows are named by their numbers: a view of a row costs more than a short row.
    Why some numbers are unsigned, `tiled_product_kernels` says.
    """
    s0, s1, s2, s3 = 0.0, 0.0, 0.0, 0.0
    row, other = np.uint64(a), np.uint64(b)
    for q in range(last // 4):
        i = np.uint64(4 * q)
        s0 += A[row, i] * B[other, i]
        s1 += A[row, i + ONE] * B[other, i + ONE]
        s2 += A[row, i + TWO] * B[other, i + TWO]
        s3 += A[row, i + THREE] * B[other, i + THREE]
    for j in range(4 * (last // 4), last):
        s0 += A[a, j] * B[b, j]
    return (s0 + s1) + (s2 + s3)


@kernel(superwords=True)
def _reduce(
    rows: Matrix, row: int, width: int, basis: Matrix, count: int, factors: Matrix, at: int
) -> tuple[float, float]:
    """Take the first `count` rows of the basis out of a row (Gram and Schmidt, twice if need be).

    Four of them at a time, whose shares do not wait for each other. Makes the row a unit vector
    where more than rounding is left, and adds what it took to a row of the factors. Returns the
    lengths before and after.
    """
    whole = _product(rows, row, rows, row, width)
    before = left = whole
    for _ in range(2 if count > 0 else 0):
        for q in range(count // 4):
            p = 4 * q
            s0 = _product(basis, p, rows, row, width)
            s1 = _product(basis, p + 1, rows, row, width)
            s2 = _product(basis, p + 2, rows, row, width)
            s3 = _product(basis, p + 3, rows, row, width)
            factors[at, p] += s0
            factors[at, p + 1] += s1
            factors[at, p + 2] += s2
            factors[at, p + 3] += s3
            for j in range(width):
                first = s0 * basis[p, j] + s1 * basis[p + 1, j]
                rows[row, j] -= first + (s2 * basis[p + 2, j] + s3 * basis[p + 3, j])
        for p in range(4 * (count // 4), count):
            share = _product(basis, p, rows, row, width)
            factors[at, p] += share
            for j in range(width):
                rows[row, j] -= share * basis[p, j]
        left = _product(rows, row, rows, row, width)
        if left > AGAIN * before:
            break
        before = left
    if left > RANK * RANK * whole:
        inverse = 1.0 / math.sqrt(left)
        for j in range(width):
            rows[row, j] *= inverse
    return math.sqrt(whole), math.sqrt(left)


@inlined
def _plain_inverse(
    basis: Basis, start: int, end: int, first: int, last: int, damping: float
) -> bool:
    """Rows of M_i = (R_i R_iᵀ + d²I)⁻¹ R_i = T⁻ᵀ P (QR); False where rows are dependent.

    The rows of the task are those from `start` to `end`, and what it adds to the basis are the
    columns from `first` to `last`.
    """
    R, M, T, P = basis.R, basis.M, basis.T, basis.P
    n, d = R.shape[0], end - start
    triangular = damping == 0.0 and first == 0 and last == d  # T = R_i
    width = 2 * n if damping > 0.0 else last
    for a in range(d):
        for p in range(width):
            P[a, p] = R[start + a, p] if p < last else 0.0
        for b in range(d):
            T[a, b] = P[a, b] if triangular else 0.0
        if triangular:
            for p in range(width):
                P[a, p] = 1.0 if p == a else 0.0
            continue
        if damping > 0.0:
            P[a, n + a] = damping
        whole, left = _reduce(P, a, width, P, a, T, a)
        if not left > RANK * whole:
            return False
        T[a, a] = left
    for q in range(d):  # Tᵀ M_i = P from its last row on
        a = d - 1 - q
        inverse = 1.0 / T[a, a]
        for p in range(first, last):
            entry = P[a, p]
            for b in range(a + 1, d):
                entry -= T[b, a] * M[start + b, p]
            M[start + a, p] = entry * inverse
    return True


@kernel()
def _deficient_inverse(R: Matrix, A: Matrix, first: int, last: int, target: Matrix) -> None:
    """The same where rows are dependent, from its singular values: R⁺ = Aᵀ diag(|A_k|⁻⁴) A Rᵀ.

    R: the task's rows; A: (rows or more, ·), its orthogonal ones with AᵀA = RᵀR, written.
    """
    d, longest = R.shape[0], 0.0
    for a in range(d):
        for p in range(A.shape[1]):
            A[a, p] = R[a, p] if p < last else 0.0
    orthogonalise(A, d)
    for a in range(d):
        longest = max(longest, dot(A[a], A[a]))
        for p in range(first, last):
            target[a, p] = 0.0
    for k in range(d):
        square = dot(A[k], A[k])
        if square > RANK * RANK * longest:
            for a in range(d):
                share = dot(A[k, :last], R[a, :last]) / (square * square)
                add(target[a, first:last], share, A[k, first:last])


@inlined
def _close_loop(offsets: Indices, weights: Vector, basis: Basis, L: Matrix) -> None:
    """L = D J B D⁻¹ = D R Mᵀ D⁻¹, lower block triangular."""
    R, M, lengths = basis.R, basis.M, basis.lengths
    n = R.shape[0]
    for a in range(n):
        lengths[a] = math.sqrt(_product(R, a, R, a, n))
    for task in range(offsets.size - 1):
        for i in range(offsets[task], offsets[task + 1]):
            size = ROUNDING * math.sqrt(_product(M, i, M, i, n))
            for a in range(offsets[task]):
                L[a, i] = 0.0
            for a in range(offsets[task], n):
                entry = _product(R, a, M, i, n)
                kept = abs(entry) > size * lengths[a]
                L[a, i] = entry * weights[a] / weights[i] if kept else 0.0


@kernel()
def prioritised(
    jacobian: Matrix,
    offsets: Indices,
    damping: float,
    weights: Vector,
    L: Matrix,
    B: Matrix,
    basis: Basis,
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
        basis: overwritten.

    Returns:
        The rank of the stacked Jacobian.
    """
    Q, R, M = basis.Q, basis.R, basis.M
    (n, joints), rank = jacobian.shape, 0
    for task in range(offsets.size - 1):
        start, end, first = offsets[task], offsets[task + 1], rank
        for i in range(start, end):  # J_i = R_i Q (Gram–Schmidt)
            for p in range(n):
                R[i, p], M[i, p] = 0.0, 0.0
            if rank == joints:
                for p in range(rank):
                    R[i, p] = _product(Q, p, jacobian, i, joints)
                continue
            for j in range(joints):
                Q[rank, j] = jacobian[i, j]
            whole, left = _reduce(Q, rank, joints, Q, rank, R, i)
            if left > RANK * whole:
                R[i, rank] = left
                rank += 1
        if not _plain_inverse(basis, start, end, first, rank, damping):
            _deficient_inverse(R[start:end], basis.P, first, rank, M[start:end])
        for i in range(start, end):  # Bᵀ = M Q, (7)
            for j in range(joints):
                B[i, j] = 0.0
            for p in range(first, rank):
                for j in range(joints):
                    B[i, j] += M[i, p] * Q[p, j]
    _close_loop(offsets, weights, basis, L)
    return rank


@inlined
def unfit(jacobian: Matrix, errors: Vector, rates: Vector, weights: Vector, limits: Matrix) -> bool:
    """Whether a value is not finite, or the limits do not allow to stand still."""
    n, joints = jacobian.shape
    found = not_finite(errors) or not_finite(rates) or not_finite(weights)
    for i in range(n):
        wrong = 0 if weights[i] > 0.0 else 1
        for j in range(joints):
            wrong += 0 if abs(jacobian[i, j]) <= MAX else 1
        found = found or wrong > 0
    for r in range(joints):
        found = found or not (limits[0, r] <= 0.0 <= limits[1, r])
    return found


@inlined
def moves(rates: Vector) -> bool:
    """Whether a target moves."""
    found = False
    for i in range(rates.size):
        found = found or rates[i] != 0.0
    return found


@kernel()
def solve_loop(
    L: Matrix, offsets: Indices, weights: Vector, rates: Vector, U: Matrix, out: Vector
) -> bool:
    """Write x with (D⁻¹ L D) x = rates, by Gauss's elimination; False where L is singular.

    Without a choice of pivots: where gains have a certificate, LΛ + ΛLᵀ is positive definite, and
    so none is 0. Row k of L ends with the block of its task, and so does what is eliminated by it.

    Args:
        L, offsets, weights: what `prioritised` gave; weights is D.
        rates: (n,).
        U: scratch, (n, n).
        out: x, written, (n,).
    """
    n = rates.size
    for i in range(n):
        out[i] = weights[i] * rates[i]
        for j in range(n):
            U[i, j] = L[i, j]
    for task in range(offsets.size - 1):
        end = offsets[task + 1]
        for k in range(offsets[task], end):
            if not abs(U[k, k]) > SINGULAR:
                return False
            for i in range(k + 1, n):
                factor = U[i, k] / U[k, k]
                if factor != 0.0:
                    out[i] -= factor * out[k]
                    for j in range(k + 1, end):
                        U[i, j] -= factor * U[k, j]
    for task in range(offsets.size - 1):
        start, end = offsets[task], offsets[task + 1]
        for k in range(end - 1, start - 1, -1):
            for j in range(k + 1, end):
                out[k] -= U[k, j] * out[j]
            out[k] /= U[k, k]
    for i in range(n):
        out[i] /= weights[i]
    return True


@inlined
def feed_forward(
    B: Matrix, rates: Vector, through: Vector, regular: bool, limits: Matrix, fed: Vector
) -> float:
    """Write B L⁻¹ σ̇*, which leaves ė = −L Λ e, or where limits are in the way, what leads to B σ̇*.

    The errors move by ė = σ̇* − L(Λ e + x) where dq = B(Λ e + x): L x = σ̇* takes the targets'
    motion out of them all, x = σ̇* only out of those of the first task. What is between both moves
    the lower tasks alone. Where limits are in the way of all of it, it is left as fast as they
    allow, which the first task does not feel, until they allow all of it within one period.

    Args:
        B: Bᵀ, (n, joints).
        rates, through, regular: σ̇* and L⁻¹ σ̇*, (n,), and whether there is one: of `solve_loop`.
        limits: of the speeds, (2, joints) or more.
        fed: written, (joints,).

    Returns:
        How much of what is between both is fed: 1 where all of it is, or L⁻¹ is not asked for.
    """
    n, least, most = rates.size, 0.0, 1.0
    for r in range(fed.size):
        fed[r] = 0.0
    add_rows(fed, rates, B, 0, n, 0)
    if not regular:
        return 1.0
    for r in range(fed.size):
        way = 0.0
        for i in range(n):
            way += (through[i] - rates[i]) * B[i, r]
        if way != 0.0:
            one, other = (limits[0, r] - fed[r]) / way, (limits[1, r] - fed[r]) / way
            least, most = max(least, min(one, other)), min(most, max(one, other))
    share = 0.0 if least > most else 1.0 if most == 1.0 else least
    for i in range(n):
        add(fed, share * (through[i] - rates[i]), B[i])
    return share
