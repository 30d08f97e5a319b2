"""Small symmetric systems that are quasidefinite: each pivot has a sign, and none needs a swap.

Vanderbei, SIAM Journal on Optimization 5, 1995.
"""

from __future__ import annotations

from hoap3.protocol.runtime.numba_jit import Matrix, Vector, kernel

LOST = 1e-13  # of what was subtracted: a smaller pivot is rounding


@kernel()
def solve_quasidefinite(K: Matrix, size: int, b: Vector, inverses: Vector, factors: Vector) -> bool:
    """Solve K x = b by K = UᵀD⁻¹U, D the diagonal of U, four rows at a time, x in place of b.

    Args:
        K: symmetric, the upper triangle of its first `size` rows; overwritten by U.
        size: how many rows and columns count.
        b: (size,) or longer.
        inverses, factors: scratch, likewise.

    Returns:
        Whether every pivot is more than rounding.
    """
    for i in range(size):
        whole = abs(K[i, i])
        for k in range(i):
            factors[k] = -K[k, i] * inverses[k]
            whole += abs(factors[k] * K[k, i])
        fours = i // 4
        for q in range(fours):
            k = 4 * q
            f0, f1, f2, f3 = factors[k], factors[k + 1], factors[k + 2], factors[k + 3]
            for j in range(i, size):
                upper = f0 * K[k, j] + f1 * K[k + 1, j]
                K[i, j] += upper + (f2 * K[k + 2, j] + f3 * K[k + 3, j])
            b[i] += (f0 * b[k] + f1 * b[k + 1]) + (f2 * b[k + 2] + f3 * b[k + 3])
        for k in range(4 * fours, i):
            for j in range(i, size):
                K[i, j] += factors[k] * K[k, j]
            b[i] += factors[k] * b[k]
        if not abs(K[i, i]) > LOST * whole:
            return False
        inverses[i] = 1.0 / K[i, i]
    for q in range(size):
        i = size - 1 - q
        b[i] *= inverses[i]
        for k in range(i):
            b[k] -= K[k, i] * b[i]
    return True
