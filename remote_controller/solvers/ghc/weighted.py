"""The weighting strategy: tasks share one acceleration, in proportion to their weights.

Liu, Tan and Padois, Autonomous Robots 2015, (12): never exactly strict, a baseline for `ghc`.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hoap3.protocol.errors import BadProblemError, InfeasibleError, SolverError, UnknownNameError
from hoap3.remote_controller.solvers.base.status import INFEASIBLE, OK
from hoap3.remote_controller.solvers.base.task_validation import bounds_of, fit, rows_of, stacked
from hoap3.remote_controller.solvers.base.validation import array, number
from hoap3.remote_controller.solvers.ghc.ghc import REGULARISED
from hoap3.remote_controller.solvers.ghc.row_equations import impose_equations, normalised

Array = NDArray[np.float64]


def bounded_values(H: Array, f: Array, rows: Array, lower: Array, upper: Array) -> Array:
    """Minimise ½ xᵀHx − fᵀx within lower ≤ rows·x ≤ upper, by a dual active set.

    Args:
        H: positive definite, (n, n).
        f: (n,).
        rows: (c, n).
        lower, upper: (c,), ∓inf where there is none.

    Returns:
        x, (n,).

    Raises:
        InfeasibleError: no x satisfies the bounds.
        SolverError: H is not definite, or something is not finite.
    """
    from hoap3.remote_controller.solvers.qp import active_set_kernels as kernels

    c, n = rows.shape
    values, multipliers = np.zeros(n + c), np.empty(n + c)
    work = np.empty((n, n + c)), np.empty((n, n))
    status, _ = kernels.bounded_values_kernel(
        *(H.copy(), f.copy(), np.ascontiguousarray(rows), np.ascontiguousarray(lower)),
        *(np.ascontiguousarray(upper), *work, values, multipliers),
    )
    if status == INFEASIBLE:
        raise InfeasibleError("no acceleration satisfies the bounds; widen them.")
    if status != OK:
        raise SolverError(f"the quadratic program has no answer (status {status}).")
    return values[:n].copy()


def weighted(
    jacobians: Sequence[ArrayLike],
    targets: Sequence[ArrayLike],
    weights: ArrayLike,
    M: ArrayLike,
    bias: ArrayLike,
    w_r: float,
    *,
    regularise: str = "gravity_compensated",
    towards: ArrayLike | None = None,
    qdd_lower: ArrayLike | None = None,
    qdd_upper: ArrayLike | None = None,
    tau_lower: ArrayLike | None = None,
    tau_upper: ArrayLike | None = None,
    rows: ArrayLike | None = None,
    rows_lower: ArrayLike | None = None,
    rows_upper: ArrayLike | None = None,
) -> tuple[Array, Array]:
    """Min Σ ω_i |J_i q̈ − b_i|² + ω_r |q̈ − r|² + ω_r |τ − o|² within bounds, τ = M q̈ + h.

    Args:
        jacobians, targets, M, bias, regularise: as for `ghc`.
        weights: ω_i of the tasks, (k,), not negative.
        w_r: ω_r, positive.
        towards: r, (n,); 0 by default, as the paper has it.
        qdd_lower, qdd_upper, tau_lower, tau_upper: bounds, (n,).
        rows, rows_lower, rows_upper: rows of q̈, as for `ghc`.

    Returns:
        q̈ and τ, (n,).

    Raises:
        InfeasibleError: nothing satisfies the bounds and rows.
        BadProblemError: wrong shape, a value that is not finite or outside its range.
        UnknownNameError: there is no such regularisation.
    """
    stack = stacked("weighted", jacobians, targets, M, bias)
    if regularise not in REGULARISED:
        raise UnknownNameError("regularisation", regularise, REGULARISED)
    omega, w = array("weights", weights, 1), number("w_r", w_r)
    fit("weights", omega, (len(stack.sizes),))
    if (omega < 0).any() or not 0.0 < w < np.inf:
        raise BadProblemError("weights must not be negative, and w_r positive and finite.")
    ql, qu, tl, tu = bounds_of(stack.n, qdd_lower, qdd_upper, tau_lower, tau_upper)
    mass, one = stack.mass, np.eye(stack.n)
    scaled = np.repeat(omega, stack.sizes)[:, None] * stack.jacobian
    H, f = scaled.T @ stack.jacobian + w * one, scaled.T @ stack.targets
    if towards is not None:
        rest = array("towards", towards, 1)
        fit("towards", rest, (stack.n,))
        f += w * rest
    if regularise != "none":
        H += w * mass.T @ mass
        f -= w * mass.T @ (stack.bias * (regularise == "torque"))
    left = impose_equations(*rows_of(stack.n, rows, rows_lower, rows_upper))
    sides = np.vstack([one, mass, left.rows])
    lower = np.concatenate([ql, tl - stack.bias, left.lower])
    upper = np.concatenate([qu, tu - stack.bias, left.upper])
    if left.N.shape[1] == stack.n:
        qdd = bounded_values(H, f, sides, lower, upper)
    else:
        x, N, moved = left.x, left.N, sides @ left.x
        within = normalised(sides @ N, lower - moved, upper - moved)
        qdd = x + N @ bounded_values(N.T @ H @ N, N.T @ (f - H @ x), *within)
    return qdd, mass @ qdd + stack.bias
