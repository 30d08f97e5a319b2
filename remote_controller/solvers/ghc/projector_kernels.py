"""The generalized projector in its order-free closed form, compiled.

Liu, Tan and Padois, Autonomous Robots 2015, (11). With the distinct positive priorities
a_1 > … > a_L of the rows, a_{L+1} = 0, and N_l the projector onto the null space of all rows with
priority ≥ a_l,

    P = (1 − a_1) I + Σ_l (a_l − a_{l+1}) N_l  =  c I − Bᵀ diag(D) B

with B an orthonormal basis of the rows, in descending priority, and D their priorities: (11) is
I − Σ_l a_l (N_{l−1} − N_l), N_0 = I, summed by parts, and N_{l−1} − N_l = Σ B_pᵀB_p over the rows
of B that level l adds. Rows of priority 0 do not matter and are left out. A task of priority a
whose Jacobian is I leaves no null space, N_l = 0 from that level on: the sum ends before it, with
a as the last a_{l+1}, so that c = 1 − a, and D counts from a.

A row counts as dependent where what is left of it is 1e-9 of the row. The paper takes the smallest
positive number there, with which rounding errors become directions. A direction that is only a
share s of its row is exact to 1e-16/s, and so is what it leaves of a row that depends on it: for
s < 1e-7 that exceeds 1e-9. Rows of a task of which a larger share is left therefore come first.

**Smoothed** (not in the paper): P jumps where the rank of the rows changes. Instead of N_l the
smoothed form uses, with J_l all rows of priority ≥ a_l,

    N_l = I − J_lᵀ g(J_l J_lᵀ) J_l,   g(σ²) = φ(σ/s₀)/σ²,   φ(t) = 3t² − 2t³ up to 1, then 1

which is the exact one where all singular values σ of J_l are s₀ or more. It depends on which rows
have which priority, and on nothing else, so P is continuous in J, and in the priorities wherever
they meet: a level that splits in two, a_l and a_l − ε, adds one N_l, whose weight is only ε. In
place of s₀ stands max(s₀, 1e-5 |J_l|_F), below which σ is rounding. The price is that below s₀ no
row is quite strict: |J_l N_l x| ≤ max t(1 − φ(t))·s₀|x| = 0.26 s₀|x|, and so for P and any strict
row.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from hoap3.protocol.runtime.numba_jit import Indices, Matrix, Vector, inlined, kernel
from hoap3.remote_controller.solvers.base.status import BAD_INPUT, OK
from hoap3.remote_controller.solvers.linalg.dense_kernels import (
    MAX,
    add,
    add_rows,
    dot,
    eigenvectors,
    not_finite,
    orthogonalise,
)

DEPENDENT = 1e-9  # of a row: less than that of it left is rounding
SHARES = (1e-3, 1e-6, DEPENDENT)  # of a row, left of it: the pass that accepts it
SURE = 0.5  # of a row: with as much left, one orthogonalisation is enough
HUGE, SMALL = 1e100, 1e-100  # rows beyond are scaled before they are squared
DROPPED = 1e-20  # of a projector's eigenvalue
LEAST_WIDTH = 1e-5  # of |J_l|_F: the least s₀ that is used, below it σ is rounding


class Above(NamedTuple):
    """What a task i is kept out of, (11).

    Attributes:
        jacobian: J, the rows of all tasks, (m, n).
        offsets: where the rows of each task begin, and m: (k + 1,).
        closes: 1 for a task whose Jacobian is I, else 0; (k,).
        alpha: α_i1 … α_ik, priorities of the tasks over i, (k,).
        order: of `sort_tasks`, (k,) or longer.
    """

    jacobian: Matrix
    offsets: Indices
    closes: Indices
    alpha: Vector
    order: Indices


class Basis(NamedTuple):
    """B and D of P = cI − Bᵀ diag(D) B.

    Attributes:
        B: orthonormal rows, (m + 1, n); (2m, n) for the smoothed one.
        D: (m,) or longer; scratch until it is written.
        ranks: ranks[t] is how many rows of B the first t tasks of the order have, (k + 1,) or
            longer; ranks[0] = 0. Not of the smoothed one.
        rows: scratch, (m,) or longer. Not of the smoothed one.
    """

    B: Matrix
    D: Vector
    ranks: Indices
    rows: Indices


class Spectrum(NamedTuple):
    """J_l J_lᵀ = Qᵀ diag(σ²) Q of a level; all scratch.

    Attributes:
        rows: which rows of J the levels have, (m,) or longer.
        K: J_l J_lᵀ, then diag(σ²), (m, m) or larger.
        Q: rows are its eigenvectors, likewise.
    """

    rows: Indices
    K: Matrix
    Q: Matrix


@inlined
def _extend(row: Vector, B: Matrix, rank: int, least: float, along: Vector) -> float:
    """Write what of a row is orthogonal to the first `rank` rows of B behind them.

    All projections at once, and once more where little is left (classical Gram and Schmidt twice).
    Returns its share of the row, 0 of a row of zeros; it is normalised where that exceeds `least`.
    """
    n, fresh, top = row.size, B[rank], 0.0
    for i in range(n):
        fresh[i] = row[i]
        top = max(top, abs(row[i]))
    if top == 0.0:
        return 0.0
    if not SMALL < top < HUGE:
        for i in range(n):
            fresh[i] /= top
    whole = dot(fresh, fresh)
    left = whole
    for _ in range(2):
        for p in range(rank):
            along[p] = -dot(fresh, B[p])
        add_rows(fresh, along, B, 0, rank, 0)
        left = dot(fresh, fresh)
        if rank == 0 or left > SURE * SURE * whole:
            break
    share = math.sqrt(left / whole)
    if share > least:
        inverse = 1.0 / math.sqrt(left)
        for i in range(n):
            fresh[i] *= inverse
    return share


@inlined
def _extend_by_task(jacobian: Matrix, first: int, last: int, rank: int, basis: Basis) -> int:
    """Orthonormalise rows first ≤ row < last of a task behind the first `rank` rows of B.

    Every pass accepts the rows of which more than its share is left, so that no direction is much
    less exact than what decides on the next row. Returns how many rows B has then.
    """
    B, along, rows = basis.B, basis.D, basis.rows
    count, n = last - first, jacobian.shape[1]
    for i in range(count):
        rows[i] = first + i
    for least in SHARES:
        waiting = 0
        for i in range(count):
            if rank == n:
                return rank
            share = _extend(jacobian[rows[i]], B, rank, least, along)
            if share > least:
                rank += 1
            elif share > DEPENDENT:  # only less can be left of it later
                rows[waiting] = rows[i]
                waiting += 1
        count = waiting
    return rank


@inlined
def sort_tasks(alpha: Vector, closes: Indices, rise: Vector, order: Indices) -> int:
    """Write the tasks of positive priority in descending order; returns how many there are.

    Where priorities are equal, a task whose Jacobian is I comes first and then those of larger
    `rise`, Σ_j α_ji of task i: P is the same, but hierarchies have bases in common then.
    """
    count = 0
    for j in range(alpha.size):
        if alpha[j] <= 0.0:
            continue
        p = count
        while p > 0:
            i = order[p - 1]
            if alpha[i] > alpha[j]:
                break
            if alpha[i] == alpha[j]:
                first = closes[i] > closes[j] or (closes[i] == closes[j] and rise[i] >= rise[j])
                if first:
                    break
            order[p] = i
            p -= 1
        order[p] = j
        count += 1
    return count


@kernel(superwords=True)
def exact_basis(above: Above, count: int, common: int, basis: Basis) -> tuple[int, float]:
    """Write B and D of P = cI − Bᵀ diag(D) B; returns how many rows B has, and c.

    Args:
        above: the tasks; so many of their order as `count` says are above.
        count: of `sort_tasks`.
        common: so many tasks at the beginning of the order have their rows in B already.
        basis: written.
    """
    jacobian, offsets, closes, alpha, order = above
    D, ranks = basis.D, basis.ranks  # D is scratch until it is written
    base, rank = 0.0, ranks[common]
    for t in range(count):
        j = order[t]
        if closes[j]:
            base = alpha[j]
            break
        if t >= common:
            rank = _extend_by_task(jacobian, offsets[j], offsets[j + 1], rank, basis)
            ranks[t + 1] = rank
    for t in range(count):
        j = order[t]
        if closes[j]:
            break
        for p in range(ranks[t], ranks[t + 1]):
            D[p] = alpha[j] - base
    return rank, 1.0 - base


@inlined
def _fade(
    jacobian: Matrix, count: int, share: float, width: float, B: Matrix, spectrum: Spectrum
) -> None:
    """Write the rows √(share·g(σ²))·qᵀJ_l into B, q the eigenvectors of J_l J_lᵀ.

    g = φ/σ² = (3 − 2t)/s₀² for t = σ/s₀ < 1, else 1/σ²; s₀ is `narrow`, `width` or more.
    """
    rows, K, Q = spectrum.rows[:count], spectrum.K, spectrum.Q
    m, n, whole = rows.size, jacobian.shape[1], 0.0
    for a in range(m):
        for b in range(a, m):
            K[a, b] = dot(jacobian[rows[a]], jacobian[rows[b]])
            K[b, a] = K[a, b]
        whole += K[a, a]
    eigenvectors(K, Q, m)
    narrow = max(width, SMALL, LEAST_WIDTH * math.sqrt(whole))
    for e in range(m):
        squared = max(K[e, e], 0.0)
        t = math.sqrt(squared) / narrow
        root = math.sqrt(3.0 - 2.0 * t) / narrow if t < 1.0 else 1.0 / math.sqrt(squared)
        for i in range(n):
            B[e, i] = 0.0
        for a in range(m):
            add(B[e], math.sqrt(share) * root * Q[e, a], jacobian[rows[a]])


@inlined
def _compress(B: Matrix, count: int, most: int) -> int:
    """Make the first rows of B orthogonal (one-sided Jacobi), with the same BᵀB.

    Returns how many are left, at most `most`; BᵀB has the eigenvalues |row|², which become D.
    """
    orthogonalise(B, count)
    kept = 0
    for p in range(count):
        if dot(B[p], B[p]) > DROPPED and kept < most:
            for i in range(B.shape[1]):
                B[kept, i] = B[p, i]
            kept += 1
    return kept


@kernel(superwords=True)
def smooth_basis(
    above: Above, count: int, width: float, basis: Basis, spectrum: Spectrum
) -> tuple[int, float]:
    """As `exact_basis`, smoothed: P = cI − Σ_l (a_l − a_{l+1}) J_lᵀ g(J_l J_lᵀ) J_l.

    With J_l J_lᵀ = Qᵀ diag(σ²) Q term l is BᵀB of the rows √((a_l − a_{l+1}) g(σ²))·qᵀJ_l, q the
    rows of Q (`_fade`). Under those of the levels before they are made orthogonal (`_compress`); at
    the end D = |row|², and the rows get length 1.

    Args:
        above, count: as there.
        width: s₀ > 0, in the units of the Jacobian; 1e-5 |J_l|_F is used where that is more.
        basis: written.
        spectrum: scratch.
    """
    jacobian, offsets, closes, alpha, order = above
    B, D, rows = basis.B, basis.D, spectrum.rows
    m, base = 0, 0.0
    for t in range(count):
        j = order[t]
        if closes[j]:
            base = alpha[j]
            break
        for row in range(offsets[j], offsets[j + 1]):
            rows[m], D[m] = row, alpha[j]
            m += 1
    rank, end = 0, 0
    while end < m:
        level = D[end]
        while end < m and D[end] == level:
            end += 1
        below = D[end] if end < m else base
        _fade(jacobian, end, level - below, width, B[rank:], spectrum)
        rank = _compress(B, rank + end, end)
    for p in range(rank):
        D[p] = dot(B[p], B[p])
        inverse = 1.0 / math.sqrt(D[p])
        for i in range(B.shape[1]):
            B[p, i] *= inverse
    return rank, 1.0 - base


@kernel(allocates=True)
def projector_kernel(alpha: Vector, jacobian: Matrix, width: float, out: Matrix) -> int:
    """Write P for priorities of the single rows; the status is `OK` or `BAD_INPUT`.

    Args:
        alpha: priorities, (m,).
        jacobian: (m, n).
        width: s₀, as in `smooth_basis`; 0 for the exact projector.
        out: P, (n, n); untouched on bad input.
    """
    m, n = jacobian.shape
    for j in range(m):
        if not_finite(jacobian[j]) or not 0.0 <= alpha[j] <= 1.0:
            return BAD_INPUT
    if not 0.0 <= width <= MAX:
        return BAD_INPUT
    offsets, closes = np.arange(m + 1), np.zeros(m, np.int64)
    order, rows = np.empty(m, np.int64), np.empty(m, np.int64)
    B, D, ranks = np.empty((2 * m + 1, n)), np.empty(m), np.zeros(m + 1, np.int64)
    count = sort_tasks(alpha, closes, np.zeros(m), order)
    above, basis = Above(jacobian, offsets, closes, alpha, order), Basis(B, D, ranks, rows)
    if width > 0.0:
        spectrum = Spectrum(rows, np.empty((m, m)), np.empty((m, m)))
        rank, c = smooth_basis(above, count, width, basis, spectrum)
    else:
        rank, c = exact_basis(above, count, 0, basis)
    for i in range(n):
        for j in range(n):
            out[i, j] = c if i == j else 0.0
    for p in range(rank):
        for i in range(n):
            add(out[i], -D[p] * B[p, i], B[p])
    for i in range(n):
        for j in range(i):
            out[i, j] = out[j, i]
    return OK
