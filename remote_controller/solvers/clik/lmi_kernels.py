"""The matrix inequality that makes a Lyapunov function fall, and its least eigenvalue.

Where the errors follow ė = −L Λ e, one step of Δt gives |e⁺|² = |(I − Δt L Λ) e|². So the Lyapunov
function V = ½|e|² has V⁺ ≤ (1 − β Δt) V after each, for every e, if and only if (20)

    C(λ, β) = L Λ + Λ Lᵀ − β I − Δt Λ LᵀL Λ ⪰ 0,

the Schur complement of Marti-Saumell et al., (21). So any λ, optimal or not, has its certificate,
β(λ) = λ_min(C(λ, 0)). C is concave in λ (a matrix's sense), ∂C/∂λ_i = v_i e_iᵀ + e_i v_iᵀ with v_i
the columns of the matrix V = L − Δt Λ G, G = LᵀL: below, V is that.
"""

from __future__ import annotations

import math

import numpy as np

from hoap3.protocol.runtime.numba_jit import Indices, Matrix, Vector, inlined, kernel
from hoap3.remote_controller.solvers.linalg.dense_kernels import add, add_rows, dot

EPS = float(np.finfo(np.float64).eps)
TINY = 1e-300  # no pivot is smaller
WIDEN = 32.0  # how an interval grows that turns out not to hold the eigenvalue
HALVINGS = 200  # more than a float has


@kernel()
def stability_matrix(
    L: Matrix, G: Matrix, gains: Vector, beta: float, dt: float, C: Matrix, V: Matrix
) -> None:
    """Write C(λ, β), both triangles, and V."""
    n = gains.size
    for i in range(n):
        factor = dt * gains[i]
        for j in range(n):
            V[i, j] = L[i, j] - factor * G[i, j]
    for i in range(n):
        for j in range(i, n):
            entry = V[i, j] * gains[j] + gains[i] * L[j, i]
            C[i, j] = entry
            C[j, i] = entry
        C[i, i] -= beta


@kernel()
def find_blocks(L: Matrix, block: Indices) -> None:
    """Write which rows and columns of L belong together: the number of the first one of each.

    Where tasks do not touch each other C is block diagonal, and so is what is known of it.
    """
    n = block.size
    for i in range(n):
        block[i] = i
    for i in range(n):
        for j in range(n):
            if L[i, j] != 0.0 and block[i] != block[j]:
                old, new = max(block[i], block[j]), min(block[i], block[j])
                for k in range(n):
                    block[k] = new if block[k] == old else block[k]


@inlined
def _tridiagonal(W: Matrix, diagonal: Vector, beside: Vector, p: Vector) -> None:
    """Reflect a symmetric matrix to a tridiagonal one (Householder); W is overwritten."""
    n = W.shape[0]
    for k in range(n - 1):
        row, q = W[k, k + 1 :], p[: n - 1 - k]
        diagonal[k] = W[k, k]
        first, tail = row[0], dot(row, row)
        if k == n - 2 or tail <= first * first:
            beside[k] = first
            continue
        size = -math.copysign(math.sqrt(tail), first)
        beside[k] = size
        factor = 1.0 / (tail - size * first)
        row[0] -= size
        for j in range(q.size):
            q[j] = 0.0
        add_rows(q, row, W[k + 1 :], 0, q.size, k + 1)
        for j in range(q.size):
            q[j] *= factor
        add(q, -0.5 * factor * dot(q, row), row)
        for i in range(q.size):
            rest = W[k + 1 + i, k + 1 :]
            for j in range(q.size):
                rest[j] -= row[i] * q[j] + q[i] * row[j]
    diagonal[n - 1] = W[n - 1, n - 1]


@inlined
def _any_below(diagonal: Vector, beside: Vector, x: float, least: float) -> bool:
    """Whether a tridiagonal matrix has an eigenvalue below x (Sturm)."""
    pivot: float = diagonal[0] - x
    for i in range(1, diagonal.size):
        if pivot < 0.0:
            return True
        pivot = diagonal[i] - x - beside[i - 1] * (beside[i - 1] / max(pivot, least))
    return pivot < 0.0


@kernel()
def least_eigenvalue(W: Matrix, guess: float, relative: float, scratch: Matrix) -> float:
    """The least eigenvalue of a symmetric matrix, from below.

    Args:
        W: (n, n), both triangles; overwritten.
        guess: where it may be, which only saves time.
        relative: accuracy, of the eigenvalue; rounding of the largest entries at best.
        scratch: (3, n).

    Returns:
        A number below the eigenvalue by no more than the accuracy; NaN where an entry is.
    """
    n = W.shape[0]
    diagonal, beside = scratch[0, :n], scratch[1, :n]
    _tridiagonal(W, diagonal, beside, scratch[2, :n])
    low, high, norm = math.inf, math.inf, 0.0
    for i in range(n):
        around = (abs(beside[i - 1]) if i > 0 else 0.0) + (abs(beside[i]) if i < n - 1 else 0.0)
        low, high = min(low, diagonal[i] - around), min(high, diagonal[i])
        norm = max(norm, abs(diagonal[i]) + around)
    if not norm < math.inf:
        return math.nan
    grain = EPS * max(norm, abs(guess) if abs(guess) < math.inf else 0.0) + TINY
    least, width = EPS * grain + TINY, WIDEN * grain
    low -= grain
    while low < guess - width and _any_below(diagonal, beside, guess - width, least):
        high, width = min(high, guess - width), WIDEN * width
    low, width = max(low, min(guess - width, high)), WIDEN * grain
    while guess + width < high and not _any_below(diagonal, beside, guess + width, least):
        low, width = max(low, guess + width), WIDEN * width
    high = min(high, max(guess + width, low))
    for _ in range(HALVINGS):
        if high - low <= max(grain, relative * min(abs(low), abs(high))):
            break
        middle = 0.5 * (low + high)
        if _any_below(diagonal, beside, middle, least):
            high = middle
        else:
            low = middle
    return low
