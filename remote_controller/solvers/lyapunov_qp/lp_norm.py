"""Least ℓp norm: the input that is as sparse or as even as p says, with V̇ as demanded.

    min  |u|_p   subject to   ∇V·u + ∂V/∂t = −Ψ

Gonçalves et al., IEEE T-RO 2020, Example 2: one joint for 0 < p ≤ 1, (9) for p > 1, and all joints
alike for p = ∞.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from hoap3.remote_controller.solvers.base import status
from hoap3.remote_controller.solvers.lyapunov_qp.stable_qp import FREE, STILL


class LpNorm:
    """Solves Example 2 for n joints, with the interface of `StableQp`.

    Args:
        n: number of joints.
        p: above 0, may be inf. Where several joints have the largest gradient, p > 1 treats them
            alike; up to p = 1 there is no unique answer, and the first of them moves.

    Attributes:
        u, rate, rho, path, margin, gamma: as of `StableQp`; nothing limits u.
        kkt_residual: error of the equation and Hölder's gap, relative (see
            ``lp_norm_kernels.lp_norm_residual``).
    """

    def __init__(self, n: int, p: float) -> None:
        from hoap3.remote_controller.solvers.lyapunov_qp import lp_norm_kernels

        self._kernel, self._p = lp_norm_kernels.lp_norm_kernel, p
        self.gamma = 0.0
        self.u = np.zeros(n)
        self.path, self.margin, self.rho = FREE, math.inf, 1.0
        self.rate = 0.0
        self.kkt_residual = math.inf

    def forget(self) -> None:
        """Nothing is kept."""

    def solve(self, gradient: NDArray[np.float64], psi: float, drift: float, *_: object) -> int:
        """Find u, whatever else is given: there are no constraints.

        Returns:
            `OK`; `ZERO_GRADIENT`: ∇V = 0, yet V should change; `BAD_INPUT`: a value is not finite,
            p is not above 0, the shape is wrong, or the answer is beyond 1e307. u is 0 then.
        """
        found, self.kkt_residual = self._kernel(self.u.size, gradient, psi + drift, self._p, self.u)
        solved = found == status.OK
        if not solved:
            self.u[:] = 0.0
        self.path, self.rho = (FREE, 1.0) if solved else (STILL, 0.0)
        self.rate = float(gradient @ self.u) + drift
        if solved:
            return status.OK
        return status.ZERO_GRADIENT if found == status.INFEASIBLE else status.BAD_INPUT
