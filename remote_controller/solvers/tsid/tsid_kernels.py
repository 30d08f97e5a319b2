"""Compiled: the QP of task-space inverse dynamics, laid out and proved.

Del Prete, IEEE RA-L 2018, (33), with the torques eliminated.
"""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.runtime.numba_jit import Matrix, Vector, inlined, kernel

Senses = Annotated[NDArray[np.int32], "i4[::1]"]

EQUATION = 5  # daqp's word for it
NONE = 1e30  # daqp's infinity
SAME = 1e-13  # of a bound: bounds as near as that are one
TINY = 1e-9  # rad/s²: accelerations below it count as that much


@kernel()
def lay_out(
    jacobian: Matrix,
    wanted: Vector,
    weight: float,
    posture: Vector,
    bias: Vector,
    effort: Vector,
    lower: Vector,
    upper: Vector,
    rows_lower: Vector,
    rows_upper: Vector,
    H_out: Matrix,
    f_out: Vector,
    least_out: Vector,
    most_out: Vector,
    sense_out: Senses,
) -> None:
    """Write H = JᵀJ + w·I, f = −Jᵀy − w·p, and the bounds of ddq, M·ddq and R·ddq.

    Args:
        jacobian: J (m, n).
        wanted: y (m,), what J·ddq shall be.
        weight: w.
        posture: p (n,), what ddq shall be.
        bias, effort: h and the greatest torques, (n,).
        lower, upper: of ddq, (n,).
        rows_lower, rows_upper: of R·ddq, (s,).
        H_out, f_out: (n, n) and (n,).
        least_out, most_out, sense_out: (2n + s,).
    """
    m, n = jacobian.shape
    for i in range(n):
        pull = weight * posture[i]
        for k in range(m):
            pull += jacobian[k, i] * wanted[k]
        f_out[i] = -pull
        for j in range(i + 1):
            value = weight if i == j else 0.0
            for k in range(m):
                value += jacobian[k, i] * jacobian[k, j]
            H_out[i, j] = value
            H_out[j, i] = value
        least_out[i], most_out[i] = lower[i], upper[i]
        one = upper[i] - lower[i] <= SAME * max(abs(lower[i]), abs(upper[i]))
        sense_out[i] = EQUATION if one else 0
        if one:
            least_out[i] = most_out[i]
        least_out[n + i], most_out[n + i] = -effort[i] - bias[i], effort[i] - bias[i]
    for k in range(rows_lower.size):
        least, most, at = max(rows_lower[k], -NONE), min(rows_upper[k], NONE), 2 * n + k
        one = abs(most - least) <= SAME * max(abs(least), abs(most))
        least_out[at], most_out[at] = most if one else least, most
        sense_out[at] = EQUATION if one else 0


@inlined
def _away(value: float, pull: float, least: float, most: float) -> float:
    """How far a value is from its best within its bounds, if it would rather move by `pull`."""
    return abs(value - min(max(value + pull, least), most))


@kernel()
def prove(
    x: Vector,
    multipliers: Vector,
    H: Matrix,
    f: Vector,
    mass: Matrix,
    bias: Vector,
    effort: Vector,
    lower: Vector,
    upper: Vector,
    rows: Matrix,
    rows_lower: Vector,
    rows_upper: Vector,
    solved: bool,
    ddq_out: Vector,
    tau_out: Vector,
) -> float:
    """Write ddq within its bounds and its torques; prove them without any solver's word.

    With the gradient g = H·ddq + f + M·λ + Rᵀ·μ, ddq is optimal if each ddq_i is the point within
    its bounds nearest to ddq_i − g_i/H_ii, each torque that nearest to τ_j + λ_j·M_jj²/H_jj, and
    each value of a row that nearest to R_k·ddq + μ_k·Σ R_ki²/H_ii. The residual is the largest
    deviation from that: of ddq relative to the span, max|ddq| or what f asks for; of τ to its
    effort; of R_k·ddq to Σ|R_ki|·span.

    Args:
        x: ddq as solved, (n,).
        multipliers: λ of the torques and μ of the rows, (n + s,).
        H, f: (n, n) and (n,).
        mass, bias, effort: of |M·ddq + h| ≤ effort.
        lower, upper: of ddq.
        rows, rows_lower, rows_upper: of rows_lower ≤ R·ddq ≤ rows_upper, (s, n), (s,) and (s,).
        solved: whether `multipliers` are those of this QP; if not, the residual is inf.
        ddq_out, tau_out: (n,).

    Returns:
        The residual.
    """
    n, s = x.size, rows_lower.size
    span = TINY
    for i in range(n):
        ddq_out[i] = min(max(x[i], lower[i]), upper[i])
        span = max(span, abs(ddq_out[i]), abs(f[i]) / H[i, i])
    worst = 0.0
    for i in range(n):
        tau, gradient = bias[i], f[i]
        for j in range(n):
            tau += mass[i, j] * ddq_out[j]
            gradient += H[i, j] * ddq_out[j] + mass[j, i] * multipliers[j]
        for k in range(s):
            gradient += rows[k, i] * multipliers[n + k]
        tau_out[i] = tau
        step = multipliers[i] * mass[i, i] * mass[i, i] / H[i, i]
        away = _away(ddq_out[i], -gradient / H[i, i], lower[i], upper[i]) / span
        worst = max(worst, away, _away(tau, step, -effort[i], effort[i]) / effort[i])
    for k in range(s):
        value, reach, step = 0.0, TINY * TINY, 0.0
        for i in range(n):
            value += rows[k, i] * ddq_out[i]
            reach += abs(rows[k, i]) * span
            step += multipliers[n + k] * rows[k, i] * rows[k, i] / H[i, i]
        worst = max(worst, _away(value, step, rows_lower[k], rows_upper[k]) / reach)
    if not (solved and worst < math.inf):
        worst = math.inf
    return worst
