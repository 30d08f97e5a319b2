"""Generalized hierarchical control, condensed to the n joint accelerations, in one call.

Liu, Tan and Padois, Autonomous Robots 2015, (13): with x_i for each of the k tasks,

    min Σ |J_i x_i − b_i|² + w Σ |x_i|² + w |τ − o|²
    s.t. τ = M q̈ + n,   q̈ = Σ P_i x_i,   bounds of q̈, τ and R q̈

For a given q̈ the best x_i are known, H_i = J_iᵀJ_i + wI, and what is left is, however many tasks,

    min ½ (q̈ − q₀)ᵀ S⁺ (q̈ − q₀) + w/2 |M q̈ + n − o|²,
    S = Σ P_i H_i⁻¹ P_i,   q₀ = Σ P_i J_iᵀ (J_i J_iᵀ + wI)⁻¹ b_i.

S may be singular and is never inverted: with S = UᵀU and q̈ = q₀ + Uᵀy the unknown is y, and the
Hessian I + w TᵀT, T = M Uᵀ. If its optimum satisfies the bounds, that is the answer; if not,
`active_set` moves from there. q̈, τ and R q̈ are values alike to it; equations among the rows are
imposed before (`row_kernels`).
"""

from __future__ import annotations

import math

from hoap3.protocol.runtime.numba_jit import (
    Cube,
    IndexRows,
    Indices,
    Matrix,
    Vector,
    inlined,
    kernel,
)
from hoap3.remote_controller.solvers.base.status import (
    BAD_INPUT,
    BAD_SHAPE,
    INFEASIBLE,
    OK,
    OUT_OF_RANGE,
    UNSOLVED,
)
from hoap3.remote_controller.solvers.ghc.condense_kernels import condense
from hoap3.remote_controller.solvers.ghc.row_kernels import (
    equation_multipliers,
    has_equations,
    hold_equations,
    impose_equations,
    row_normals,
    scale_rows,
)
from hoap3.remote_controller.solvers.linalg.dense_kernels import (
    MAX,
    add,
    add_rows,
    dot,
    not_finite,
    pivoted_cholesky,
    solve_lower,
    solve_upper,
)
from hoap3.remote_controller.solvers.linalg.tiled_product_kernels import (
    factorise,
    multiply,
    syrk,
    triangular_solve,
)
from hoap3.remote_controller.solvers.qp.active_set_kernels import (
    Scratch,
    Values,
    active_set,
    most_violated,
)

NONE, TORQUE, GRAVITY_COMPENSATED = 0, 1, 2  # what o is: nothing is regularised, 0, n
LEAST_WEIGHT = 1e-8  # of w: 1/w stands beside numbers near 1, and the rounding of both
WELL_APART = 1e-9  # of the diagonal of S: pivots above need no order
ROUNDING = 1e-12  # of what S is a difference from: pivots above are no rounding
SINGULAR = 1e-14  # of the same: a pivot up to that is 0
TOLD_APART = 1e-13  # of a task's |J|²: with less of ω_r, directions of S are cut that matter
SMALLEST = 1e-6  # rad/s²: accelerations below it count as that much


@inlined
def _clear(values: Vector) -> None:
    for j in range(values.size):
        values[j] = 0.0


@inlined
def _times(M: Matrix, x: Vector, out: Vector) -> None:
    for i in range(out.size):
        out[i] = dot(M[i], x)


@inlined
def _torques(M: Matrix, qdd: Vector, bias: Vector, tau: Vector) -> None:
    _times(M, qdd, tau)
    for i in range(tau.size):
        tau[i] += bias[i]


@inlined
def _gather(
    mass: Matrix,
    effort: Vector,
    w: float,
    rows: Matrix,
    multipliers: Vector,
    g: Vector,
    scratch: Vector,
) -> None:
    """Write g = w M·effort + μ + M ν + Rᵀρ, what pulls q̈ away from q₀."""
    n = g.size
    for i in range(n):
        scratch[i] = w * effort[i] + multipliers[n + i]
    _times(mass, scratch, g)
    for i in range(n):
        g[i] += multipliers[i]
    for j in range(rows.shape[0]):
        add(g, multipliers[2 * n + j], rows[j])


