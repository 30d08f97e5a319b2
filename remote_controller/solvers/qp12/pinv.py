"""The pseudo-inverse baseline: u along −J⁺ e, of minimum norm.

The kernels are compiled, or loaded, when the first ``Pinv`` is made. How rank deficiency is treated
stands in ``pinv_kernels``.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.errors import BadProblemError, InfeasibleError, SolverError
from hoap3.remote_controller.solvers.base.status import BAD_SHAPE, INFEASIBLE, OUT_OF_RANGE
from hoap3.remote_controller.solvers.base.validation import KERNEL_ARRAYS


class Pinv:
    """Pseudo-inverse inputs for m task rows (a handful) and n joints, without allocation.

    Attributes:
        m: number of task rows.
        n: number of joints.
    """

    def __init__(self, m: int, n: int) -> None:
        from hoap3.remote_controller.solvers.qp12 import pinv_kernels

        self.m, self.n = m, n
        self._kernel, self._plain_kernel = pinv_kernels.pinv_kernel, pinv_kernels.pinv_plain_kernel
        self._work = np.empty(pinv_kernels.work_shape(m, n))
        self._rank = np.zeros(1, dtype=np.int64)

    def solve(
        self,
        jacobian: NDArray[np.float64],
        error: NDArray[np.float64],
        decrease: float,
        out: NDArray[np.float64],
    ) -> None:
        """Write into ``out`` the u along −J⁺ e with eᵀ J u = −decrease; zeros where it fails.

        Args:
            jacobian: J, shape (m, n).
            error: e, shape (m,).
            decrease: −V̇ to be reached, V = |e|²/2; any sign, 0 gives u = 0.
            out: u, shape (n,).

        Raises:
            InfeasibleError: Jᵀe = 0, the decrease is not.
            BadProblemError: wrong shape or type of array, a value that is not finite, or an
                answer that overflows.
        """
        try:
            status = self._kernel(jacobian, error, decrease, self._work, out, self._rank)
        except TypeError as cause:
            raise BadProblemError(f"PINV: wrong type of argument. {KERNEL_ARRAYS}") from cause
        if status:
            raise _failure(status, self.m, self.n, decrease)

    def solve_plain(
        self,
        jacobian: NDArray[np.float64],
        error: NDArray[np.float64],
        gain: float,
        out: NDArray[np.float64],
    ) -> None:
        """Write u = −gain J⁺ e into ``out``; as ``solve``, but never infeasible."""
        try:
            status = self._plain_kernel(jacobian, error, gain, self._work, out, self._rank)
        except TypeError as cause:
            raise BadProblemError(f"PINV: wrong type of argument. {KERNEL_ARRAYS}") from cause
        if status:
            raise _failure(status, self.m, self.n, gain)

    @property
    def rank(self) -> int:
        """Numerical rank of the last Jacobian."""
        return int(self._rank[0])


def _failure(status: int, m: int, n: int, factor: float) -> SolverError:
    if status == INFEASIBLE:
        return InfeasibleError(
            f"PINV: no input changes |e| (Jᵀe = 0), so a decrease of {factor} cannot be reached. "
            "Let the decrease vanish with Jᵀe."
        )
    if status == BAD_SHAPE:
        return BadProblemError(
            f"PINV: jacobian, error and out must have shapes ({m}, {n}), ({m},) and ({n},)."
        )
    if status == OUT_OF_RANGE:
        return BadProblemError(
            f"PINV: the answer overflows (decrease or gain {factor}). Let the decrease vanish with "
            "Jᵀe, and check the units."
        )
    return BadProblemError(
        f"PINV: jacobian, error, and decrease or gain must be finite (found {factor})."
    )
