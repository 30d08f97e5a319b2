"""Rows of a QP without what they have along another one, which is an equation.

Where s·x = r, a row a·x ≤ b says as much as λ(a − μs)·x ≤ λ(b − μr), for any μ and any λ > 0. With
μ = a·s/s·s it is orthogonal to s. Of a row that is nearly parallel to s that leaves the little that
matters, and λ makes it as long as it was: the solver need not find it in the difference of two
large numbers.
"""

from __future__ import annotations

import math

from hoap3.protocol.runtime.numba_jit import Matrix, Vector, kernel
from hoap3.remote_controller.solvers.lyapunov_qp.lyapunov_qp_kernels import NO_BOUND

PARALLEL = 1e-13  # of a row's length: what is left of it is rounding


@kernel()
def across_kernel(
    place: int,
    r: float,
    rows: Matrix,
    least: Vector,
    most: Vector,
    turns: Matrix,
    turned: Matrix,
    turned_least: Vector,
    turned_most: Vector,
) -> None:
    """Write the first rows anew, and copy all others.

    A multiplier of the new row counts λ times for the old one, and −λμ times as well for s.

    Args:
        place: of s among the rows.
        r: s·x.
        rows: (m, v).
        least: of the variables and the rows, (v + m,).
        most: likewise.
        turns: where to write λ and μ, 1 and 0 for s itself, of as many rows, the first ones, as
            shall be turned, (m, 2) or shorter.
        turned: where to write the rows, (m, v).
        turned_least: where to write their limits, behind the variables' own, (v + m,).
        turned_most: likewise.
    """
    count, v = rows.shape
    s, square = rows[place], 0.0
    for i in range(v):
        square += s[i] * s[i]
    for i in range(least.size):
        turned_least[i], turned_most[i] = least[i], most[i]
    for j in range(count):
        a, scale, mu = rows[j], 1.0, 0.0
        if j < turns.shape[0] and j != place:
            along, length, left = 0.0, 0.0, 0.0
            for i in range(v):
                along += a[i] * s[i]
                length += a[i] * a[i]
            mu = along / square
            for i in range(v):
                left += (a[i] - mu * s[i]) ** 2
            if left > PARALLEL * PARALLEL * length:
                scale = math.sqrt(length / left)
            if least[v + j] > -NO_BOUND:
                turned_least[v + j] = scale * (least[v + j] - mu * r)
            if most[v + j] < NO_BOUND:
                turned_most[v + j] = scale * (most[v + j] - mu * r)
        if j < turns.shape[0]:
            turns[j, 0], turns[j, 1] = scale, mu
        for i in range(v):
            turned[j, i] = scale * (a[i] - mu * s[i])
