"""Generalized hierarchical control, condensed to the n joint accelerations, in one call.

Liu, Tan and Padois, Autonomous Robots 2015, (13): with x_i = q̈′_i for each of the k tasks, and h
for the paper's bias n, since n is the number of joints here,

    min Σ |J_i x_i − b_i|² + w Σ |x_i|² + w |τ − o|²
    s.t. τ = M q̈ + h,   q̈ = Σ P_i x_i,   bounds of q̈, τ and R q̈

The paper has o = 0; o = h is ours. For a given q̈ the best x_i are known, H_i = J_iᵀJ_i + wI, and
half of what is left is, but for a constant and however many tasks,

    min ½ (q̈ − q₀)ᵀ S⁺ (q̈ − q₀) + w/2 |M q̈ + h − o|²,
    S = Σ P_i H_i⁻¹ P_i,   q₀ = Σ P_i J_iᵀ (J_i J_iᵀ + wI)⁻¹ b_i.

S may be singular and is never inverted: with S = UᵀU and q̈ = q₀ + Uᵀy the unknown is y, and the
Hessian I + w TᵀT, T = M Uᵀ. If its optimum satisfies the bounds, that is the answer; if not,
`active_set` moves from there. q̈, τ and R q̈ are values alike to it; equations among the rows are
imposed before (`row_kernels`).
"""

from __future__ import annotations

import math
from typing import NamedTuple

from hoap3.protocol.runtime.numba_jit import (
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
from hoap3.remote_controller.solvers.ghc.condense_kernels import (
    Condensed,
    Condensing,
    Tasks,
    condense,
)
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

# What is regularised: (`weight`, `offset`) of `Motion`.
NONE = 0  # nothing: (0, 0)
TORQUE = 1  # |τ|², o = 0: (ω_r, 1)
GRAVITY_COMPENSATED = 2  # |τ − h|², o = h: (ω_r, 0)
LEAST_WEIGHT = 1e-8  # of w: 1/w stands beside numbers near 1, and the rounding of both
WELL_APART = 1e-9  # of the diagonal of S: pivots above need no order
ROUNDING = 1e-12  # of what S is a difference from: pivots above are no rounding
SINGULAR = 1e-14  # of the same: a pivot up to that is 0
TOLD_APART = 1e-13  # of a task's |J|²: with less of ω_r, directions of S are cut that matter
SMALLEST = 1e-6  # rad/s²: accelerations below it count as that much


class Motion(NamedTuple):
    """The equation of motion, what of it is regularised, and what must hold, (13b, c).

    Attributes:
        mass: M, (n, n).
        bias: h, (n,).
        weight: w of |τ − o|², 0 where that is not regularised.
        offset: h − o = offset·h: 1 for |τ|², 0 for |τ − h|².
        units: r_j/|r_j| of the rows R, (s, n).
        limits: lower and upper bounds of (q̈, τ, R q̈/|r|), (2, c), c = 2n + s.
    """

    mass: Matrix
    bias: Vector
    weight: float
    offset: float
    units: Matrix
    limits: Matrix


class Factors(NamedTuple):
    """The problem in the unknown y, q̈ = q₀ + Uᵀy; all written.

    Attributes:
        U: UᵀU = S, (n, n).
        L: Uᵀ, (n, n).
        T: M Uᵀ, (n, n).
        A: the triangle of I + w TᵀT, (n, n).
        Z: normals [U | Tᵀ | U Rᵀ] of all values, (n, c); A⁻ᵀ of them for the active set, whose
            unknown is A(y − y*), y* the free optimum.
        line: scratch, (n,).
    """

    U: Matrix
    L: Matrix
    T: Matrix
    A: Matrix
    Z: Matrix
    line: Vector


class Equations(NamedTuple):
    """Rows that are equations, in their order, and scratch.

    Attributes:
        directions: e_k, (s, n).
        motions: p_k = Uᵀe_k, (s, n).
        shifts: t_k, (s,).
        sizes: |z_k|, (s,).
        lengths: |r_j| of all rows, (s,).
        squares: scratch, (2, c).
    """

    directions: Matrix
    motions: Matrix
    shifts: Vector
    sizes: Vector
    lengths: Vector
    squares: Matrix


class ActiveSet(NamedTuple):
    """What the active set keeps, and vectors.

    Attributes:
        held: the bounds that are active.
        pull: M q̈ + h − o at the point where the free optimum starts, then at the answer; (n,).
        y: of q̈ = q₀ + Uᵀy, (n,).
        g: w M (τ − o) + μ + M ν + Rᵀρ, (n,): μ, ν, ρ are the multipliers of q̈, τ, R q̈, positive
            where an upper bound holds back, negative where a lower one does.
        away: scratch, (n,).
    """

    held: Scratch
    pull: Vector
    y: Vector
    g: Vector
    away: Vector


class Workspace(NamedTuple):
    """All that is written on the way to the answer."""

    condensing: Condensing
    condensed: Condensed
    factors: Factors
    equations: Equations
    active_set: ActiveSet


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
    motion: Motion, effort: Vector, multipliers: Vector, g: Vector, scratch: Vector
) -> None:
    """Write g = w M·effort + μ + M ν + Rᵀρ, what pulls q̈ away from q₀."""
    n = g.size
    mu, nu, rho = multipliers[:n], multipliers[n : 2 * n], multipliers[2 * n :]
    for i in range(n):
        scratch[i] = motion.weight * effort[i] + nu[i]
    _times(motion.mass, scratch, g)
    for i in range(n):
        g[i] += mu[i]
    for j in range(rho.size):
        add(g, rho[j], motion.units[j])


