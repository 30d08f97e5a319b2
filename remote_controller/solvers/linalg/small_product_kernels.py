"""Products of small dense matrices, row by row."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.runtime.numba_jit import inlined, kernel
from hoap3.remote_controller.solvers.linalg.dense_kernels import add_rows
from hoap3.remote_controller.solvers.linalg.tiled_product_kernels import factorise, triangular_solve

Array = NDArray[np.float64]


@kernel("void(f8[:,::1], f8[:,::1], f8[:,::1])")
def times(A: Array, B: Array, out: Array) -> None:
    """Write A B."""
    n = A.shape[0]
    for i in range(n):
        row = out[i]
        for j in range(n):
            row[j] = 0.0
        add_rows(row, A[i], B, 0, n, 0)


@kernel("void(f8[:,::1], f8[:,::1], f8[:,::1], f8[::1])")
def transposed_times(A: Array, B: Array, out: Array, scratch: Array) -> None:
    """Write Aᵀ B."""
    n = A.shape[0]
    for i in range(n):
        row = out[i]
        for j in range(n):
            row[j] = 0.0
            scratch[j] = A[j, i]
        add_rows(row, scratch, B, 0, n, 0)


@inlined
def mirror(A: Array) -> None:
    """Copy the upper triangle to the lower one."""
    for i in range(A.shape[0]):
        for j in range(i):
            A[i, j] = A[j, i]


@kernel("b1(f8[:,::1], f8[:,::1], f8[:,::1], f8[::1])")
def root_inverse(A: Array, U: Array, P: Array, scratch: Array) -> bool:
    """P = U⁻ᵀ where A = UᵀU; False where A is not positive definite."""
    n = A.shape[0]
    for i in range(n):
        for j in range(n):
            U[i, j] = A[i, j]
            P[i, j] = 1.0 if i == j else 0.0
    if factorise(U, n, 0.0, scratch) < n:
        return False
    triangular_solve(U, P)
    return True


@inlined
def clear(A: Array) -> None:
    """Write 0."""
    for i in range(A.shape[0]):
        for j in range(A.shape[1]):
            A[i, j] = 0.0


@inlined
def dot_column(S: Array, r: int, x: Array) -> float:
    """Row r of S times λ; S is given transposed."""
    found = 0.0
    for i in range(S.shape[0]):
        found += S[i, r] * x[i]
    return found
