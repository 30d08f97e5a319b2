"""The weighting strategy: tasks share one acceleration, in proportion to their weights.

Liu, Tan and Padois, Autonomous Robots 2015, (12): never exactly strict, a baseline for `Ghc`.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.errors import InfeasibleError, SolverError
from hoap3.remote_controller.solvers.base.status import INFEASIBLE, OK
from hoap3.remote_controller.solvers.ghc.row_equations import (
    Limits,
    check_finite,
    normalised,
    rows_of_limits,
)
from hoap3.remote_controller.solvers.qp.active_set import solve_bounded

Array = NDArray[np.float64]


def bounded_values(H: Array, f: Array, rows: Array, lower: Array, upper: Array) -> Array:
    """The x of `solve_bounded`.

    Raises:
        InfeasibleError: no x satisfies the bounds.
        SolverError: H is not definite, or something is not finite.
    """
    status, x, _ = solve_bounded(H, f, rows, lower, upper)
    if status == INFEASIBLE:
        raise InfeasibleError("no acceleration satisfies the bounds; widen them.")
    if status != OK:
        raise SolverError(f"the quadratic program has no answer (status {status}).")
    return x


def weighted(
    jacobian: Array,
    targets: Array,
    sizes: Sequence[int],
    weights: Array,
    mass: Array,
    bias: Array,
    w_r: float,
    limits: Limits,
    *,
    regularise: str,
    towards: Array,
) -> tuple[Array, Array]:
    """Min Σ ω_i |J_i q̈ − b_i|² + ω_r |q̈ − r|² + ω_r |τ − o|² within limits, τ = M q̈ + h.

    Args:
        jacobian, targets, sizes, mass, bias, limits: as for `hqp`.
        weights: ω_i of the tasks, (k,), not negative.
        w_r: ω_r, positive.
        regularise: "torque" |τ|², "gravity_compensated" |τ − h|², or "none".
        towards: r, (n,); 0 in the paper.

    Returns:
        q̈ and τ, (n,).

    Raises:
        InfeasibleError: nothing satisfies the limits.
        SolverError: a value is not finite.
    """
    check_finite(jacobian, targets, mass, bias, limits.rows)
    scaled = np.repeat(weights, sizes)[:, None] * jacobian
    H, f = scaled.T @ jacobian + w_r * np.eye(len(bias)), scaled.T @ targets
    f += w_r * towards
    if regularise != "none":
        H += w_r * mass.T @ mass
        f -= w_r * mass.T @ (bias * (regularise == "torque"))
    x, N, sides, lower, upper = rows_of_limits(mass, bias, limits)
    if N.shape[1] == len(bias):
        qdd = bounded_values(H, f, sides, lower, upper)
    else:
        moved = sides @ x
        within = normalised(sides @ N, lower - moved, upper - moved)
        qdd = x + N @ bounded_values(N.T @ H @ N, N.T @ (f - H @ x), *within)
    return qdd, mass @ qdd + bias
