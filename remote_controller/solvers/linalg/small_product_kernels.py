"""Products of small dense matrices, row by row."""

from __future__ import annotations

from hoap3.protocol.runtime.numba_jit import Matrix, Vector, inlined, kernel
from hoap3.remote_controller.solvers.linalg.dense_kernels import add_rows
from hoap3.remote_controller.solvers.linalg.tiled_product_kernels import factorise, triangular_solve


@kernel()
def times(A: Matrix, B: Matrix, out: Matrix) -> None:
    """Write A B."""
    n = A.shape[0]
    for i in range(n):
        row = out[i]
        for j in range(n):
            row[j] = 0.0
        add_rows(row, A[i], B, 0, n, 0)


@kernel()
def transposed_times(A: Matrix, B: Matrix, out: Matrix, scratch: Vector) -> None:
    """Write Aᵀ B."""
    n = A.shape[0]
    for i in range(n):
        row = out[i]
        for j in range(n):
            row[j] = 0.0
            scratch[j] = A[j, i]
        add_rows(row, scratch, B, 0, n, 0)


@inlined
def mirror(A: Matrix) -> None:
    """Copy the upper triangle to the lower one."""
    for i in range(A.shape[0]):
        for j in range(i):
            A[i, j] = A[j, i]


@kernel()
def root_inverse(A: Matrix, U: Matrix, P: Matrix, scratch: Vector) -> bool:
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
def clear(A: Matrix) -> None:
    """Write 0."""
    for i in range(A.shape[0]):
        for j in range(A.shape[1]):
            A[i, j] = 0.0


@inlined
def dot_column(St: Matrix, r: int, gains: Vector) -> float:
    """S λ of joint r, from Sᵀ (n, joints) and λ (n,)."""
    found = 0.0
    for i in range(St.shape[0]):
        found += St[i, r] * gains[i]
    return found