@kernel(superwords=True)
def optimality(
    S: Matrix,
    q0: Vector,
    mass: Matrix,
    effort: Vector,
    w: float,
    rows: Matrix,
    values: Vector,
    bounds: Matrix,
    multipliers: Vector,
    g: Vector,
    away: Vector,
) -> float:
    """How far q̈ is from optimal for its multipliers (μ, ν, ρ), for the condensed problem.

    q̈ = q₀ − S(w M·effort + μ + M ν + Rᵀρ), and each value of a multiplier that is not 0 at its
    bound, the others within theirs: the largest deviation, the former relative to max(|q̈|, |q₀|),
    the latter to 1 + |bound|; rows are of unit length. `effort` is what is regularised, τ − o or 0.
    """
    n, lower, upper, span = q0.size, bounds[0], bounds[1], SMALLEST
    _gather(mass, effort, w, rows, multipliers, g, away)
    for i in range(n):
        away[i] = values[i] - q0[i]
        span = max(span, abs(values[i]), abs(q0[i]))
    for i in range(n):
        away[i] += dot(S[i, i:], g[i:])
        add(away[i + 1 :], g[i], S[i, i + 1 :])
    if not_finite(away) or not_finite(values):
        return math.inf
    worst, beyond = 0.0, 0.0
    for i in range(n):
        worst = max(worst, abs(away[i]))
    for j in range(values.size):
        if multipliers[j] > 0.0 or values[j] > upper[j]:
            beyond = max(beyond, abs(values[j] - upper[j]) / (1.0 + abs(upper[j])))
        if multipliers[j] < 0.0 or values[j] < lower[j]:
            beyond = max(beyond, abs(values[j] - lower[j]) / (1.0 + abs(lower[j])))
    found = max(worst / span, beyond)
    return found if found <= MAX else math.inf


@inlined
def _unfit(
    jacobian: Matrix,
    target: Vector,
    alpha: Matrix,
    mass: Matrix,
    bias: Vector,
    rows: Matrix,
    bounds: Matrix,
) -> bool:
    """Whether a value is not finite, a priority outside [0, 1], or a bound on the wrong side."""
    found = not_finite(target) or not_finite(bias)
    for row in range(jacobian.shape[0]):
        found = found or not_finite(jacobian[row])
    for row in range(mass.shape[0]):
        found = found or not_finite(mass[row])
    for row in range(rows.shape[0]):
        found = found or not_finite(rows[row])
    for i in range(alpha.shape[0]):
        for j in range(alpha.shape[1]):
            found = found or not 0.0 <= alpha[i, j] <= 1.0
    for j in range(bounds.shape[1]):
        found = found or not (bounds[0, j] < math.inf and bounds[1, j] > -math.inf)
    return found


@inlined
def _too_stiff(jacobian: Matrix, offsets: Indices, w: float) -> bool:
    """Whether what a task leaves to ω_r is so little of S that rounding hides it."""
    found = False
    for i in range(offsets.size - 1):
        square = 0.0
        for row in range(offsets[i], offsets[i + 1]):
            square += dot(jacobian[row], jacobian[row])
        found = found or w < TOLD_APART * square
    return found


@inlined
def _factor(
    S: Matrix, whole: float, mass: Matrix, U: Matrix, L: Matrix, T: Matrix, scratch: Vector
) -> None:
    """Write U with UᵀU = S, its transpose L, and T = M L."""
    n = S.shape[0]
    for i in range(n):
        for j in range(n):
            U[i, j] = S[i, j] if j >= i else 0.0
    regular = factorise(U, n, WELL_APART, scratch) == n
    for i in range(n):
        regular = regular and U[i, i] * U[i, i] > ROUNDING * whole
    if not regular:
        for i in range(n):
            for j in range(n):
                T[i, j] = S[i, j] if j >= i else S[j, i]
        pivoted_cholesky(T, SINGULAR * whole, U)
    for i in range(n):
        for j in range(n):
            L[j, i] = U[i, j]
    multiply(T, mass, L, regular)