@kernel(superwords=True)
def optimality(
    condensed: Condensed,
    motion: Motion,
    effort: Vector,
    values: Vector,
    multipliers: Vector,
    g: Vector,
    away: Vector,
) -> float:
    """How far q̈ is from optimal for its multipliers (μ, ν, ρ) of (q̈, τ, R q̈), when condensed.

    q̈ = q₀ − S(w M·effort + μ + M ν + Rᵀρ), S times stationarity, and each value of a multiplier
    that is not 0 at its bound, the others within theirs: the largest deviation, the former relative
    to max(|q̈|, |q₀|), the latter to 1 + |bound|; rows are of unit length. `effort` is τ − o, and
    τ − h with w = 0 where nothing is regularised. g and away are scratch, (n,).
    """
    n, lower, upper, span = motion.bias.size, motion.limits[0], motion.limits[1], SMALLEST
    S, q0 = condensed
    _gather(motion, effort, multipliers, g, away)
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
def _finite(tasks: Tasks, mass: Matrix, bias: Vector, rows: Matrix) -> bool:
    """Whether all numbers are."""
    found = not_finite(tasks.target) or not_finite(bias)
    for i in range(tasks.jacobian.shape[0]):
        found = found or not_finite(tasks.jacobian[i])
    for i in range(mass.shape[0]):
        found = found or not_finite(mass[i])
    for i in range(rows.shape[0]):
        found = found or not_finite(rows[i])
    return not found


@inlined
def _within(alpha: Matrix, bounds: Matrix) -> bool:
    """Whether every priority is in [0, 1] and no bound infinite on the wrong side, or NaN."""
    found = True
    for i in range(alpha.shape[0]):
        for j in range(alpha.shape[1]):
            found = found and 0.0 <= alpha[i, j] <= 1.0
    for j in range(bounds.shape[1]):
        found = found and bounds[0, j] < math.inf and bounds[1, j] > -math.inf
    return found


@inlined
def _apart(bounds: Matrix) -> bool:
    """Whether a lower bound is above the upper one."""
    found = 0
    for j in range(bounds.shape[1]):
        found += 1 if bounds[0, j] > bounds[1, j] else 0
    return found > 0


@inlined
def _too_stiff(tasks: Tasks, w: float) -> bool:
    """Whether what a task leaves to ω_r is so little of S that rounding hides it."""
    jacobian, offsets, found = tasks.jacobian, tasks.offsets, False
    for i in range(offsets.size - 1):
        square = 0.0
        for row in range(offsets[i], offsets[i + 1]):
            square += dot(jacobian[row], jacobian[row])
        found = found or w < TOLD_APART * square
    return found


