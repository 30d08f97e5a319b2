"""QP12 with bounds: joint speed limits, and whatever else limits each joint on its own.

    min  γ|W u|₁ + (1−γ)/2 |W u|²   subject to   gradient·u = −decrease,  lower ≤ u ≤ upper

``BoundedQp12`` is for loops, ``qp12_bounded`` for everything else. How the clamping works, and why
it is exact, stands in ``bounded_qp12_kernels``, which are compiled, or loaded, when the first
``BoundedQp12`` is made.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hoap3.protocol.errors import BadProblemError
from hoap3.remote_controller.solvers.base.validation import KERNEL_ARRAYS, array, no_descent, number


class BoundedQp12:
    """Solves QP12 within bounds for n joints without allocating anything.

    Args:
        n: number of joints.
        weights: of the joints, (n,), positive; all 1 by default. A joint of weight 2 counts as if
            it moved twice as fast.

    Attributes:
        n: number of joints.
        weights: of the joints, (n,); may be changed between solves.
        kkt_residual: how far the last answer is from optimal, relative and without units; inf
            where an error was raised.

    Raises:
        BadProblemError: the weights are not n numbers.
    """

    def __init__(self, n: int, weights: ArrayLike | None = None) -> None:
        from hoap3.remote_controller.solvers.qp12 import bounded_qp12_kernels

        self.n = n
        self._kernel = bounded_qp12_kernels.bounded_qp12_kernel
        self._work = np.ones(bounded_qp12_kernels.work_shape(n))
        self.weights = self._work[0]
        given = np.ones(n) if weights is None else array("weights", weights, 1)
        if given.shape != (n,):
            raise BadProblemError(f"weights must have shape ({n},), one for each joint.")
        self.weights[:] = given
        self.kkt_residual = math.inf

    def solve(
        self,
        gradient: NDArray[np.float64],
        decrease: float,
        gamma: float,
        lower: NDArray[np.float64],
        upper: NDArray[np.float64],
        out: NDArray[np.float64],
    ) -> None:
        """Write u into ``out``: zeros on an error, untouched if a shape or a type is wrong.

        Args:
            gradient: ∇V, shape (n,).
            decrease: −V̇ to be reached; any sign, 0 gives u = 0.
            gamma: 0 (even) to 1 (sparse).
            lower: ≤ 0, (n,), −inf where there is none.
            upper: ≥ 0, (n,), inf where there is none.
            out: u, shape (n,); not ``gradient``.

        Raises:
            InfeasibleError: the bounds, or a zero gradient, do not allow that decrease.
            BadProblemError: wrong shape or type of array, a value that is not finite, γ outside
                [0, 1], a weight that is not positive, 0 not within the bounds, or an answer beyond
                1e307.
        """
        try:
            found = self._kernel(gradient, decrease, gamma, lower, upper, self._work, out)
        except TypeError as error:
            self.kkt_residual = math.inf
            raise BadProblemError(f"QP12: wrong type of argument. {KERNEL_ARRAYS}") from error
        if found < 0.0:
            self.kkt_residual = math.inf
            raise no_descent(
                "QP12",
                int(-found),
                decrease,
                f"gradient, weights, bounds and out must all have shape ({self.n},).",
                "gradient and decrease must be finite, gamma within [0, 1], weights positive, and "
                f"0 within the bounds (found decrease {decrease}, gamma {gamma}).",
                f"QP12: no input within the bounds reaches a decrease of {decrease}. Lower it to "
                "what `feasible_rate` allows, and let it vanish with the gradient.",
            )
        self.kkt_residual = found


def qp12_bounded(
    gradient: ArrayLike,
    decrease: float,
    gamma: float,
    lower: ArrayLike,
    upper: ArrayLike,
    out: NDArray[np.float64] | None = None,
    *,
    weights: ArrayLike | None = None,
) -> NDArray[np.float64]:
    """Solve one QP12 within bounds.

    Args:
        gradient: ∇V, shape (n,).
        decrease: −V̇ to be reached; any sign, 0 gives u = 0.
        gamma: 0 (even) to 1 (sparse).
        lower: ≤ 0, (n,), −inf where there is none.
        upper: ≥ 0, (n,), inf where there is none.
        out: where to write u, shape (n,); a new array by default.
        weights: of the joints, (n,), positive; all 1 by default.

    Returns:
        u, shape (n,), in the unit of decrease/gradient.

    Raises:
        InfeasibleError: the bounds, or a zero gradient, do not allow that decrease.
        BadProblemError: as for ``BoundedQp12.solve``.
    """
    slope = array("gradient", gradient, 1)
    least, most = array("lower", lower, 1), array("upper", upper, 1)
    u = np.empty_like(slope) if out is None else out
    solver = BoundedQp12(slope.size, weights)
    solver.solve(slope, number("decrease", decrease), number("gamma", gamma), least, most, u)
    return u
