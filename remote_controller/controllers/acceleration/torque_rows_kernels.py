"""Compiled: how torques move tasks."""

from __future__ import annotations

import math

from hoap3.protocol.runtime.numba_jit import Matrix, kernel


@kernel()
def torque_rows(jacobian: Matrix, mass: Matrix, factor: Matrix, out: Matrix) -> bool:
    """Write J M⁻¹, (m, n): row i solves M x = J_iᵀ by M = L Lᵀ; False if M is not positive.

    Args:
        jacobian: J, (m, n).
        mass: M, (n, n), symmetric.
        factor: scratch, (n, n); L, written below its diagonal and on it.
        out: written.
    """
    m, n = jacobian.shape
    for i in range(n):
        for j in range(i + 1):
            rest = mass[i, j]
            for k in range(j):
                rest -= factor[i, k] * factor[j, k]
            if i > j:
                factor[i, j] = rest / factor[j, j]
            elif rest > 0.0:
                factor[i, i] = math.sqrt(rest)
            else:
                return False
    for row in range(m):
        for i in range(n):  # L y = J_iᵀ
            rest = jacobian[row, i]
            for k in range(i):
                rest -= factor[i, k] * out[row, k]
            out[row, i] = rest / factor[i, i]
        for i in range(n - 1, -1, -1):  # Lᵀ x = y
            rest = out[row, i]
            for k in range(i + 1, n):
                rest -= factor[k, i] * out[row, k]
            out[row, i] = rest / factor[i, i]
    return True
