"""Rows of (13c), lower ≤ R q̈ ≤ upper, beside the bounds of q̈ and τ.

Every bounded value is linear in the unknown y of the condensed problem, v_j + z_jᵀy, and row j has
v_j = r_j·q₀ and z_j = U r_j. Rows are taken as r_j/|r_j|, so that their units do not matter.

**Equations** (lower = upper) are imposed one after the other before anything is optimised. With
e = z_j/|z_j| and t = (b_j − v_j)/|z_j|,

    y = t e + y′,  e·y′ = 0:    v ← v + t Zᵀe,   Z ← (I − eeᵀ) Z,   |y|² = t² + |y′|²

is a problem of the same form in y′, in which nothing moves the equation any more. Stationarity,
y + U (g + Σ ρ_j r_j) = 0 with g what all others pull, gives their multipliers backwards: along e_k
it reads t_k + p_k·(g + Σ_{j>k} ρ_j r_j) + ρ_k |z_k| = 0, p_k = Uᵀe_k. U and g are those of
`ghc_kernels`; `row_equations` is the reference of the elimination, in plain numpy.
"""

from __future__ import annotations

import math

from hoap3.protocol.runtime.numba_jit import Matrix, Vector, inlined, kernel
from hoap3.remote_controller.solvers.linalg.dense_kernels import add, add_rows, dot

DEPENDENT = 1e-10  # of a normal: less than that of it left beside the equations is rounding
MISSED = 1e-9  # of 1 + |b|: an equation that nothing moves and that misses b by less holds


@inlined
def scale_rows(rows: Matrix, bounds: Matrix, units: Matrix, lengths: Vector, out: Matrix) -> None:
    """Write r_j/|r_j|, |r_j| (1 for a row of zeros) and the bounds with those of rows over |r_j|.

    The last so many bounds as there are rows are theirs.
    """
    s, n = rows.shape
    first = bounds.shape[1] - s
    for j in range(first):
        out[0, j], out[1, j] = bounds[0, j], bounds[1, j]
    for j in range(s):
        top = 0.0
        for i in range(n):
            top = max(top, abs(rows[j, i]))
        top = top if top > 0.0 else 1.0
        for i in range(n):
            units[j, i] = rows[j, i] / top
        length = math.sqrt(dot(units[j], units[j]))
        length = length if length > 0.0 else 1.0
        for i in range(n):
            units[j, i] /= length
        lengths[j] = top * length
        out[0, first + j] = bounds[0, first + j] / top / length
        out[1, first + j] = bounds[1, first + j] / top / length


@inlined
def has_equations(bounds: Matrix, first: int) -> bool:
    """Whether a bound from the first on has equal sides."""
    found = False
    for j in range(first, bounds.shape[1]):
        found = found or bounds[0, j] == bounds[1, j]
    return found


@inlined
def hold_equations(values: Vector, bounds: Matrix, first: int) -> None:
    """Give those of the values from the first on that are equations exactly what they must be."""
    for j in range(first, values.size):
        if bounds[0, j] == bounds[1, j]:
            values[j] = bounds[0, j]


@inlined
def row_normals(units: Matrix, U: Matrix, least: float, Z: Matrix) -> None:
    """Write U r_j into the last columns of Z; 0 where r_jᵀS r_j is up to `least`, as in S."""
    (s, n), first = units.shape, Z.shape[1] - units.shape[0]
    for j in range(s):
        squared = 0.0
        for k in range(n):
            Z[k, first + j] = dot(U[k], units[j])
            squared += Z[k, first + j] * Z[k, first + j]
        if squared <= least:
            for k in range(n):
                Z[k, first + j] = 0.0


@inlined
def _column_squares(Z: Matrix, out: Vector) -> None:
    for j in range(out.size):
        out[j] = 0.0
    for k in range(Z.shape[0]):
        for j in range(out.size):
            out[j] += Z[k, j] * Z[k, j]


@kernel(superwords=True)
def impose_equations(  # noqa: PLR0912 - Gram and Schmidt with what it moves
    Z: Matrix,
    values: Vector,
    bounds: Matrix,
    directions: Matrix,
    motions: Matrix,
    shifts: Vector,
    sizes: Vector,
    scratch: Matrix,
) -> int:
    """Move the values onto the equations, and take from Z what would move them off.

    Args:
        Z: normals of all values, (n, c); overwritten by what the equations leave of them.
        values: (c,), overwritten.
        bounds: lower and upper ones, (2, c).
        directions: e_k of the last s values, (s, n), written.
        motions: p_k, (s, n), written.
        shifts: t_k, (s,), written.
        sizes: |z_k|, (s,), written; 0 where a row is no equation or follows from those before it.
        scratch: (2, c).

    Returns:
        How many are imposed; −1 where two contradict each other, or one is outside what y moves.
    """
    (n, c), s = Z.shape, sizes.size
    whole, path, imposed = scratch[0], scratch[1], 0
    _column_squares(Z, whole)
    for k in range(s):
        j, e = c - s + k, directions[k]
        shifts[k], sizes[k] = 0.0, 0.0
        bound = bounds[0, j]
        if bound != bounds[1, j]:
            continue
        for i in range(n):
            e[i] = Z[i, j]
        if dot(e, e) <= DEPENDENT * DEPENDENT * whole[j]:
            if abs(values[j] - bound) > MISSED * (1.0 + abs(bound)):
                return -1
            continue
        for p in range(k):  # Gram and Schmidt once more
            if sizes[p] > 0.0:
                add(e, -dot(e, directions[p]), directions[p])
        size = math.sqrt(dot(e, e))
        for i in range(n):
            e[i] /= size
        for i in range(c):
            path[i] = 0.0
        add_rows(path, e, Z, 0, n, 0)
        shifts[k], sizes[k] = (bound - values[j]) / size, size
        add(values, shifts[k], path)
        for i in range(n):
            motions[k, i] = path[i]
            add(Z[i], -e[i], path)
        imposed += 1
    _column_squares(Z, path)
    for j in range(c):
        if path[j] <= DEPENDENT * DEPENDENT * whole[j]:
            for i in range(n):
                Z[i, j] = 0.0
    return imposed


@inlined
def equation_multipliers(
    units: Matrix, motions: Matrix, shifts: Vector, sizes: Vector, g: Vector, multipliers: Vector
) -> None:
    """Write ρ_k of the imposed equations, the last one first; g becomes g + Σ ρ_k r_k."""
    s = units.shape[0]
    for back in range(s):
        k = s - 1 - back
        if sizes[k] > 0.0:
            multipliers[k] = -(shifts[k] + dot(motions[k], g)) / sizes[k]
            add(g, multipliers[k], units[k])