@inlined
def _free_optimum(
    U: Matrix, T: Matrix, w: float, pull: Vector, A: Matrix, y: Vector, scratch: Vector, qdd: Vector
) -> None:
    """Add Uᵀy to q̈ = q₀, with (I + w TᵀT) y = −w Tᵀ·pull and pull = M q₀ + n − o.

    A becomes the factor of that matrix.
    """
    n = qdd.size
    for i in range(n):
        scratch[i] = -w * pull[i]
        for j in range(n):
            A[i, j] = 1.0 if i == j else 0.0
    _clear(y)
    add_rows(y, scratch, T, 0, n, 0)
    syrk(A, w, T, n)
    factorise(A, n, 0.0, scratch)
    solve_lower(A, y)
    solve_upper(A, y)
    add_rows(qdd, y, U, 0, n, 0)


@inlined
def _normals(U: Matrix, T: Matrix, rows: Matrix, least: float, Z: Matrix) -> None:
    """Write the normals of all values, Z = [U | Tᵀ | U Rᵀ]."""
    n = U.shape[0]
    for i in range(n):
        for j in range(n):
            Z[i, j] = U[i, j]
            Z[i, n + j] = T[j, i]
    row_normals(rows, U, least, Z)


@inlined
def _split(Z: Matrix, U: Matrix, T: Matrix) -> None:
    """Write U and T of Z = [U | Tᵀ | U Rᵀ]."""
    n = U.shape[0]
    for i in range(n):
        for j in range(n):
            U[i, j] = Z[i, j]
            T[j, i] = Z[i, n + j]


@inlined
def _values(M: Matrix, bias: Vector, rows: Matrix, values: Vector) -> None:
    """Write τ and R q̈ behind q̈."""
    n = bias.size
    _torques(M, values[:n], bias, values[n : 2 * n])
    _times(rows, values[:n], values[2 * n :])