@inlined
def _factor(S: Matrix, whole: float, mass: Matrix, factors: Factors) -> None:
    """Write U with UᵀU = S (Cholesky; with pivots where S is singular), its transpose, and T."""
    U, L, T, n = factors.U, factors.L, factors.T, S.shape[0]
    for i in range(n):
        for j in range(n):
            U[i, j] = S[i, j] if j >= i else 0.0
    regular = factorise(U, n, WELL_APART, factors.line) == n
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
def _free_optimum(motion: Motion, factors: Factors, pull: Vector, y: Vector, qdd: Vector) -> None:
    """Add Uᵀy to q̈, where y minimises ½ |y|² + w/2 |T y + pull|², pull = M q̈ + h − o of before.

    (I + w TᵀT) y = −w Tᵀ·pull.
    """
    A, T, scratch, n = factors.A, factors.T, factors.line, qdd.size
    _times(motion.mass, qdd, pull)
    for i in range(n):
        pull[i] += motion.offset * motion.bias[i]
        scratch[i] = -motion.weight * pull[i]
        for j in range(n):
            A[i, j] = 1.0 if i == j else 0.0
    _clear(y)
    add_rows(y, scratch, T, 0, n, 0)
    syrk(A, motion.weight, T, n)
    factorise(A, n, 0.0, scratch)
    solve_lower(A, y)
    solve_upper(A, y)
    add_rows(qdd, y, factors.U, 0, n, 0)


@inlined
def _normals(factors: Factors, units: Matrix, least: float) -> None:
    """Write the normals of all values, Z = [U | Tᵀ | U Rᵀ]."""
    U, T, Z, n = factors.U, factors.T, factors.Z, factors.U.shape[0]
    for i in range(n):
        for j in range(n):
            Z[i, j] = U[i, j]
            Z[i, n + j] = T[j, i]
    row_normals(units, U, least, Z)


@inlined
def _split(factors: Factors) -> None:
    """Write U and T of Z = [U | Tᵀ | U Rᵀ], (I − eeᵀ) U and T (I − eeᵀ) after the equations."""
    U, T, Z, n = factors.U, factors.T, factors.Z, factors.U.shape[0]
    for i in range(n):
        for j in range(n):
            U[i, j] = Z[i, j]
            T[j, i] = Z[i, n + j]


@inlined
def _values(motion: Motion, values: Vector) -> None:
    """Write τ and R q̈/|r| behind q̈."""
    n = motion.bias.size
    _torques(motion.mass, values[:n], motion.bias, values[n : 2 * n])
    _times(motion.units, values[:n], values[2 * n :])


@kernel(superwords=True)
def optimum(
    motion: Motion,
    condensed: Condensed,
    whole: float,
    factors: Factors,
    equations: Equations,
    work: ActiveSet,
    values: Vector,
    multipliers: Vector,
) -> tuple[int, int, int, int]:
    """Write the optimum of the condensed problem: equations, free optimum, active set.

    Args:
        motion, condensed, whole: the problem; S is a difference from `whole` times I.
        factors, equations, work: written.
        values: q̈, τ, R q̈/|r|, (c,), written.
        multipliers: of bounds, (c,), 0s; those of equations stay 0.

    Returns:
        Status, number of active bounds and rows, number of equations, steps of the active set.
    """
    n, limits, regularised = motion.bias.size, motion.limits, motion.weight > 0.0
    lower, upper, first_row = limits[0], limits[1], 2 * n
    qdd, least = values[:n], SINGULAR * whole
    exact, imposed = has_equations(limits, first_row), 0
    for i in range(n):
        qdd[i] = condensed.q0[i]
    for j in range(values.size):
        work.held.state[j] = 0
    if regularised or exact:
        _factor(condensed.S, whole, motion.mass, factors)
    if exact:
        _values(motion, values)
        _normals(factors, motion.units, least)
        imposed = impose_equations(
            factors.Z,
            values,
            limits,
            equations.directions,
            equations.motions,
            equations.shifts,
            equations.sizes,
            equations.squares,
        )
        if imposed < 0:
            return INFEASIBLE, 0, 0, 0
        _split(factors)
    if regularised:
        _free_optimum(motion, factors, work.pull, work.y, qdd)
    _values(motion, values)
    if exact:
        hold_equations(values, limits, first_row)
    if most_violated(values, lower, upper, work.held.state) < 0:
        return OK, 0, imposed, 0
    if not exact:
        if not regularised:
            _factor(condensed.S, whole, motion.mass, factors)
        _normals(factors, motion.units, least)
    if regularised:
        triangular_solve(factors.A, factors.Z)
    status, count, steps = active_set(
        Values(factors.Z, values, lower, upper, multipliers), work.held
    )
    _values(motion, values)
    return status, count, imposed, steps


