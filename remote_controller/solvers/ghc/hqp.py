"""Strict levels one after the other: the null-space cascade, damped, within bounds.

The hierarchical baseline of Liu, Tan and Padois, Autonomous Robots 2015, section 6. Each level does
what it can in least squares within what the levels above leave, so below the first it does more
than `Ghc` does in one tick. It knows strict levels only, and where they change it jumps.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import accumulate

import numpy as np
from numpy.typing import NDArray

from hoap3.remote_controller.solvers.ghc.row_equations import (
    Limits,
    check_finite,
    normalised,
    rows_of_limits,
)
from hoap3.remote_controller.solvers.ghc.weighted import bounded_values

Array = NDArray[np.float64]

RANK_TOLERANCE = 1e-9  # of the largest singular value of a level, within what is left
SLACK = 1e-8  # by which bounds give way below the first level, which has met some of them exactly


def hqp(
    jacobian: Array,
    targets: Array,
    sizes: Sequence[int],
    levels: Sequence[Sequence[int]],
    mass: Array,
    bias: Array,
    w_r: float,
    limits: Limits,
) -> tuple[Array, Array]:
    """The cascade: at each level min |J(q̈ + Z z) − b|² + ω_r |z|² within the bounds.

    Args:
        jacobian: J of all tasks, (m, n).
        targets: desired acceleration of each less its drift J̇ q̇, (m,).
        sizes: rows of each task; m in all.
        levels: indices of the tasks of each level, highest first, each once. Tasks that are in none
            are left out.
        mass: inertia matrix M, (n, n), symmetric.
        bias: Coriolis, centrifugal and gravity torques h, (n,).
        w_r: damping ω_r of each level, positive: with next to none of it, tasks in conflict ask
            for accelerations without limit.
        limits: of q̈, τ and rows of q̈; equations among these stand above all levels.

    Returns:
        q̈ and τ = M q̈ + h, (n,).

    Raises:
        InfeasibleError: nothing satisfies the limits.
        SolverError: a value is not finite.
    """
    check_finite(jacobian, targets, mass, bias, limits.rows)
    qdd, Z, values, lower, upper = rows_of_limits(mass, bias, limits)
    edges, slack = [0, *accumulate(sizes)], 0.0
    normalised(values @ Z, lower - values @ qdd, upper - values @ qdd)
    for level in levels:
        if not Z.shape[1]:
            break
        mine = np.concatenate([np.arange(edges[i], edges[i + 1]) for i in level])
        J = jacobian[mine]
        qdd = qdd + Z @ _step(
            J @ Z,
            targets[mine] - J @ qdd,
            w_r,
            values @ Z,
            lower - slack - values @ qdd,
            upper + slack - values @ qdd,
        )
        Z, slack = Z @ _null_space(J @ Z, J), SLACK
    return qdd, mass @ qdd + bias


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
