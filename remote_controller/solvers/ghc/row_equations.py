"""Limits of q̈, τ and rows of q̈ for `hqp` and `weighted`: what equations among them leave."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.errors import BadProblemError, InfeasibleError

Array = NDArray[np.float64]

DEPENDENT = 1e-9  # of a singular value, or the length, of unit rows: less is rounding
MISSED = 1e-9  # of 1 + |bound|: an equation or a bound that is missed by less holds


class Limits(NamedTuple):
    """Limits of q̈, τ = M q̈ + h, and R q̈; ∓inf where there is none.

    Attributes:
        qdd_lower, qdd_upper: of q̈, (n,).
        tau_lower, tau_upper: of τ, (n,).
        rows: R, (s, n), (13c).
        rows_lower, rows_upper: (s,); equal ones make an equation.
    """

    qdd_lower: Array
    qdd_upper: Array
    tau_lower: Array
    tau_upper: Array
    rows: Array
    rows_lower: Array
    rows_upper: Array


class Left(NamedTuple):
    """All q̈ = x + N z that satisfy the equations, and the limits that are none, as rows of q̈.

    Attributes:
        x: the shortest such q̈, (n,); 0 without equations.
        N: orthonormal columns that the equations annihilate, (n, n − rank); I without equations.
        rows, lower, upper: rows, (s′, n), and their bounds, (s′,).
    """

    x: Array
    N: Array
    rows: Array
    lower: Array
    upper: Array


def rows_of_limits(mass: Array, bias: Array, limits: Limits) -> Left:
    """Write all limits as rows of q̈, and impose the equations among the given rows.

    Args:
        mass, bias: M, (n, n), and h, (n,), finite.
        limits: with finite rows.

    Raises:
        InfeasibleError: a lower limit is above an upper one, equations contradict each other, or a
            row of zeros has a bound that excludes 0.
        BadProblemError: a limit is NaN, or infinite on the wrong side.
    """
    least = np.concatenate([limits.qdd_lower, limits.tau_lower, limits.rows_lower])
    most = np.concatenate([limits.qdd_upper, limits.tau_upper, limits.rows_upper])
    if not ((least < np.inf) & (most > -np.inf)).all():
        raise BadProblemError("limits must be numbers, or ∓inf for none.")
    if (least > most).any():
        raise InfeasibleError("a lower limit is above the upper one.")
    left = impose_equations(limits.rows, limits.rows_lower, limits.rows_upper)
    lower = np.concatenate([limits.qdd_lower, limits.tau_lower - bias, left.lower])
    upper = np.concatenate([limits.qdd_upper, limits.tau_upper - bias, left.upper])
    rows = np.vstack([np.eye(len(bias)), mass, left.rows])
    return Left(left.x, left.N, rows, lower, upper)


def check_finite(*arrays: Array) -> None:
    """Refuse what is not finite.

    Raises:
        BadProblemError: an array is not.
    """
    if not all(np.isfinite(each).all() for each in arrays):
        raise BadProblemError("tasks, rows and dynamics must be finite.")


def impose_equations(rows: Array, lower: Array, upper: Array) -> Left:
    """Satisfy the rows with equal bounds by a singular value decomposition, E = U Σ Vᵀ.

    Raises:
        InfeasibleError: they contradict each other, or a row of zeros has a bound that excludes 0.
    """
    largest = np.abs(rows).max(axis=1, initial=0.0)
    largest[largest == 0.0] = 1.0
    unit = rows / largest[:, None]
    length = np.linalg.norm(unit, axis=1)
    length[length == 0.0] = 1.0
    unit = unit / length[:, None]
    least, most = lower / largest / length, upper / largest / length
    equal, n = least == most, rows.shape[1]
    if not equal.any():
        return Left(np.zeros(n), np.eye(n), unit, least, most)
    E, e = unit[equal], most[equal]
    U, s, Vt = np.linalg.svd(E)
    rank = int((s > DEPENDENT).sum())
    x: Array = Vt[:rank].T @ ((U.T @ e)[:rank] / s[:rank])
    if (np.abs(E @ x - e) > MISSED * (1.0 + np.abs(e))).any():
        raise InfeasibleError(
            "equations among the rows contradict each other; change their bounds."
        )
    return Left(x, Vt[rank:].T, unit[~equal], least[~equal], most[~equal])


def normalised(rows: Array, lower: Array, upper: Array) -> tuple[Array, Array, Array]:
    """Unit rows and their bounds, without those of next to no length.

    Raises:
        InfeasibleError: a bound of one of these excludes 0.
    """
    length = np.linalg.norm(rows, axis=1)
    kept = length > DEPENDENT
    beyond = np.maximum(lower[~kept], -upper[~kept])
    if (beyond > MISSED * (1.0 + np.abs(beyond))).any():
        raise InfeasibleError("no acceleration that the equations leave satisfies the bounds.")
    return (
        rows[kept] / length[kept, None],
        lower[kept] / length[kept],
        upper[kept] / length[kept],
    )
