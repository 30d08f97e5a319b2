"""A dual active set for bounds: the point nearest to the free optimum that satisfies them.

    min ½|y|²   subject to   lower ≤ v + Zᵀy ≤ upper

Goldfarb and Idnani (Mathematical Programming 1983), in the coordinates in which the Hessian is I:
each bounded value v_j has its normal Z[:, j]. Adding a bound reflects the rows of Z (Householder),
dropping one rotates them (Givens), so that the normals of the active ones are always a triangle;
all values move with the steps, and none is ever computed anew. In the paper's symbols, with n⁺ the
normal that is added and z the part of it that the active ones leave free,

    share = u,   own = u⁺,   ratio = r,   speed = Zᵀz,   tail = zᵀn⁺ = |z|²,
    until = t₁ (a share reaches 0),   full = t₂ (the bound is reached),   stride = t.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from hoap3.protocol.runtime.numba_jit import Indices, Matrix, Vector, inlined, kernel
from hoap3.remote_controller.solvers.base.status import BAD_INPUT, INFEASIBLE, OK, UNSOLVED
from hoap3.remote_controller.solvers.linalg.dense_kernels import (
    add,
    add_rows,
    dot,
    not_finite,
    rotate,
    solve_lower,
    solve_upper,
)
from hoap3.remote_controller.solvers.linalg.tiled_product_kernels import factorise, triangular_solve

VIOLATED = 1e-9  # of 1 + |bound|: less is rounding
DEPENDENT = 1e-10  # of a normal: less than that of it left outside the active ones is rounding
BLOCKING = 1e-11  # of a normal: a share of an active one in it that is rounding
ROUNDS = 20  # additions and droppings for each variable and each value: far more than are needed


class Values(NamedTuple):
    """Values v + Zᵀy, (c,), and what bounds them.

    Attributes:
        Z: the normal of each value in its column, (n, c).
        values: v, those at y = 0, (c,).
        lower: (c,), −inf where there is none.
        upper: (c,), inf where there is none.
        multipliers: μ, (c,): y = −Z·μ, so μ_j > 0 where the upper bound holds a value back.
    """

    Z: Matrix
    values: Vector
    lower: Vector
    upper: Vector
    multipliers: Vector


class Scratch(NamedTuple):
    """What the dual active set keeps of its active bounds, the first so many that are counted.

    Attributes:
        R: the triangle of their normals N, Q·N = [Rᵀ; 0], (n, n): row p is the p-th of them,
            rotated by Q, which is never formed: Z is rotated alike.
        share: |μ| of each, (n,).
        length: |normal| of each, (n,).
        sign: 1 where the lower bound is active, −1 where the upper one is, (n,).
        normal: of the bound that is added, rotated by Q, (n,).
        ratio: Rᵀ·ratio = normal[:count], how fast each share falls on the way to it, (n,).
        speed: Zᵀz, z = normal[count:]: how fast each value moves on that way, (c,).
        active: which values they are, (n,).
        state: of each value whether it is active, (c,).
    """

    R: Matrix
    share: Vector
    length: Vector
    sign: Vector
    normal: Vector
    ratio: Vector
    speed: Vector
    active: Indices
    state: Indices


@inlined
def most_violated(values: Vector, lower: Vector, upper: Vector, state: Indices) -> int:
    """The inactive value that violates its bound most, relative to 1 + |bound|; −1 for none."""
    worst, found = VIOLATED, -1
    for j in range(values.size):
        if state[j]:
            continue
        gap = (lower[j] - values[j]) / (1.0 + abs(lower[j])) if lower[j] > values[j] else 0.0
        if values[j] > upper[j]:
            gap = (values[j] - upper[j]) / (1.0 + abs(upper[j]))
        if gap > worst:
            worst, found = gap, j
    return found


@inlined
def _drop(p: int, count: int, Z: Matrix, scratch: Scratch) -> None:
    """Take the p-th active bound out: move up the later rows of R, and rotate (Givens)."""
    R, normal, active = scratch.R, scratch.normal, scratch.active
    share, length, sign = scratch.share, scratch.length, scratch.sign
    for q in range(p, count - 1):
        active[q] = active[q + 1]
        share[q], length[q], sign[q] = share[q + 1], length[q + 1], sign[q + 1]
        for i in range(q + 2):
            R[q, i] = R[q + 1, i]
    for q in range(p, count - 1):
        a, b = R[q, q], R[q, q + 1]
        size = math.hypot(a, b)
        cosine, sine = a / size, b / size
        rotate(Z[q], Z[q + 1], cosine, sine)
        for column in range(q, count - 1):
            a, b = R[column, q], R[column, q + 1]
            R[column, q] = cosine * a + sine * b
            R[column, q + 1] = cosine * b - sine * a
        a, b = normal[q], normal[q + 1]
        normal[q] = cosine * a + sine * b
        normal[q + 1] = cosine * b - sine * a


@inlined
def _reflect(count: int, tail: float, Z: Matrix, normal: Vector, speed: Vector) -> float:
    """Reflect (Householder) the rows of Z from `count` on: a normal has one entry there then.

    I − factor·a aᵀ, a = normal[count:] − entry·e₁ and factor = 2/|a|². Returns the entry.

    `speed` is Σ normal[k]·Z[k] over these rows, `tail` Σ normal[k]²; `speed` is overwritten.
    """
    size, first = math.sqrt(tail), normal[count]
    entry = -math.copysign(size, first)
    factor = 1.0 / (tail + abs(first) * size)
    add(speed, -entry, Z[count])  # aᵀZ
    add(Z[count], -factor * (first - entry), speed)
    for k in range(count + 1, normal.size):
        add(Z[k], -factor * normal[k], speed)
    return entry


@inlined
def _first_to_go(count: int, size: float, scratch: Scratch) -> tuple[int, float]:
    """The active bound that lets go first on the way to the new one, −1 for none; after how much.

    Writes the ratio, what of the normal lies along each active one: Rᵀ·ratio = normal[:count], by
    back substitution.
    """
    R, share, length = scratch.R, scratch.share, scratch.length
    normal, ratio = scratch.normal, scratch.ratio
    for p in range(count):
        ratio[p] = normal[p]
    for back in range(count):
        p = count - 1 - back
        ratio[p] /= R[p, p]
        add(ratio[:p], -ratio[p], R[p, :p])
    blocking, until = -1, math.inf
    for p in range(count):
        if ratio[p] * length[p] > BLOCKING * size and share[p] < until * ratio[p]:
            until, blocking = share[p] / ratio[p], p
    return blocking, until


@kernel(superwords=True)
def active_set(  # noqa: PLR0912 - one loop inside the other, as in the paper
    bounded: Values, scratch: Scratch
) -> tuple[int, int, int]:
    """Move the values until all are within their bounds; lower ≤ upper, which is not checked.

    In every round, with the Z and v that were given, y = Σ share·sign·Z[:, active] (and
    own·side·Z[:, j] of the added one), values = v + Zᵀy, and Q·N = [Rᵀ; 0]. A value whose bounds
    are equal has one of them active at a time, like any other.

    Args:
        bounded: Z is overwritten; the values by those of the answer; the multipliers are written,
            for the Z that was given. Where the status is not `OK` the values are those of the last
            step and the multipliers 0.
        scratch: may hold anything.

    Returns:
        `OK`, `INFEASIBLE` or `UNSOLVED`; number of active bounds; of steps.
    """
    Z, values, lower, upper, multipliers = bounded
    R, share, length, sign, normal, ratio, speed, active, state = scratch
    n, c = Z.shape
    count, rounds = 0, 0
    for j in range(c):
        state[j] = 0
        multipliers[j] = 0.0
    while True:
        j = most_violated(values, lower, upper, state)
        if j < 0:
            break
        side = -1.0 if values[j] > upper[j] else 1.0
        bound = upper[j] if side < 0.0 else lower[j]
        for k in range(n):
            normal[k] = side * Z[k, j]
        whole, own = dot(normal, normal), 0.0  # |n⁺|²; the share of the bound that is added
        size = math.sqrt(whole)
        while True:
            rounds += 1
            if rounds > ROUNDS * (n + c):
                return UNSOLVED, count, rounds
            blocking, until = _first_to_go(count, size, scratch)
            tail = dot(normal[count:], normal[count:])
            free = count < n and tail > DEPENDENT * DEPENDENT * whole
            full = math.inf
            if free:
                for i in range(c):
                    speed[i] = 0.0
                add_rows(speed, normal, Z, count, n, 0)
                full = max(side * (bound - values[j]), 0.0) / tail
            elif blocking < 0:
                return INFEASIBLE, count, rounds
            stride = min(until, full)
            if free:
                add(values, stride, speed)
            for p in range(count):
                share[p] = max(share[p] - stride * ratio[p], 0.0)
            own += stride
            if full <= until:
                entry = _reflect(count, tail, Z, normal, speed)
                for p in range(count):
                    R[count, p] = normal[p]
                R[count, count] = entry
                share[count], length[count], sign[count] = own, size, side
                active[count], state[j] = j, 1
                values[j] = bound
                count += 1
                break
            state[active[blocking]] = 0
            _drop(blocking, count, Z, scratch)
            count -= 1
    for p in range(count):
        multipliers[active[p]] = -sign[p] * share[p]
    return OK, count, rounds


@kernel(superwords=True, allocates=True)
def bounded_values_kernel(
    H: Matrix,
    f: Vector,
    rows: Matrix,
    lower: Vector,
    upper: Vector,
    Z: Matrix,
    R: Matrix,
    values: Vector,
    multipliers: Vector,
) -> tuple[int, int]:
    """Minimise ½ xᵀHx − fᵀx such that lower ≤ V x + offset ≤ upper; x are the first values.

    With H = UᵀU and x₀ = H⁻¹f, x = x₀ + U⁻¹y: ½|y|² is left, and the normals are Z = U⁻ᵀ[I | Vᵀ].
    lower ≤ upper, which is not checked. Here c counts rows, and n + c values.

    Args:
        H: positive definite, (n, n); overwritten.
        f: (n,); overwritten.
        rows: V, (c, n).
        lower, upper: (c,).
        Z, R: scratch, (n, n + c) and (n, n).
        values: (n + c,): 0 and the offsets; overwritten by x and V x + offset.
        multipliers: of x (0) and the rows, (n + c,), written.

    Returns:
        Status and number of active bounds.
    """
    c, n = rows.shape
    scratch = np.empty(n)
    least, most = np.full(n + c, -math.inf), np.full(n + c, math.inf)
    for k in range(n):
        if not_finite(H[k]):
            return BAD_INPUT, 0
    for j in range(c):
        if not_finite(rows[j]) or not (lower[j] < math.inf and upper[j] > -math.inf):
            return BAD_INPUT, 0
        least[n + j], most[n + j] = lower[j], upper[j]
    if not_finite(f) or not_finite(values):
        return BAD_INPUT, 0
    if factorise(H, n, 0.0, scratch) < n:
        return BAD_INPUT, 0
    solve_lower(H, f)
    solve_upper(H, f)
    for k in range(n):
        values[k] = f[k]
        for i in range(n):
            Z[k, i] = 1.0 if i == k else 0.0
        for j in range(c):
            Z[k, n + j] = rows[j, k]
    for j in range(c):
        values[n + j] += dot(rows[j], f)
    triangular_solve(H, Z)
    vectors, speed = np.empty((5, n)), np.empty(n + c)
    share, length, sign = vectors[0], vectors[1], vectors[2]
    normal, ratio = vectors[3], vectors[4]
    active, state = np.empty(n, np.int64), np.empty(n + c, np.int64)
    status, count, _ = active_set(
        Values(Z, values, least, most, multipliers),
        Scratch(R, share, length, sign, normal, ratio, speed, active, state),
    )
    return status, count
