"""Products and factors in tiles, of sizes that fill tiles and of sizes that do not."""

from __future__ import annotations

import numpy as np
import pytest

from hoap3.remote_controller.solvers.linalg import tiled_product_kernels

SIZES = [1, 2, 3, 4, 5, 7, 8, 11, 16, 33]


def close(found: np.ndarray, right: np.ndarray) -> None:
    np.testing.assert_allclose(found, right, rtol=0, atol=1e-12 * (1 + np.abs(right).max()))


def random(*shape: int) -> np.ndarray:
    return np.random.default_rng(sum(shape)).normal(size=shape)


@pytest.mark.parametrize("n", SIZES)
def test_a_part_of_a_product_is_added_and_nothing_else_is_touched(n):
    X, Y, target = random(9, n), random(9, n + 3), random(n, n + 3)
    expected = target.copy()
    top, left = n // 3, n // 2
    expected[top:, left : n + 2] -= 0.5 * X[2:7, top:].T @ Y[2:7, left : n + 2]
    block = tiled_product_kernels.Block(top, n, left, n + 2, 2, 7)
    tiled_product_kernels.gemm(target, -0.5, X, Y, block)
    close(target, expected)


@pytest.mark.parametrize("n", SIZES)
@pytest.mark.parametrize("count", [0, 1, 6])
def test_gram(n, count):
    rows, target = random(6, n), random(n, n)
    expected = np.triu(target - 2.0 * rows[:count].T @ rows[:count])
    tiled_product_kernels.syrk(target, -2.0, rows, count)
    close(np.triu(target), expected)


@pytest.mark.parametrize("n", SIZES)
def test_products_with_a_triangle_and_without(n):
    X, L, out = random(n, n), random(n, n), np.full((n, n), np.nan)
    tiled_product_kernels.multiply(out, X, L, False)
    close(out, X.T @ L)
    tiled_product_kernels.multiply(out, X, np.tril(L), True)
    close(out, X.T @ np.tril(L))


@pytest.mark.parametrize("n", SIZES)
def test_factor_of_the_upper_triangle_within_a_larger_array(n):
    root = random(n + 2, n)
    A = np.full((n, n + 1), np.nan)
    A[:, :n] = np.where(np.tri(n, k=-1) > 0, np.nan, root.T @ root)
    assert tiled_product_kernels.factorise(A, n, 0.0, np.empty(n)) == n
    close(np.triu(A[:, :n]), np.linalg.cholesky(root.T @ root).T)


@pytest.mark.parametrize("n", SIZES)
def test_dependent_columns_are_zero_rows_of_the_factor(n):
    root = random(n, n)
    root[:, n // 2] = root[:, 0]
    gram = root.T @ root
    A = gram.copy()
    rank = tiled_product_kernels.factorise(A, n, 1e-9, np.empty(n))
    assert rank == max(n - 1, 1)
    if n > 1:
        assert not A[n // 2, n // 2 :].any()
    U = np.triu(A)
    close(U.T @ U, gram)


@pytest.mark.parametrize("n", SIZES)
def test_rows_divided_by_a_triangle(n):
    U, rows = np.triu(random(n, n)) + 3 * np.eye(n), random(n, 2 * n)
    expected = np.linalg.solve(U.T, rows)
    tiled_product_kernels.triangular_solve(U, rows)
    close(rows, expected)
