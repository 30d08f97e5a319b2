"""QP12: the input that is as sparse or as even as γ says, with V̇ as demanded.

    min  γ|u|₁ + (1−γ)/2 |u|²   subject to   gradient·u = −decrease

Gonçalves et al., IEEE T-RO 2020, equation (26). The kernels are compiled, or loaded, when the
first ``Qp12`` is made.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.errors import BadProblemError, InfeasibleError
from hoap3.remote_controller.solvers.base.status import (
    BAD_INPUT,
    BAD_SHAPE,
    INFEASIBLE,
    OUT_OF_RANGE,
)
from hoap3.remote_controller.solvers.base.validation import KERNEL_ARRAYS


class Qp12:
    """Solves QP12 for n joints without allocating anything.

    Attributes:
        n: number of joints.
        kkt_residual: how far the last answer is from optimal, relative and without units (about
            n · 1e-16; see ``qp12_kernels.qp12_kkt_residual``); inf where an error was raised.
    """

    def __init__(self, n: int) -> None:
        from hoap3.remote_controller.solvers.qp12 import qp12_kernels

        self.n = n
        self._kernel = qp12_kernels.qp12_kernel
        self.kkt_residual = math.inf

    def solve(
        self, gradient: NDArray[np.float64], decrease: float, gamma: float, out: NDArray[np.float64]
    ) -> None:
        """Write u into ``out``: zeros on an error, untouched if a shape or a type is wrong.

        Args:
            gradient: ∇V, shape (n,).
            decrease: −V̇ to be reached; any sign, u is odd in it, 0 gives u = 0.
            gamma: 0 (even) to 1 (sparse; joints tied for the largest gradient share evenly).
            out: u, shape (n,); not ``gradient`` itself, of which ``kkt_residual`` is computed too.

        Raises:
            InfeasibleError: the gradient is zero, the decrease is not.
            BadProblemError: wrong shape or type of array, a value that is not finite, γ outside
                [0, 1], or an answer beyond 1e307.
        """
        try:
            status, self.kkt_residual = self._kernel(self.n, gradient, decrease, gamma, out)
        except TypeError as error:
            self.kkt_residual = math.inf
            raise BadProblemError(f"QP12: wrong type of argument. {KERNEL_ARRAYS}") from error
        if status == INFEASIBLE:
            raise InfeasibleError(
                "QP12: the gradient is zero, so no input can reach a decrease of "
                f"{decrease}. Let the decrease vanish with the gradient."
            )
        if status:
            problems = {
                BAD_SHAPE: f"gradient and out must both have shape ({self.n},).",
                OUT_OF_RANGE: f"a decrease of {decrease} along so small a gradient needs an input "
                "beyond 1e307. Let the decrease vanish with the gradient, and check the units.",
                BAD_INPUT: "gradient and decrease must be finite and gamma within [0, 1] (found "
                f"decrease {decrease}, gamma {gamma}).",
            }
            raise BadProblemError(f"QP12: {problems[status]}")
