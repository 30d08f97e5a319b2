"""Strict levels one after the other: the null-space cascade, damped, within bounds.

The hierarchical baseline of Liu, Tan and Padois, Autonomous Robots 2015, section 6. Each level does
what it can in least squares within what the levels above leave, so below the first it does more
than `ghc` does in one tick. It knows strict levels only, and where they change it jumps.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import accumulate

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hoap3.protocol.errors import BadProblemError
from hoap3.remote_controller.solvers.base.task_validation import Stack, bounds_of, rows_of, stacked
from hoap3.remote_controller.solvers.base.validation import number
from hoap3.remote_controller.solvers.ghc.row_equations import impose_equations, normalised
from hoap3.remote_controller.solvers.ghc.weighted import bounded_values

Array = NDArray[np.float64]

RANK_TOLERANCE = 1e-9  # of the largest singular value of a level, within what is left
SLACK = 1e-8  # by which bounds give way below the first level, which has met some of them exactly


def hqp(
    jacobians: Sequence[ArrayLike],
    targets: Sequence[ArrayLike],
    M: ArrayLike,
    bias: ArrayLike,
    w_r: float,
    *,
    levels: Sequence[Sequence[int]] | None = None,
    qdd_lower: ArrayLike | None = None,
    qdd_upper: ArrayLike | None = None,
    tau_lower: ArrayLike | None = None,
    tau_upper: ArrayLike | None = None,
    rows: ArrayLike | None = None,
    rows_lower: ArrayLike | None = None,
    rows_upper: ArrayLike | None = None,
) -> tuple[Array, Array]:
    """The cascade: at each level min |J(q̈ + Z z) − b|² + ω_r |z|² within the bounds.

    Args:
        jacobians, targets, M, bias: as for `ghc`.
        w_r: damping ω_r of each level, positive: with next to none of it, tasks in conflict ask
            for accelerations without limit.
        levels: indices of the tasks of each level, highest first; by default every task is a level
            of its own. Tasks that are in none are left out.
        qdd_lower, qdd_upper, tau_lower, tau_upper: bounds, (n,).
        rows, rows_lower, rows_upper: rows of q̈, as for `ghc`; equations stand above all levels.

    Returns:
        q̈ and τ = M q̈ + h, (n,).

    Raises:
        InfeasibleError: nothing satisfies the bounds and rows.
        BadProblemError: wrong shape, a value that is not finite, or levels that name no task or
            one twice.
    """
    stack = stacked("HQP", jacobians, targets, M, bias)
    damping = number("w_r", w_r)
    if not 0.0 < damping < np.inf:
        raise BadProblemError(f"w_r must be positive and finite (found {damping}).")
    order = _levels(levels, len(stack.sizes))
    ql, qu, tl, tu = bounds_of(stack.n, qdd_lower, qdd_upper, tau_lower, tau_upper)
    left = impose_equations(*rows_of(stack.n, rows, rows_lower, rows_upper))
    values = np.vstack([np.eye(stack.n), stack.mass, left.rows])
    lower = np.concatenate([ql, tl - stack.bias, left.lower])
    upper = np.concatenate([qu, tu - stack.bias, left.upper])
    edges = [0, *accumulate(stack.sizes)]
    qdd, Z, slack = left.x, left.N, 0.0
    normalised(values @ Z, lower - values @ qdd, upper - values @ qdd)
    for level in order:
        if not Z.shape[1]:
            break
        mine = np.concatenate([np.arange(edges[i], edges[i + 1]) for i in level])
        J = stack.jacobian[mine]
        qdd = qdd + Z @ _step(
            J @ Z,
            stack.targets[mine] - J @ qdd,
            damping,
            values @ Z,
            lower - slack - values @ qdd,
            upper + slack - values @ qdd,
        )
        Z, slack = Z @ _null_space(J @ Z, J), SLACK
    return qdd, _torque(stack, qdd)


def _torque(stack: Stack, qdd: Array) -> Array:
    found: Array = stack.mass @ qdd + stack.bias
    return found


def _levels(levels: Sequence[Sequence[int]] | None, k: int) -> list[list[int]]:
    found = [[i] for i in range(k)] if levels is None else [list(level) for level in levels]
    named = [i for level in found for i in level]
    if not named or not all(found) or len(set(named)) < len(named):
        raise BadProblemError("levels must be lists of tasks, none empty, each task named once.")
    if not set(named) <= set(range(k)):
        raise BadProblemError(f"levels must name tasks from 0 to {k - 1} (found {named}).")
    return found


def _step(A: Array, e: Array, w: float, rows: Array, lower: Array, upper: Array) -> Array:
    """Min |A z − e|² + w|z|² within lower ≤ rows·z ≤ upper; the rows are normalised for that."""
    H = A.T @ A + w * np.eye(A.shape[1])
    length = np.linalg.norm(rows, axis=1)
    kept = length > RANK_TOLERANCE
    unit = rows[kept] / length[kept, None]
    return bounded_values(H, A.T @ e, unit, lower[kept] / length[kept], upper[kept] / length[kept])


def _null_space(A: Array, J: Array) -> Array:
    """Orthonormal columns that A annihilates, up to a tolerance relative to J."""
    _, s, Vt = np.linalg.svd(A)
    size = float(np.linalg.norm(J, 2))
    rank = int((s > RANK_TOLERANCE * max(size, 1e-300)).sum())
    found: Array = Vt[rank:].T
    return found
