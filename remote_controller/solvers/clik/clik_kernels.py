"""Closed-loop inverse kinematics of prioritised tasks, as matrices.

Marti-Saumell et al., (7): for tasks J_1 … J_h in the order of their priorities and errors
e = σ* − σ (6a),

    dq = B Λ e,   B = [J_1⁺ | N_1 J_2⁺ | … | N_{h−1} J_h⁺],   Λ diagonal,

where N_i projects onto what the first i tasks leave free. With L₀ = [J_1; …; J_h] B, block lower
triangular, the errors follow ė = −L₀ Λ e: A = −L₀ Λ in (13) and (14). For V = ½|D e|², D
diagonal, the weighted errors D e follow the same law with L = D L₀ D⁻¹: D and Λ commute.

All is computed in an orthonormal basis Q of the rows, J = R Q. Task i adds Q_i to the basis, and of
all rows of Q, N_{i−1} Qᵀ keeps those and drops the ones before, in J_i⁺ = J_iᵀ(J_i J_iᵀ)⁻¹ =
Qᵀ R_iᵀ(R_i R_iᵀ)⁻¹. So N_{i−1} J_i⁺ = Q_iᵀ M_iᵀ with M_i = (R_i R_iᵀ)⁻¹ R_i on the columns of Q_i,
L₀ = R Mᵀ, and no projector is ever formed.
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
        R: (n, n), J = R Q; each row is 0 behind the columns that its task adds to the basis.
        M: (n, n), Bᵀ = M Q; each row is 0 outside the columns that its task adds.
        T: (n, n), lower triangular, [R_i | d I] = T P and so R_i R_iᵀ + d²I = T Tᵀ, of task i.
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
    where more than rounding is left, and adds what it took to row `at` of the factors. Returns
    the lengths before and after.
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

    With [R_i | d I] = T P it is (T Tᵀ)⁻¹ T P, of which the columns of R_i count. d is `damping`.
    The rows of the task are those from `start` to `end`, and what it adds to the basis are the
    columns from `first` to `last`.
    """
    R, M, T, P = basis.R, basis.M, basis.T, basis.P
    n, size = R.shape[0], end - start
    triangular = damping == 0.0 and first == 0 and last == size  # T = R_i
    width = 2 * n if damping > 0.0 else last
    for a in range(size):
        for p in range(width):
            P[a, p] = R[start + a, p] if p < last else 0.0
        for b in range(size):
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
    for q in range(size):  # Tᵀ M_i = P from its last row on
        a = size - 1 - q
        inverse = 1.0 / T[a, a]
        for p in range(first, last):
            entry = P[a, p]
            for b in range(a + 1, size):
                entry -= T[b, a] * M[start + b, p]
            M[start + a, p] = entry * inverse
    return True


@kernel()
def _deficient_inverse(R: Matrix, A: Matrix, first: int, last: int, target: Matrix) -> None:
    """The same where rows are dependent, from its singular values: R⁺ = Aᵀ diag(|A_k|⁻⁴) A Rᵀ.

    With R = U Σ Vᵀ, A = Σ Vᵀ has |A_k| = σ_k, and R⁺ = V Σ⁻² Vᵀ Rᵀ = Aᵀ Σ⁻⁴ A Rᵀ; singular values
    up to `RANK` of the largest count as 0. A damping that is too small to part the rows is dropped.

    R: the task's rows; A: (rows or more, ·), its orthogonal ones with AᵀA = RᵀR, written.
    """
    count, longest = R.shape[0], 0.0
    for a in range(count):
        for p in range(A.shape[1]):
            A[a, p] = R[a, p] if p < last else 0.0
    orthogonalise(A, count)
    for a in range(count):
        longest = max(longest, dot(A[a], A[a]))
        for p in range(first, last):
            target[a, p] = 0.0
    for k in range(count):
        square = dot(A[k], A[k])
        if square > RANK * RANK * longest:
            for a in range(count):
                share = dot(A[k, :last], R[a, :last]) / (square * square)
                add(target[a, first:last], share, A[k, first:last])