@kernel(superwords=True)
def solve_tasks(
    tasks: Tasks,
    motion: Motion,
    w: float,
    smoothing: float,
    scratch: Workspace,
    values: Vector,
    multipliers: Vector,
) -> tuple[int, int, int, float]:
    """Write the answer and its multipliers, both of unit rows; else as `ghc_kernel`.

    Args:
        tasks, motion, w, smoothing: the problem, ω_r and s₀.
        scratch: written.
        values, multipliers: (c,); the latter 0s.
    """
    condensed, work, equations = scratch.condensed, scratch.active_set, scratch.equations
    g, away, effort, n = work.g, work.away, work.pull, motion.bias.size
    tau, rho = values[n : 2 * n], multipliers[2 * n :]
    whole = condense(tasks, w, smoothing, condensed, scratch.condensing)
    status, count, imposed, steps = optimum(
        motion, condensed, whole, scratch.factors, equations, work, values, multipliers
    )
    if status == INFEASIBLE and _too_stiff(tasks, w):
        status = UNSOLVED
    if status != OK:
        return status, count, steps, math.inf
    for i in range(n):
        effort[i] = tau[i] - (1.0 - motion.offset) * motion.bias[i]
    if imposed > 0:
        _gather(motion, effort, multipliers, g, away)
        equation_multipliers(
            motion.units, equations.motions, equations.shifts, equations.sizes, g, rho
        )
    residual = optimality(condensed, motion, effort, values, multipliers, g, away)
    return OK if residual < math.inf else OUT_OF_RANGE, count + imposed, steps, residual


def sizes_of(m: int, n: int, k: int, s: int) -> tuple[int, int]:
    """How many numbers, and how many integers, `ghc_kernel` needs as scratch."""
    c, most = 2 * n + s, m * k + m
    condensing = (most + 2 * m + 1) * n + 2 * m * (m + 1) + 2 * m + k + max(m, n)
    solving = 6 * n * n + n * c + 11 * n + 3 * s * n + 3 * s + 5 * c
    return condensing + solving, 4 * k + 1 + m + n + c


