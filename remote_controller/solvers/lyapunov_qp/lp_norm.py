"""Least ℓp norm: the input that is as sparse or as even as p says, with V̇ as demanded.

    min  |u|_p   subject to   gradient·u = −decrease

Gonçalves et al., IEEE T-RO 2020, Example 2: one joint for 0 < p ≤ 1, (9) for p > 1, and all joints
alike for p = ∞. ``LpNorm`` is for loops, ``lp_norm`` for everything else. The kernels are
compiled, or loaded, when the first ``LpNorm`` is made.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hoap3.protocol.errors import BadProblemError
from hoap3.remote_controller.solvers.base.validation import KERNEL_ARRAYS, array, no_descent, number


class LpNorm:
    """Solves Example 2 for n joints without allocating anything.

    Attributes:
        n: number of joints.
        kkt_residual: of the last answer: error of the equation and Hölder's gap, relative (see
            ``lp_norm_kernels.lp_norm_residual``); inf where an error was raised.
    """

    def __init__(self, n: int) -> None:
        from hoap3.remote_controller.solvers.lyapunov_qp import lp_norm_kernels

        self.n = n
        self._kernel = lp_norm_kernels.lp_norm_kernel
        self.kkt_residual = math.inf

    def solve(
        self, gradient: NDArray[np.float64], decrease: float, p: float, out: NDArray[np.float64]
    ) -> None:
        """Write u into ``out``: zeros on an error, untouched if a shape or a type is wrong.

        Args:
            gradient: ∇V, shape (n,).
            decrease: −V̇ to be reached; any sign, u is odd in it, 0 gives u = 0.
            p: above 0, may be inf. Where several joints have the largest gradient, p > 1 treats
                them alike; up to p = 1 there is no unique answer, and the first of them moves.
            out: u, shape (n,); not ``gradient``.

        Raises:
            InfeasibleError: the gradient is zero, the decrease is not.
            BadProblemError: wrong shape or type of array, a value that is not finite, p not above
                0, or an answer beyond 1e307.
        """
        try:
            status, self.kkt_residual = self._kernel(self.n, gradient, decrease, p, out)
        except TypeError as error:
            self.kkt_residual = math.inf
            raise BadProblemError(f"lp norm: wrong type of argument. {KERNEL_ARRAYS}") from error
        if status:
            raise no_descent(
                "lp norm",
                status,
                decrease,
                f"gradient and out must both have shape ({self.n},).",
                "gradient and decrease must be finite and p above 0 (found decrease "
                f"{decrease}, p {p}).",
            )


def lp_norm(
    gradient: ArrayLike, decrease: float, p: float, out: NDArray[np.float64] | None = None
) -> NDArray[np.float64]:
    """Solve one; arguments and errors as for ``LpNorm.solve``, u in a new array by default."""
    slope = array("gradient", gradient, 1)
    u = np.empty_like(slope) if out is None else out
    LpNorm(slope.size).solve(slope, number("decrease", decrease), number("p", p), u)
    return u
