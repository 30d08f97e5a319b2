"""The tasks of a hierarchy, condensed to the n joint accelerations.

Liu, Tan and Padois, Autonomous Robots 2015, (13d), and of (13a) the tasks and the half of the
regularisation that weighs q̈′: with x_i = q̈′_i, P_i of (11) and w = ω_r, half of

    min Σ |J_i x_i − b_i|² + w Σ |x_i|²   such that   Σ P_i x_i = q̈

leaves, but for a constant, with H_i = J_iᵀJ_i + wI and H_i⁻¹J_iᵀ = J_iᵀ (J_i J_iᵀ + wI)⁻¹,

    ½ (q̈ − q₀)ᵀ S⁺ (q̈ − q₀),   S = Σ P_i H_i⁻¹ P_i,   q₀ = Σ P_i J_iᵀ (J_i J_iᵀ + wI)⁻¹ b_i,

for q̈ − q₀ in the range of S, and others cannot be reached: with multipliers μ of the equation
x_i = H_i⁻¹ (J_iᵀb_i + P_i μ), and so S μ = q̈ − q₀.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from hoap3.protocol.runtime.numba_jit import Indices, Matrix, Vector, inlined, kernel
from hoap3.remote_controller.solvers.ghc.projector_kernels import (
    Above,
    Basis,
    Spectrum,
    exact_basis,
    smooth_basis,
    sort_tasks,
)
from hoap3.remote_controller.solvers.linalg.dense_kernels import add, add_rows, dot
from hoap3.remote_controller.solvers.linalg.tiled_product_kernels import factorise, syrk


class Tasks(NamedTuple):
    """What the tasks ask for, (13a).

    Attributes:
        jacobian: J, the rows of all tasks, (m, n).
        offsets: where the rows of each task begin, and m: (k + 1,).
        target: b, desired accelerations less drift, (m,).
        alpha: α, (k, k): α_ij is the priority of task j over task i.
    """

    jacobian: Matrix
    offsets: Indices
    target: Vector
    alpha: Matrix


class Condensed(NamedTuple):
    """½ (q̈ − q₀)ᵀ S⁺ (q̈ − q₀); written.

    Attributes:
        S: Σ P_i H_i⁻¹ P_i, (n, n), its upper triangle.
        q0: Σ P_i J_iᵀ (J_i J_iᵀ + wI)⁻¹ b_i, (n,).
    """

    S: Matrix
    q0: Vector


class Condensing(NamedTuple):
    """Scratch of `condense`.

    Attributes:
        X: rows of what is subtracted, S = whole·I − XᵀX, (m·k + m, n): one for each row of J, and
            at most m that `_flush` writes for each task.
        B, D: of P_i = cI − Bᵀ diag(D) B, (2m + 1, n) and (m,).
        F: Σ inverse·D (2c − D) over the tasks i since its row of B was written, (m,), inverse =
            1/w, or 1/(1 + w) where J_i = I: Σ inverse·P_i² = (Σ inverse·c²) I − Bᵀ diag(F) B.
        C: the triangle, CᵀC = J_i J_iᵀ + wI, with b_i beside it, (m, m + 1), in its first rows; K
            of the smoothed basis, too.
        Q: of the smoothed basis, (m, m + 1).
        rise: Σ_j α_ji of each task i, (k,).
        along: coefficients along the rows of B, (max(m, n),).
        closes: 1 for a task whose Jacobian is I, (k,).
        order: tasks above i, of `sort_tasks`, (k,).
        level_rows: rows of J, of either basis, (m,).
        chain: tasks whose rows B has, (k,).
        ranks: ranks[t] is how many rows of B the first t tasks of the chain have, (k + 1,).
    """

    X: Matrix
    B: Matrix
    D: Vector
    F: Vector
    C: Matrix
    Q: Matrix
    rise: Vector
    along: Vector
    closes: Indices
    order: Indices
    level_rows: Indices
    chain: Indices
    ranks: Indices


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
    used: int,
    work: Condensing,
    q0: Vector,
) -> None:
    """Add P Jᵀ(JJᵀ + wI)⁻¹ b to q₀ and write X with P H⁻¹ P = P²/w − XᵀX, behind its used rows.

    P = cI − Bᵀ diag(D) B. By Woodbury H⁻¹ = (I − Jᵀ(JJᵀ + wI)⁻¹J)/w; with JJᵀ + wI = CᵀC, C a
    triangle, X = C⁻ᵀ J P/√w, and P Jᵀ(JJᵀ + wI)⁻¹ b = √w Xᵀ C⁻ᵀ b.
    """
    X, C, B, D, scratch = work.X[used:], work.C, work.B, work.D, work.along
    m, n = jacobian.shape
    for a in range(m):
        for other in range(a, m):
            C[a, other] = dot(jacobian[a], jacobian[other])
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
        for before in range(a):  # row a of C⁻ᵀ[J P | b], by forward substitution
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
    """Write the rows √F[p]·B[p] behind the used ones of X, and clear F; returns how many are used.

    Done with the rows of B that are overwritten next, and with all at the end.
    """
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
    tasks: Tasks, w: float, smoothing: float, condensed: Condensed, work: Condensing
) -> float:
    """Write the upper triangle of S = whole·I − XᵀX, and q₀; returns whole = Σ inverse·c².

    Tasks whose upper ones are the same in the same order have those rows of the basis in common:
    in a hierarchy of strict levels every row is orthonormalised, and enters S, once. The chain is
    the tasks whose rows B has, in their order, and F[p] adds up what B[p] has in S as long as it
    stays: the rows beyond those in common go to X before B gets others in their place.

    Args:
        tasks: k of them, of n joints.
        w: ω_r.
        smoothing: s₀, or 0.
        condensed: written.
        work: scratch.
    """
    jacobian, offsets, target, alpha = tasks
    S, q0 = condensed
    X, B, D, F = work.X, work.B, work.D, work.F
    closes, order, chain, ranks = work.closes, work.order, work.chain, work.ranks
    (m, n), k = jacobian.shape, offsets.size - 1
    whole, used, chained, ranks[0] = 0.0, 0, 0, 0
    q0[:] = 0.0
    F[:] = 0.0
    _look(jacobian, offsets, alpha, closes, work.rise)
    basis = Basis(B, D, ranks, work.level_rows)
    spectrum = Spectrum(work.level_rows, work.C, work.Q)
    for i in range(k):
        above = Above(jacobian, offsets, closes, alpha[i], order)
        count = sort_tasks(alpha[i], closes, work.rise, order)
        if smoothing > 0.0:
            rank, c = smooth_basis(above, count, smoothing, basis, spectrum)
        else:
            common = _shared(order, count, closes, chain, chained)
            if common < count and not closes[order[common]]:
                used = _flush(ranks[common], ranks[chained], B, F, X, used)
                chained = _chain(order, count, closes, chain)
            rank, c = exact_basis(above, count, common, basis)
        first, last = offsets[i], offsets[i + 1]
        inverse = 1.0 / (1.0 + w) if closes[i] else 1.0 / w  # H_i⁻¹, or its part along I
        whole += inverse * c * c
        for p in range(rank):
            F[p] += inverse * D[p] * (2.0 * c - D[p])
        if closes[i]:
            own = target[first:last]
            add(q0, c * inverse, own)
            for p in range(rank):
                add(q0, -D[p] * inverse * dot(B[p], own), B[p])
        else:
            _project_task(jacobian[first:last], target[first:last], w, rank, c, used, work, q0)
            used += last - first
        if smoothing > 0.0:
            used = _flush(0, rank, B, F, X, used)
    used = _flush(0, m, B, F, X, used)
    for i in range(n):
        for j in range(i, n):
            S[i, j] = whole if i == j else 0.0
    syrk(S, -1.0, X, used)
    return whole
