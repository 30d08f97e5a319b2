"""Products of matrices, and factors of them, in tiles of four by four.

A tile's sixteen sums stay in registers while the rows that make them go by, four entries at a time:
vector instructions without a fast mode, since each sum keeps its order. Whatever does not fill a
tile, at the right and at the bottom, is done by plain loops.

Indices of a tile are unsigned. Signed ones might be negative, which numba takes for counted from
the end; the compiler could not see then that entries are neighbours.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from hoap3.protocol.runtime.numba_jit import Matrix, Vector, inlined, kernel
from hoap3.remote_controller.solvers.linalg.dense_kernels import add

ONE, TWO, THREE = np.uint64(1), np.uint64(2), np.uint64(3)


@inlined
def _tile(
    target: Matrix, sign: float, X: Matrix, Y: Matrix, row: int, column: int, first: int, last: int
) -> None:
    """Four rows and columns of target += sign·XᵀY, of the rows from `first` to `last`."""
    i0, j0 = np.uint64(row), np.uint64(column)
    i1, i2, i3 = i0 + ONE, i0 + TWO, i0 + THREE
    j1, j2, j3 = j0 + ONE, j0 + TWO, j0 + THREE
    a0, a1, a2, a3 = 0.0, 0.0, 0.0, 0.0
    b0, b1, b2, b3 = 0.0, 0.0, 0.0, 0.0
    c0, c1, c2, c3 = 0.0, 0.0, 0.0, 0.0
    d0, d1, d2, d3 = 0.0, 0.0, 0.0, 0.0
    for k in range(np.uint64(first), np.uint64(last)):
        a, b, c, d = X[k, i0], X[k, i1], X[k, i2], X[k, i3]
        y0, y1, y2, y3 = Y[k, j0], Y[k, j1], Y[k, j2], Y[k, j3]
        a0, a1, a2, a3 = a0 + a * y0, a1 + a * y1, a2 + a * y2, a3 + a * y3
        b0, b1, b2, b3 = b0 + b * y0, b1 + b * y1, b2 + b * y2, b3 + b * y3
        c0, c1, c2, c3 = c0 + c * y0, c1 + c * y1, c2 + c * y2, c3 + c * y3
        d0, d1, d2, d3 = d0 + d * y0, d1 + d * y1, d2 + d * y2, d3 + d * y3
    target[i0, j0] += sign * a0
    target[i0, j1] += sign * a1
    target[i0, j2] += sign * a2
    target[i0, j3] += sign * a3
    target[i1, j0] += sign * b0
    target[i1, j1] += sign * b1
    target[i1, j2] += sign * b2
    target[i1, j3] += sign * b3
    target[i2, j0] += sign * c0
    target[i2, j1] += sign * c1
    target[i2, j2] += sign * c2
    target[i2, j3] += sign * c3
    target[i3, j0] += sign * d0
    target[i3, j1] += sign * d1
    target[i3, j2] += sign * d2
    target[i3, j3] += sign * d3


class Block(NamedTuple):
    """Which part of target += sign·XᵀY is meant; each second one is the first that is not.

    Attributes:
        top, bottom: rows of the target.
        left, right: its columns.
        first, last: rows of X and Y that are summed over.
    """

    top: int
    bottom: int
    left: int
    right: int
    first: int
    last: int


@kernel(superwords=True)
def gemm(target: Matrix, sign: float, X: Matrix, Y: Matrix, block: Block) -> None:
    """A block of target += sign·XᵀY."""
    top, bottom, left, right, first, last = block
    high, wide = (bottom - top) // 4, (right - left) // 4
    for p in range(high):
        for q in range(wide):
            _tile(target, sign, X, Y, top + 4 * p, left + 4 * q, first, last)
    for i in range(top, bottom):
        start = left + 4 * wide if i < top + 4 * high else left
        if start < right:
            for k in range(first, last):
                add(target[i, start:right], sign * X[k, i], Y[k, start:right])


@kernel()
def syrk(target: Matrix, sign: float, rows: Matrix, count: int) -> None:
    """Upper triangle of target += sign·rowsᵀ·rows, of the first `count` rows.

    Below the diagonal a few entries change, too.
    """
    n = target.shape[0]
    for i in range(0, n, 4):
        gemm(target, sign, rows, rows, Block(i, min(i + 4, n), i, n, 0, count))


@kernel()
def multiply(target: Matrix, X: Matrix, L: Matrix, lower: bool) -> None:
    """Write XᵀL; all (n, n), L lower triangular where that is said."""
    n = target.shape[0]
    target[:] = 0.0
    for j in range(0, n, 4):
        gemm(target, 1.0, X, L, Block(0, n, j, min(j + 4, n), j if lower else 0, n))


@kernel()
def factorise(A: Matrix, n: int, tolerance: float, scratch: Vector) -> int:
    """U with UᵀU = A in place of A's upper triangle; returns the rank.

    A pivot up to `tolerance` times its entry of the diagonal is 0, and so is its row of U. Below
    the diagonal a few entries become 0.

    Args:
        A: positive semidefinite, (n, n) or larger.
        n: how many of its rows and columns count.
        tolerance: 0 for a definite one.
        scratch: (n,).
    """
    rank = 0
    for top in range(0, n, 4):
        bottom = min(top + 4, n)
        for i in range(top, bottom):
            scratch[i] = A[i, i]
        gemm(A, -1.0, A, A, Block(top, bottom, top, n, 0, top))
        for i in range(top, bottom):
            row = A[i, i:n]
            for k in range(top, i):
                add(row, -A[k, i], A[k, i:n])
                A[i, k] = 0.0
            pivot = row[0]
            regular = pivot > tolerance * scratch[i]
            root = math.sqrt(pivot) if regular else 0.0
            inverse = 1.0 / root if regular else 0.0
            for j in range(row.size):
                row[j] *= inverse
            row[0] = root
            rank += 1 if regular else 0
    return rank


@kernel()
def triangular_solve(U: Matrix, rows: Matrix) -> None:
    """Replace the first n of the rows by U⁻ᵀ·rows; U regular, (n, n)."""
    n, wide = U.shape[0], rows.shape[1]
    for top in range(0, n, 4):
        bottom = min(top + 4, n)
        gemm(rows, -1.0, U, rows, Block(top, bottom, 0, wide, 0, top))
        for i in range(top, bottom):
            row, inverse = rows[i], 1.0 / U[i, i]
            for k in range(top, i):
                add(row, -U[k, i], rows[k])
            for j in range(wide):
                row[j] *= inverse
