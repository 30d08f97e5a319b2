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