@kernel(superwords=True)
def ghc_kernel(  # noqa: PLR0915 - here scratch gets its names and shapes
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
    numbers: Vector,
    integers: Indices,
    out: Matrix,
) -> tuple[int, int, int, float]:
    """Solve one problem; `Ghc` describes the arguments.

    What is not finite shows in the answer: the arrays are searched for it only where there is none.

    Args:
        jacobian, offsets, target: (m, n), (k + 1,), (m,).
        alpha, mass, bias: (k, k), (n, n), (n,).
        w, mode, smoothing: ω_r, what is regularised, s₀.
        rows: R, (s, n).
        bounds: lower and upper ones of (q̈, τ, R q̈), (2, c), c = 2n + s.
        numbers, integers: scratch, as long as `sizes_of` says.
        out: (2, c); in row 0 q̈, τ and, of rows of unit length, R q̈; in row 1 the multipliers
            (μ, ν, ρ), ρ of the rows that were given. Zeros where the status is not `OK`.

    Returns:
        Status, number of active bounds, steps of the active set (0: none was needed), residual.
    """
    (m, n), k, s = jacobian.shape, offsets.size - 1, rows.shape[0]
    c, at, also = 2 * n + s, 0, 0
    shapes = out.shape == (2, c) and bounds.shape == (2, c) and mass.shape == (n, n)
    fits = target.size == m and bias.size == n and offsets[-1] == m and rows.shape[1] == n
    if not (shapes and fits and alpha.shape == (k, k)):
        return BAD_SHAPE, 0, 0, math.inf
    tasks, values, multipliers = Tasks(jacobian, offsets, target, alpha), out[0], out[1]
    _clear(values)
    _clear(multipliers)
    weighty = LEAST_WEIGHT <= w <= MAX and 0.0 <= smoothing <= MAX
    if not weighty or not _within(alpha, bounds):
        return BAD_INPUT, 0, 0, math.inf
    most, wide, last, long, k1 = m * k + m, 2 * m + 1, m + 1, max(m, n), k + 1
    height = most + wide + 6 * n + 11 + 3 * s
    of_n, at = numbers[: height * n].reshape(height, n), height * n  # a reshape takes 10 ns
    of_c, at = numbers[at : at + (n + 5) * c].reshape(n + 5, c), at + (n + 5) * c
    of_m, at = numbers[at : at + 2 * m * last].reshape(2 * m, last), at + 2 * m * last
    X, row = of_n[:most], most
    B, row = of_n[row : row + wide], row + wide
    C, Q = of_m[:m], of_m[m:]
    D, at = numbers[at : at + m], at + m
    F, at = numbers[at : at + m], at + m
    rise, at = numbers[at : at + k], at + k
    along, at = numbers[at : at + long], at + long
    closes, also = integers[also : also + k], also + k
    order, also = integers[also : also + k], also + k
    level_rows, also = integers[also : also + m], also + m
    chain, also = integers[also : also + k], also + k
    ranks, also = integers[also : also + k1], also + k1
    condensing = Condensing(X, B, D, F, C, Q, rise, along, closes, order, level_rows, chain, ranks)
    S, row = of_n[row : row + n], row + n
    U, row = of_n[row : row + n], row + n
    L, row = of_n[row : row + n], row + n
    T, row = of_n[row : row + n], row + n
    A, row = of_n[row : row + n], row + n
    R, row = of_n[row : row + n], row + n
    Z, squares, limits, speed = of_c[:n], of_c[n : n + 2], of_c[n + 2 : n + 4], of_c[n + 4]
    q0, line, pull, y = of_n[row], of_n[row + 1], of_n[row + 2], of_n[row + 3]
    g, away, share, length = of_n[row + 4], of_n[row + 5], of_n[row + 6], of_n[row + 7]
    sign, normal, ratio, row = of_n[row + 8], of_n[row + 9], of_n[row + 10], row + 11
    factors = Factors(U, L, T, A, Z, line)
    active, also = integers[also : also + n], also + n
    state, also = integers[also : also + c], also + c
    held = Scratch(R, share, length, sign, normal, ratio, speed, active, state)
    work = ActiveSet(held, pull, y, g, away)
    directions, row = of_n[row : row + s], row + s
    motions, row = of_n[row : row + s], row + s
    units = of_n[row : row + s]
    shifts, at = numbers[at : at + s], at + s
    sizes, at = numbers[at : at + s], at + s
    lengths, at = numbers[at : at + s], at + s
    equations = Equations(directions, motions, shifts, sizes, lengths, squares)
    scratch = Workspace(condensing, Condensed(S, q0), factors, equations, work)
    weight, offset = 0.0 if mode == NONE else w, 1.0 if mode == TORQUE else 0.0
    motion = Motion(mass, bias, weight, offset, rows, bounds)
    if s > 0:
        scale_rows(rows, bounds, units, lengths, limits)
        motion = Motion(mass, bias, weight, offset, units, limits)
    status, count, steps, residual = INFEASIBLE, 0, 0, math.inf
    if not _apart(bounds):
        status, count, steps, residual = solve_tasks(
            tasks, motion, w, smoothing, scratch, values, multipliers
        )
    rho = multipliers[2 * n :]
    for j in range(s):
        rho[j] /= lengths[j]
    if status != OK:
        status = status if _finite(tasks, mass, bias, rows) else BAD_INPUT
        _clear(values)
        _clear(multipliers)
    return status, count, steps, residual
