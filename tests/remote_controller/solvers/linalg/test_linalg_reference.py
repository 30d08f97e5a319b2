"""Factors, solutions and eigenvectors of small matrices against numpy, which is their reference.

The rule: 1e-10, relative to 1 + the largest entry; matrices have a condition up to 100.
"""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import pytest
from support.amounts import AMOUNTS, seed_ranges

from hoap3.remote_controller.solvers.linalg import dense_kernels as dense
from hoap3.remote_controller.solvers.linalg import scaling_kernels as scaling
from hoap3.remote_controller.solvers.linalg import small_product_kernels as small
from hoap3.remote_controller.solvers.linalg import tiled_product_kernels as tiled
from hoap3.remote_controller.solvers.linalg.ldlt_kernels import solve_quasidefinite

SEEDS = seed_ranges(500, 1300, 5500)
many = pytest.mark.parametrize("seeds", SEEDS, ids=AMOUNTS)


def near(found: np.ndarray, expected: np.ndarray) -> None:
    within = 1e-10 * (1.0 + np.abs(expected).max(initial=0.0))
    np.testing.assert_allclose(found, expected, rtol=0, atol=within)


def definite(rng: np.random.Generator, n: int) -> np.ndarray:
    Q = np.linalg.qr(rng.normal(size=(n, n)))[0]
    A = (Q * 10.0 ** rng.uniform(-1, 1, n)) @ Q.T
    return 0.5 * (A + A.T)


@many
def test_factors_and_solutions(seeds):
    for seed in seeds:
        rng = np.random.default_rng(seed)
        n = int(rng.integers(1, 13))
        A, b, rows, scratch = (
            definite(rng, n),
            rng.normal(size=n),
            rng.normal(size=(n, 7)),
            np.empty(n),
        )
        U = np.ascontiguousarray(np.linalg.cholesky(A).T)

        factor = A.copy()
        assert tiled.factorise(factor, n, 0.0, scratch) == n
        near(np.triu(factor), U)
        for solve, right in ((dense.solve_lower, U.T), (dense.solve_upper, U)):
            x = b.copy()
            solve(U, x)
            near(x, np.linalg.solve(right, b))
        divided = rows.copy()
        tiled.triangular_solve(U, divided)
        near(divided, np.linalg.solve(U.T, rows))
        root, inverse = np.empty((n, n)), np.empty((n, n))
        assert small.root_inverse(A, root, inverse, scratch)
        near(np.tril(inverse), np.linalg.inv(U.T))

        rank = int(rng.integers(0, n + 1))
        half = np.linalg.qr(rng.normal(size=(n, n)))[0][:rank]
        W = half.T @ half
        found = np.empty((n, n))
        dense.pivoted_cholesky(W.copy(), 1e-12, found)
        near(found.T @ found, W)
        assert not found[rank:].any()

        k = int(rng.integers(0, n + 1))  # the last n − k pivots are negative
        C = rng.normal(size=(k, n - k))
        K = np.block([[A[:k, :k], C], [C.T, -A[k:, k:]]])
        x = b.copy()
        assert solve_quasidefinite(K.copy(), n, x, np.empty(n), np.empty(n))
        near(x, np.linalg.solve(K, b))


@many
def test_products(seeds):
    for seed in seeds:
        rng = np.random.default_rng(seed)
        n = int(rng.integers(1, 34))
        X, Y, out = rng.normal(size=(n, n)), rng.normal(size=(n, n)), np.empty((n, n))
        small.times(X, Y, out)
        near(out, X @ Y)
        small.transposed_times(X, Y, out, np.empty(n))
        near(out, X.T @ Y)
        tiled.multiply(out, X, Y, False)
        near(out, X.T @ Y)
        tiled.multiply(out, X, np.tril(Y), True)
        near(out, X.T @ np.tril(Y))
        count = int(rng.integers(0, n + 1))
        total = X.copy()
        tiled.syrk(total, -0.5, Y, count)
        near(np.triu(total), np.triu(X - 0.5 * Y[:count].T @ Y[:count]))


@many
def test_eigenvectors_and_orthogonal_rows(seeds):
    for seed in seeds:
        rng = np.random.default_rng(seed)
        n = int(rng.integers(1, 9))
        A, Q = definite(rng, n) - np.eye(n), np.empty((n, n))
        diagonal = A.copy()
        dense.eigenvectors(diagonal, Q, n)
        near(diagonal, np.diag(np.diag(diagonal)))
        near(np.sort(np.diag(diagonal)), np.linalg.eigvalsh(A))
        near(Q @ A @ Q.T, np.diag(np.diag(diagonal)))
        near(Q @ Q.T, np.eye(n))

        rows, count = rng.normal(size=(n, n + 2)), int(rng.integers(0, n + 1))
        turned = rows.copy()
        dense.orthogonalise(turned, count)
        near(turned.T @ turned, rows.T @ rows)  # rotated, nothing else
        np.testing.assert_array_equal(turned[count:], rows[count:])
        lengths = np.sort(np.linalg.norm(turned[:count], axis=1))
        near(lengths, np.sort(np.linalg.svd(rows[:count], compute_uv=False)))


@many
def test_powers_of_two_round_nothing(seeds):
    for seed in seeds:
        rng = np.random.default_rng(seed)
        values = rng.normal(size=int(rng.integers(0, 13)))
        assert scaling.largest(values) == np.abs(values).max(initial=0.0)
        assert scaling.largest(np.append(values, rng.choice([np.nan, np.inf, -np.inf]))) == math.inf
        exponent, value = int(rng.integers(-2000, 2001)), float(rng.normal())
        low, high = scaling.power_halves(exponent)
        assert Fraction(low) * Fraction(high) == Fraction(2) ** exponent
        try:
            expected = float(Fraction(value) * Fraction(2) ** exponent)
        except OverflowError:
            expected = math.copysign(math.inf, value)
        assert scaling.times_power(value, exponent) == expected
