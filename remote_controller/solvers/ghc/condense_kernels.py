"""The tasks of a hierarchy, condensed to the n joint accelerations.

Liu, Tan and Padois, Autonomous Robots 2015, (13d) and the first sum of (13a): of

    min Σ |J_i x_i − b_i|² + w Σ |x_i|²   such that   Σ P_i x_i = q̈

is left, with H_i = J_iᵀJ_i + wI,

    ½ (q̈ − q₀)ᵀ S⁺ (q̈ − q₀),   S = Σ P_i H_i⁻¹ P_i,   q₀ = Σ P_i J_iᵀ (J_i J_iᵀ + wI)⁻¹ b_i.
"""

from __future__ import annotations

import math

from hoap3.protocol.runtime.numba_jit import IndexRows, Indices, Matrix, Vector, inlined, kernel
from hoap3.remote_controller.solvers.ghc.projector_kernels import (
    exact_basis,
    smooth_basis,
    sort_tasks,
)
from hoap3.remote_controller.solvers.linalg.dense_kernels import add, add_rows, dot
from hoap3.remote_controller.solvers.linalg.tiled_product_kernels import factorise, syrk


@inlined
def _is_identity(jacobian: Matrix) -> bool:
    """Whether a task's rows are those of I."""
    m, n = jacobian.shape
    if m != n:
        return False
    for i in range(n):
        others = 0
        for j in range(n):
            others += 1 if jacobian[i, j] != 0.0 else 0
        if others != 1 or jacobian[i, i] != 1.0:
            return False
    return True


@kernel(superwords=True)
def _project_task(
    jacobian: Matrix,
    target: Vector,
    w: float,
    rank: int,
    c: float,
    B: Matrix,
    D: Vector,
    X: Matrix,
    C: Matrix,
    scratch: Vector,
    q0: Vector,
) -> None:
    """Add P Jᵀ(JJᵀ + wI)⁻¹ b to q₀ and write rows X with P H⁻¹ P = P²/w − XᵀX.

    P = cI − Bᵀ diag(D) B; C is scratch, at least (m, m + 1).
    """
    m, n = jacobian.shape
    for a in range(m):
        for b in range(a, m):
            C[a, b] = dot(jacobian[a], jacobian[b])
        C[a, a] += w
        C[a, m] = target[a]
    factorise(C, m, 0.0, scratch)
    root = math.sqrt(w)
    for a in range(m):
        row = X[a]
        for i in range(n):
            row[i] = c * jacobian[a, i]
        for p in range(rank):
            scratch[p] = -D[p] * dot(B[p], jacobian[a])
        add_rows(row, scratch, B, 0, rank, 0)
        for before in range(a):
            add(row, -root * C[before, a], X[before])
            C[a, m] -= C[before, a] * C[before, m]
        inverse = 1.0 / C[a, a]
        C[a, m] *= inverse
        inverse /= root
        for i in range(n):
            row[i] *= inverse
        add(q0, root * C[a, m], row)


@inlined
def _flush(first: int, last: int, B: Matrix, F: Vector, X: Matrix, used: int) -> int:
    """Write the rows √F[p]·B[p] behind the used ones of X, and clear F; returns how many are."""
    for p in range(first, last):
        if F[p] > 0.0:
            root = math.sqrt(F[p])
            for j in range(B.shape[1]):
                X[used, j] = root * B[p, j]
            used += 1
        F[p] = 0.0
    return used


@inlined
def _shared(order: Indices, count: int, closes: Indices, chain: Indices, chained: int) -> int:
    """How many tasks at the beginning of the order are those of the chain, and do not close it."""
    common = 0
    while common < min(count, chained):
        if order[common] != chain[common] or closes[order[common]]:
            break
        common += 1
    return common


@inlined
def _chain(order: Indices, count: int, closes: Indices, chain: Indices) -> int:
    """Write the tasks of the order before one that closes it; returns how many."""
    chained = 0
    while chained < count and not closes[order[chained]]:
        chain[chained] = order[chained]
        chained += 1
    return chained


@inlined
def _look(jacobian: Matrix, offsets: Indices, alpha: Matrix, closes: Indices, rise: Vector) -> None:
    """Write which tasks close a basis, and the sum of each task's priorities over all."""
    tasks = offsets.size - 1
    for i in range(tasks):
        closes[i] = 1 if _is_identity(jacobian[offsets[i] : offsets[i + 1]]) else 0
        rise[i] = 0.0
        for j in range(tasks):
            rise[i] += alpha[j, i]


@kernel(superwords=True)
def condense(
    jacobian: Matrix,
    offsets: Indices,
    target: Vector,
    alpha: Matrix,
    w: float,
    smoothing: float,
    S: Matrix,
    q0: Vector,
    X: Matrix,
    B: Matrix,
    diagonals: Matrix,
    K: Matrix,
    scratch: Vector,
    integers: IndexRows,
) -> float:
    """Write the upper triangle of S, and q₀; returns what S is a difference from, times I.

    Tasks whose upper ones are the same in the same order have those rows of the basis in common:
    in a hierarchy of strict levels every row is orthonormalised, and enters S, once.

    Args:
        jacobian, offsets, target: of all tasks, (m, n), (k + 1,), (m,).
        alpha: (k, k): α_ij is the priority of task j over task i.
        w: ω_r.
        smoothing: s₀, or 0.
        S, q0: (n, n) and (n,).
        X: scratch, (m·k + m, n).
        B: scratch, (2m + 1, n).
        diagonals: scratch, (3, m + 1).
        K: scratch, (2m, m + 1).
        scratch: at least as long as X has rows.
        integers: scratch, (5, max(m, k + 1)).
    """
    (m, n), tasks = jacobian.shape, offsets.size - 1
    D, F, rise = diagonals[0], diagonals[1], diagonals[2]
    closes, order, rows = integers[0], integers[1], integers[2]
    chain, ranks = integers[3], integers[4]
    whole, used, chained, ranks[0] = 0.0, 0, 0, 0
    q0[:] = 0.0
    F[:] = 0.0
    _look(jacobian, offsets, alpha, closes, rise)
    for i in range(tasks):
        count = sort_tasks(alpha[i], closes, rise, order)
        if smoothing > 0.0:
            rank, c = smooth_basis(
                jacobian,
                offsets,
                closes,
                alpha[i],
                smoothing,
                order,
                count,
                rows,
                B,
                D,
                K[:m],
                K[m:],
            )
        else:
            common = _shared(order, count, closes, chain, chained)
            if common < count and not closes[order[common]]:
                used = _flush(ranks[common], ranks[chained], B, F, X, used)
                chained = _chain(order, count, closes, chain)
            rank, c = exact_basis(
                jacobian, offsets, closes, alpha[i], order, count, common, B, D, ranks
            )
        first, last = offsets[i], offsets[i + 1]
        inverse = 1.0 / (1.0 + w) if closes[i] else 1.0 / w
        whole += inverse * c * c
        for p in range(rank):
            F[p] += inverse * D[p] * (2.0 * c - D[p])
        if closes[i]:
            own = target[first:last]
            add(q0, c * inverse, own)
            for p in range(rank):
                add(q0, -D[p] * inverse * dot(B[p], own), B[p])
        else:
            _project_task(
                jacobian[first:last], target[first:last], w, rank, c, B, D, X[used:], K, scratch, q0
            )
            used += last - first
        if smoothing > 0.0:
            used = _flush(0, rank, B, F, X, used)
    used = _flush(0, m, B, F, X, used)
    for i in range(n):
        for j in range(i, n):
            S[i, j] = whole if i == j else 0.0
    syrk(S, -1.0, X, used)
    return whole