@kernel(superwords=True)
def ghc_kernel(  # noqa: PLR0912, PLR0915 - one problem from its check to its certificate
    jacobian: Matrix,
    offsets: Indices,
    target: Vector,
    alpha: Matrix,
    mass: Matrix,
    bias: Vector,
    w: float,
    mode: int,
    smoothing: float,
    rows: Matrix,
    bounds: Matrix,
    squares: Cube,
    Z: Matrix,
    vectors: Matrix,
    X: Matrix,
    basis: Matrix,
    K: Matrix,
    diagonals: Matrix,
    scratch: Vector,
    integers: IndexRows,
    row_matrices: Cube,
    row_numbers: Matrix,
    value_numbers: Matrix,
    out: Matrix,
) -> tuple[int, int, int, float]:
    """Solve one problem; `Ghc` describes the arguments and has the shapes of the scratch.

    Args:
        jacobian, offsets, target: (m, n), (k + 1,), (m,).
        alpha, mass, bias: (k, k), (n, n), (n,).
        w, mode, smoothing: ω_r, what is regularised, s₀.
        rows: R, (s, n).
        bounds: lower and upper ones of (q̈, τ, R q̈), (2, c), c = 2n + s.
        squares, Z, vectors, X, basis, K, diagonals, scratch, integers: scratch.
        row_matrices, row_numbers, value_numbers: scratch.
        out: q̈, τ, R q̈ of unit rows, and the multipliers of all, (2, c); zeros where the status is
            not `OK`.

    Returns:
        Status, number of active bounds, steps of the active set (0: none was needed), residual.
    """
    (m, n), tasks, s = jacobian.shape, offsets.size - 1, rows.shape[0]
    c = 2 * n + s
    shapes = out.shape == (2, c) and bounds.shape == (2, c) and mass.shape == (n, n)
    sizes = target.size == m and bias.size == n and offsets[-1] == m and rows.shape[1] == n
    if not (shapes and sizes and alpha.shape == (tasks, tasks)):
        return BAD_SHAPE, 0, 0, math.inf
    values, multipliers, limits = out[0], out[1], bounds
    _clear(values)
    _clear(multipliers)
    weighty = LEAST_WEIGHT <= w <= MAX and 0.0 <= smoothing <= MAX
    if not weighty or _unfit(jacobian, target, alpha, mass, bias, rows, bounds):
        return BAD_INPUT, 0, 0, math.inf
    for j in range(c):
        if bounds[0, j] > bounds[1, j]:
            return INFEASIBLE, 0, 0, math.inf
    units, directions, motions = row_matrices[0], row_matrices[1], row_matrices[2]
    lengths, steps = row_numbers[0], row_numbers[1:]
    if s > 0:
        limits = value_numbers[:2]
        scale_rows(rows, bounds, units, lengths, limits)
    S, U, T, A, R = squares[0], squares[1], squares[2], squares[3], squares[4]
    q0, pull, y, g, away = vectors[0], vectors[1], vectors[2], vectors[3], vectors[4]
    qdd, tau = values[:n], values[n : 2 * n]
    active, state = integers[0, :n], integers[1, :c]
    whole = condense(
        jacobian,
        offsets,
        target,
        alpha,
        w,
        smoothing,
        S,
        q0,
        X,
        basis,
        diagonals,
        K,
        scratch,
        integers[2:],
    )
    weight = 0.0 if mode == NONE else w
    offset = 1.0 if mode == TORQUE else 0.0
    for i in range(n):
        qdd[i] = q0[i]
    for j in range(c):
        state[j] = 0
    equations = has_equations(limits, 2 * n)
    status, count, rounds, imposed = OK, 0, 0, 0
    if mode != NONE or equations:
        _factor(S, whole, mass, U, R, T, scratch)
    if equations:
        _values(mass, bias, units, values)
        _normals(U, T, units, SINGULAR * whole, Z)
        imposed = impose_equations(Z, values, limits, directions, motions, steps, value_numbers[2:])
        _split(Z, U, T)
        status = OK if imposed >= 0 else INFEASIBLE
        imposed = max(imposed, 0)
    if mode != NONE and status == OK:
        _times(mass, qdd, pull)
        for i in range(n):
            pull[i] += offset * bias[i]
        _free_optimum(U, T, w, pull, A, y, scratch, qdd)
    _values(mass, bias, units, values)
    if equations:
        hold_equations(values, limits, 2 * n)
    if status == OK and most_violated(values, limits[0], limits[1], state) >= 0:
        if mode == NONE and not equations:
            _factor(S, whole, mass, U, R, T, scratch)
        if not equations:
            _normals(U, T, units, SINGULAR * whole, Z)
        if mode != NONE:
            triangular_solve(A, Z)
        status, count, rounds = active_set(
            Values(Z, values, limits[0], limits[1], multipliers),
            Scratch(
                R,
                vectors[5],
                vectors[6],
                vectors[7],
                vectors[8],
                vectors[9],
                scratch[:c],
                active,
                state,
            ),
        )
        _values(mass, bias, units, values)
    residual = math.inf
    hidden = status == INFEASIBLE and _too_stiff(jacobian, offsets, w)
    status = UNSOLVED if hidden else status
    if status == OK:
        for i in range(n):
            pull[i] = tau[i] - (1.0 - offset) * bias[i]
        if imposed > 0:
            _gather(mass, pull, weight, units, multipliers, g, away)
            equation_multipliers(units, motions, steps, g, multipliers[2 * n :])
        residual = optimality(
            S, q0, mass, pull, weight, units, values, limits, multipliers, g, away
        )
        status = OK if residual < math.inf else OUT_OF_RANGE
    for j in range(s):
        multipliers[2 * n + j] /= lengths[j]
    if status != OK:
        _clear(values)
        _clear(multipliers)
    return status, count + imposed, rounds, residual
