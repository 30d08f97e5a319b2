"""The general problem (3) for everything but loops: one call, with errors instead of statuses."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hoap3.protocol.errors import BadProblemError, InfeasibleError
from hoap3.remote_controller.solvers.base import status
from hoap3.remote_controller.solvers.base.validation import array, number
from hoap3.remote_controller.solvers.lyapunov_qp.stable_qp import StableQp

Array = NDArray[np.float64]

ANSWERED = (status.OK, status.STATIONARY, status.CANNOT_DESCEND, status.DESCENDS_FASTER)
RATE_ERROR = 1e-8  # relative: what the decrease of an answer may be off
SPEED_ERROR = 1e-12  # of each speed and its unit: what the solver rounds to, also where V rests


def lyapunov_qp(
    gradient: ArrayLike,
    decrease: float,
    gamma: float,
    A: ArrayLike | None = None,
    b: ArrayLike | None = None,
    lower: ArrayLike | None = None,
    upper: ArrayLike | None = None,
    *,
    C: ArrayLike | None = None,
    c: ArrayLike | None = None,
    weights: ArrayLike | None = None,
) -> Array:
    """Solve (3) with QP12's objective, for exactly that decrease of V.

    Args:
        gradient: ∇V, (n,).
        decrease: −V̇ to be reached, such as `feasible_rate(…)·Ψ`.
        gamma: 0 (even) to 1 (sparse; 1 − γ counts as 1e-6 at least).
        A: rows of A u ≤ b, (m, n); none by default.
        b: (m,), inf switches a row off.
        lower: of u, (n,); none by default.
        upper: of u, (n,); none by default.
        C: rows of C u = c, (k, n); none by default.
        c: (k,).
        weights: of the joints, (n,), positive; all 1 by default.

    Returns:
        u, (n,). At the largest decrease that is feasible, V may fall by 1e-9 of it less.

    Raises:
        InfeasibleError: no u does all that.
        BadProblemError: wrong shape, something not finite, γ outside [0, 1], or no answer found.
    """
    slope, rest = _arrays(gradient, A, b, lower, upper, C, c)
    wanted = number("decrease", decrease)
    solver = StableQp(slope.size, rest[0].shape[0], rest[4].shape[0], gamma=gamma, weights=weights)
    found = solver.solve(slope, 0.0, wanted, *rest)
    error = SPEED_ERROR * float(np.abs(slope) @ (1.0 + np.abs(solver.u)))
    if found == status.INFEASIBLE_CONSTRAINTS:
        raise InfeasibleError("the constraints contradict each other: no input keeps them all.")
    if found == status.ZERO_GRADIENT:
        raise InfeasibleError(
            f"decrease: the gradient is 0, so no input changes V (found {wanted}). Pass 0."
        )
    if found in ANSWERED and abs(solver.rate) > RATE_ERROR * abs(wanted) + error:
        most, least = f"{wanted - solver.rate:.9g}", f"{wanted:.9g}"
        limit = f"at most {most}" if solver.rate > 0.0 else f"at least {most}"
        raise InfeasibleError(
            f"decrease: the constraints permit {limit} (found {least}). Pass a decrease in that "
            "range; `feasible_rate` computes the largest share of it."
        )
    _check(found)
    return solver.u


def feasible_rate(
    gradient: ArrayLike,
    psi: float,
    A: ArrayLike | None = None,
    b: ArrayLike | None = None,
    lower: ArrayLike | None = None,
    upper: ArrayLike | None = None,
    *,
    C: ArrayLike | None = None,
    c: ArrayLike | None = None,
    drift: float = 0.0,
) -> float:
    """min(1, ρ*): the largest share of Ψ that the constraints allow, (6) with ρ ≤ 1.

    Args:
        gradient: ∇V, (n,).
        psi: Ψ ≥ 0.
        A: rows of A u ≤ b, (m, n); none by default.
        b: (m,), inf switches a row off.
        lower: of u, (n,); none by default.
        upper: of u, (n,); none by default.
        C: rows of C u = c, (k, n); none by default.
        c: (k,).
        drift: ∂V/∂t, which ∇V·u + ∂V/∂t = −ρΨ has to make up for (18).

    Returns:
        ρ, at most 1, also where the descent is unbounded or nothing is asked for; below 0, down to
        −1e9, where V has to rise.

    Raises:
        InfeasibleError: the constraints contradict each other, or the gradient is zero and the
            drift is not.
        BadProblemError: wrong shape, something not finite, or Ψ negative.
    """
    slope, rest = _arrays(gradient, A, b, lower, upper, C, c)
    solver = StableQp(slope.size, rest[0].shape[0], rest[4].shape[0])
    rate, moved = number("psi", psi), number("drift", drift)
    found, rho = solver.rho_star(slope, rate, moved, *rest)
    if found == status.INFEASIBLE_CONSTRAINTS:
        raise InfeasibleError("ρ: the constraints contradict each other: no input keeps them all.")
    if found == status.ZERO_GRADIENT:
        raise InfeasibleError("ρ: ∇V = 0, so no input makes up for the drift of V.")
    _check(found)
    return rho


def _arrays(
    gradient: ArrayLike,
    A: ArrayLike | None,
    b: ArrayLike | None,
    lower: ArrayLike | None,
    upper: ArrayLike | None,
    C: ArrayLike | None,
    c: ArrayLike | None,
) -> tuple[Array, tuple[Array, Array, Array, Array, Array, Array]]:
    slope = array("gradient", gradient, 1)
    n = slope.size
    return slope, (
        np.zeros((0, n)) if A is None else array("A", A, 2),
        np.zeros(0) if b is None else array("b", b, 1),
        np.full(n, -np.inf) if lower is None else array("lower", lower, 1),
        np.full(n, np.inf) if upper is None else array("upper", upper, 1),
        np.zeros((0, n)) if C is None else array("C", C, 2),
        np.zeros(0) if c is None else array("c", c, 1),
    )


def _check(found: int) -> None:
    if found in (status.BAD_INPUT, status.BAD_SHAPE, status.OUT_OF_RANGE, status.UNSOLVED):
        raise BadProblemError(
            f"stable QP: {status.NAMES[found]}. All arrays must fit the n joints of the gradient; "
            "gradient, Ψ ≥ 0, decrease and rows that are switched on must be finite, lower ≤ upper."
        )
