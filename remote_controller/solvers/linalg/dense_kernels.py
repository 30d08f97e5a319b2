"""Small dense linear algebra for kernels: rows, triangles, eigenvectors.

Symmetric matrices live in their upper triangle, A = UᵀU, so that every inner loop runs along a row
and needs no sum to be reordered: compilers make vector instructions of that, and the bits stay.
"""

from __future__ import annotations

import math

import numpy as np

from hoap3.protocol.runtime.numba_jit import Matrix, Vector, inlined, kernel

MAX = float(np.finfo(np.float64).max)
SWEEPS = 30  # of Jacobi's rotations; it converges quadratically, about six do
ORTHOGONAL = 1e-15  # cosine of an angle that is rounding
NOTHING = 1e-300  # products of numbers near 1 that are nothing


@inlined
def not_finite(values: Vector) -> bool:
    """Whether a number of an array of one dimension is NaN or infinite."""
    found = 0
    for i in range(values.size):
        found += 0 if abs(values[i]) <= MAX else 1
    return found > 0


@inlined
def dot(a: Vector, b: Vector) -> float:
    """Inner product of two vectors, in four partial sums of a fixed order."""
    s0, s1, s2, s3 = 0.0, 0.0, 0.0, 0.0
    quarter = a.size // 4
    for q in range(quarter):
        i = 4 * q
        s0 += a[i] * b[i]
        s1 += a[i + 1] * b[i + 1]
        s2 += a[i + 2] * b[i + 2]
        s3 += a[i + 3] * b[i + 3]
    for i in range(4 * quarter, a.size):
        s0 += a[i] * b[i]
    return (s0 + s1) + (s2 + s3)


@inlined
def add(target: Vector, factor: float, row: Vector) -> None:
    """Target += factor·row."""
    for i in range(target.size):
        target[i] += factor * row[i]


@inlined
def add_rows(
    target: Vector, factors: Vector, rows: Matrix, first: int, last: int, start: int
) -> None:
    """Target += Σ factors[k]·rows[k, start:] for first ≤ k < last, four rows at a time."""
    fours = (last - first) // 4
    for q in range(fours):
        k = first + 4 * q
        f0, f1, f2, f3 = factors[k], factors[k + 1], factors[k + 2], factors[k + 3]
        r0, r1 = rows[k, start:], rows[k + 1, start:]
        r2, r3 = rows[k + 2, start:], rows[k + 3, start:]
        for i in range(target.size):
            target[i] += (f0 * r0[i] + f1 * r1[i]) + (f2 * r2[i] + f3 * r3[i])
    for k in range(first + 4 * fours, last):
        add(target, factors[k], rows[k, start:])


@kernel()
def pivoted_cholesky(W: Matrix, least: float, U: Matrix) -> None:
    """U with UᵀU = W, for a singular W: the largest pivot first, down to `least`.

    So what is left out of W is of the size of that pivot, where a Cholesky factorisation in the
    order of the columns would leave out its root.

    Args:
        W: positive semidefinite, (n, n), both triangles; overwritten.
        least: pivots up to it are 0.
        U: (n, n), written; no triangle, rows of 0 at its end.
    """
    n = W.shape[0]
    for k in range(n):
        best = 0
        for i in range(n):
            best = i if W[i, i] > W[best, best] else best
        pivot, row = W[best, best], U[k]
        inverse = 1.0 / math.sqrt(pivot) if pivot > least else 0.0
        for i in range(n):
            row[i] = inverse * W[best, i]
        if inverse > 0.0:
            for i in range(n):
                add(W[i], -row[i], row)
                W[i, best] = 0.0
                W[best, i] = 0.0


@kernel()
def solve_lower(U: Matrix, b: Vector) -> None:
    """Solve Uᵀx = b, x in place of b; U regular."""
    for k in range(b.size):
        b[k] /= U[k, k]
        add(b[k + 1 :], -b[k], U[k, k + 1 : b.size])


@kernel()
def solve_upper(U: Matrix, b: Vector) -> None:
    """Solve Ux = b, x in place of b; U regular."""
    n = b.size
    for q in range(n):
        k = n - 1 - q
        b[k] = (b[k] - dot(U[k, k + 1 : n], b[k + 1 :])) / U[k, k]


@inlined
def rotate(first: Vector, second: Vector, cosine: float, sine: float) -> None:
    """Rotate two rows: cosine·first + sine·second, cosine·second − sine·first."""
    for i in range(first.size):
        a, b = first[i], second[i]
        first[i] = cosine * a + sine * b
        second[i] = cosine * b - sine * a


@kernel()
def eigenvectors(K: Matrix, Q: Matrix, m: int) -> None:
    """Jacobi's rotations: K becomes diagonal, the rows of Q its eigenvectors.

    Args:
        K: symmetric, both triangles, (m, m) or larger.
        Q: as large, written.
        m: how many rows and columns count.
    """
    for a in range(m):
        for b in range(m):
            Q[a, b] = 1.0 if a == b else 0.0
    for _ in range(SWEEPS):
        turned = False
        for a in range(m):
            for b in range(a + 1, m):
                off = K[a, b]
                if abs(off) <= ORTHOGONAL * math.sqrt(abs(K[a, a] * K[b, b])) + NOTHING:
                    continue
                turned = True
                half = 0.5 * math.atan2(2.0 * off, K[a, a] - K[b, b])
                cosine, sine = math.cos(half), math.sin(half)
                rotate(K[a, :m], K[b, :m], cosine, sine)
                rotate(K[:m, a], K[:m, b], cosine, sine)
                rotate(Q[a, :m], Q[b, :m], cosine, sine)
        if not turned:
            return


@kernel()
def orthogonalise(rows: Matrix, count: int) -> None:
    """Rotate the first `count` rows until they are orthogonal (one-sided Jacobi, Hestenes 1958)."""
    for _ in range(SWEEPS):
        turned = False
        for a in range(count):
            for b in range(a + 1, count):
                p, q = dot(rows[a], rows[a]), dot(rows[b], rows[b])
                off = dot(rows[a], rows[b])
                if abs(off) <= ORTHOGONAL * math.sqrt(p * q) + NOTHING:
                    continue
                turned = True
                half = 0.5 * math.atan2(2.0 * off, p - q)
                rotate(rows[a], rows[b], math.cos(half), math.sin(half))
        if not turned:
            return