@inlined
def _close_loop(offsets: Indices, weights: Vector, basis: Basis, L: Matrix) -> None:
    """L = D L₀ D⁻¹ = D J B D⁻¹ = D R Mᵀ D⁻¹, lower block triangular; weights: D."""
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
    Bt: Matrix,
    basis: Basis,
) -> int:
    """Write L and Bᵀ.

    Args:
        jacobian: all tasks' rows, (n, joints).
        offsets: where each task begins, and n; (h + 1,).
        damping: d: J_iᵀ(J_i J_iᵀ + d²I)⁻¹ stands for J_i⁺; 0 for the pseudoinverse. L is that of
            the law with the damping, so that what is proved of L holds.
        weights: square roots D of the weights of the errors, (n,): L = D J B D⁻¹.
        L: (n, n), written. Entries that are rounding are 0.
        Bt: Bᵀ, (n, joints), written.
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
                Bt[i, j] = 0.0
            for p in range(first, rank):
                for j in range(joints):
                    Bt[i, j] += M[i, p] * Q[p, j]
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
    """Write x = L₀⁻¹ rates, L₀ = D⁻¹ L D, by Gauss's elimination; False where L is singular.

    Without a choice of pivots: if any Λ has β > 0, LΛ + ΛLᵀ is positive definite, and with it that
    of each leading block of L, which therefore is regular: no pivot is 0. Row k of the eliminated U
    ends with the block of its task, as that of L does: so from its last row back each block is
    solved alone. The reference is `pivots` of
    `constant_gains_reference`, and numpy's own elimination.

    Args:
        L, offsets, weights: what `prioritised` gave; weights is D.
        rates: (n,).
        U: scratch, (n, n): L as it is eliminated.
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
    Bt: Matrix, rates: Vector, through: Vector, regular: bool, limits: Matrix, fed: Vector
) -> float:
    """Write B x for targets that move: B L₀⁻¹ σ̇* if limits let it, else B σ̇* and s of the rest.

    It is not in the paper, whose (7) has no σ̇*. By (6a) ė = σ̇* − J dq, so ė = σ̇* − L₀(Λ e + x)
    where dq = B(Λ e + x). x = L₀⁻¹ σ̇* leaves ė = −L₀ Λ e: it takes the targets' motion out of all
    errors. x = σ̇* takes it only out of those of the first task, whose block of L₀ is I where its
    rows are independent; what is between both moves the lower tasks alone. So

        x = σ̇* + s (L₀⁻¹ σ̇* − σ̇*)

    with s = 1 if that keeps the limits, else the smallest s in [0, 1] that does, which is 0 unless
    B σ̇* itself is outside, and 0 if none does. Joints that s does not move are not asked.
    `constant_gains_reference` has it in plain numpy.

    Args:
        Bt: Bᵀ, (n, joints).
        rates, through: σ̇* and L₀⁻¹ σ̇*, (n,).
        regular: whether the latter is there, see `solve_loop`; False with damping, too.
        limits: of the speeds in this period, (2, joints) or more.
        fed: written, (joints,).

    Returns:
        s; 1 where it is not `regular`, and B σ̇* is fed.
    """
    n, least, most = rates.size, 0.0, 1.0
    for r in range(fed.size):
        fed[r] = 0.0
    add_rows(fed, rates, Bt, 0, n, 0)
    if not regular:
        return 1.0
    for r in range(fed.size):
        way = 0.0
        for i in range(n):
            way += (through[i] - rates[i]) * Bt[i, r]
        if way != 0.0:
            one, other = (limits[0, r] - fed[r]) / way, (limits[1, r] - fed[r]) / way
            least, most = max(least, min(one, other)), min(most, max(one, other))
    share = 0.0 if least > most else 1.0 if most == 1.0 else least
    for i in range(n):
        add(fed, share * (through[i] - rates[i]), Bt[i])
    return share
