"""The generalized projector: how much of a task is kept out of the directions of others.

Liu, Tan and Padois, Autonomous Robots 2015, (11); its closed form stands in `projector_kernels`,
which are compiled, or loaded, by the first call.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hoap3.protocol.errors import BadProblemError
from hoap3.remote_controller.solvers.base.validation import array, number


def generalized_projector(
    alpha_rows: ArrayLike, jacobian: ArrayLike, *, smoothing: float = 0.0
) -> NDArray[np.float64]:
    """P, by which a task's joint input is multiplied.

    Args:
        alpha_rows: priority of each row of the Jacobian over the task, (m,): 1 keeps the task out
            of that row's direction, 0 leaves it free. Rows may come in any order.
        jacobian: the rows of all tasks, (m, n): dependent ones, zero ones, more than n.
        smoothing: s₀ in the units of the Jacobian, or 1e-5 of the rows' Frobenius norm where that
            is more: directions fade out where singular values of the rows of some priority and
            above are below it, so that P is continuous in the Jacobian as
            well as in the priorities. 0 gives the paper's projector, which jumps where the rank
            changes. A smoothed P is the same wherever all singular values are s₀ or more; below,
            |J P x| ≤ 0.26·s₀·|x| in rows of priority 1.

    Returns:
        P, (n, n), symmetric, with eigenvalues from 0 to 1.

    Raises:
        BadProblemError: wrong shape, a priority outside [0, 1], or a value that is not finite.
    """
    from hoap3.remote_controller.solvers.ghc import projector_kernels

    alpha, J = array("alpha_rows", alpha_rows, 1), array("jacobian", jacobian, 2)
    if alpha.shape != J.shape[:1]:
        raise BadProblemError(
            f"alpha_rows has {alpha.size} entries; give it {J.shape[0]}, one for each row of the "
            "Jacobian."
        )
    width = number("smoothing", smoothing)
    P = np.empty((J.shape[1], J.shape[1]))
    if projector_kernels.projector_kernel(alpha, J, width, P):
        raise BadProblemError(_what_is_wrong(alpha, J, width))
    return P


def _what_is_wrong(alpha: NDArray[np.float64], J: NDArray[np.float64], width: float) -> str:
    outside = ~((alpha >= 0.0) & (alpha <= 1.0))
    if outside.any():
        row = int(np.argmax(outside))
        return f"alpha_rows[{row}] must be within [0, 1] (found {alpha[row]})."
    if not 0.0 <= width < np.inf:
        return f"smoothing must be finite and not negative (found {width})."
    rows = np.flatnonzero(~np.isfinite(J).all(axis=1))
    return f"the Jacobian must be finite (found others in row {rows[0]})."
