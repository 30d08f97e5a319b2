"""The general problem (3) where its equations and bounds alone hold u back: Newton's method.

    min  κ|y|₁ + ½|y|² + price·s·y   subject to   E y = e,  least ≤ y ≤ most

Gonçalves et al., IEEE T-RO 2020, (3) with Φ of (26), scaled as in `lyapunov_qp_kernels`. For
multipliers λ of the equations the optimal y stands in closed form, joint by joint:

    r = −price·s − Eᵀλ
    y_i(λ) = the point within its bounds nearest to sign(r_i)·max(0, |r_i| − κ)

What is left is to find λ, one number for each equation, with E y(λ) = e. That is the maximum of the
dual function, which is concave, has the gradient E y(λ) − e, and is quadratic wherever no joint
begins to move or comes to a bound. A step goes to the maximum of the present piece, or as far in
its direction as the function rises; it ends on the piece that has the maximum, where the step is
exact. It starts at rest: an answer depends on its problem alone.
"""

from __future__ import annotations

import math

from hoap3.protocol.runtime.numba_jit import Matrix, Vector, inlined, kernel
from hoap3.remote_controller.solvers.linalg.dense_kernels import add, dot
from hoap3.remote_controller.solvers.linalg.scaling_kernels import largest
from hoap3.remote_controller.solvers.lyapunov_qp.lyapunov_qp_kernels import NO_BOUND

STEPS = 60  # HOAP-3 on its feet takes 7 to 12
SINGULAR = 1e-12  # pivots of E Eᵀ of the joints that move, rows of length 1
DEPENDENT = 1e-6  # of `SPREAD`: pivots of all joints
SPREAD = 1e-8  # how much a joint at rest or at a bound moves, where E Eᵀ of the others is singular
SETTLED = 1e-12  # of max|y|: where no more is missing in E y = e, the last piece is reached
ROUNDING = 1e-15  # of the largest multiplier: as `SETTLED`, where that is more
EXACT = 1e-10  # of s·y: a rate of V counts by itself, however fast joints move beside it


@inlined
def _answer(r: float, kappa: float, least: float, most: float) -> tuple[float, float]:
    """The optimal y_i for its r_i, and how much it changes with it, 0 or 1."""
    size = abs(r) - kappa
    y = math.copysign(size, r) if size > 0.0 else 0.0
    inside = size > 0.0 and least < y < most
    return min(max(y, least), most), 1.0 if inside else 0.0


@inlined
def _factor(E: Matrix, moves: Vector, spread: float, row: Vector, U: Matrix) -> bool:
    """U with UᵀU = E diag(max(moves, spread)) Eᵀ; False where that is singular.

    With a spread it never is: an equation that others say already gets a row of zeros.
    """
    k, n = E.shape
    for j in range(k):
        for i in range(n):
            row[i] = max(moves[i], spread) * E[j, i]
        for h in range(j, k):
            U[j, h] = dot(row, E[h])
    for j in range(k):
        if U[j, j] > (DEPENDENT * spread if spread > 0.0 else SINGULAR):
            root = math.sqrt(U[j, j])
            for h in range(j, k):
                U[j, h] /= root
        elif spread > 0.0:
            U[j, j:] = 0.0
        else:
            return False
        for h in range(j + 1, k):
            for i in range(h, k):
                U[h, i] -= U[j, h] * U[j, i]
    return True


@inlined
def _solve(U: Matrix, x: Vector) -> None:
    """Turn x into (UᵀU)⁻¹ x; 0 where U has a row of zeros."""
    k = x.size
    for j in range(k):
        x[j] = x[j] / U[j, j] if U[j, j] > 0.0 else 0.0
        for h in range(j + 1, k):
            x[h] -= U[j, h] * x[j]
    for j in range(k - 1, -1, -1):
        for h in range(j + 1, k):
            x[j] -= U[j, h] * x[h]
        x[j] = x[j] / U[j, j] if U[j, j] > 0.0 else 0.0


@inlined
def _stretches(
    r: Vector, turn: Vector, kappa: float, least: Vector, most: Vector, pieces: Matrix
) -> int:
    """Where along r − t·turn joints move: first and last t > 0 of each stretch, and turn²."""
    count = 0
    for i in range(r.size):
        if turn[i] == 0.0:
            continue
        for side in (1.0, -1.0):
            high = most[i] if side > 0.0 else -least[i]
            low = max(least[i] if side > 0.0 else -most[i], 0.0)
            one = (r[i] - side * (kappa + low)) / turn[i]
            other = (r[i] - side * (kappa + high)) / turn[i]
            last = max(one, other)
            if high > low and last > 0.0:
                pieces[0, count] = max(min(one, other), 0.0)
                pieces[1, count] = last
                pieces[2, count] = turn[i] * turn[i]
                count += 1
    return count


@inlined
def _farthest(pieces: Matrix, count: int, slope: float) -> float:
    """How far to go until the dual function's slope is 0; 0 where it rises for ever.

    Along the direction it falls by turn² for each joint that moves.
    """
    t = 0.0
    for _ in range(2 * count + 1 if slope > 0.0 else 0):
        bend, following = 0.0, math.inf
        for j in range(count):
            first, last = pieces[0, j], pieces[1, j]
            if first > t:
                following = min(following, first)
            elif last > t:
                bend += pieces[2, j]
                following = min(following, last)
        if bend > 0.0 and slope <= bend * (following - t):
            return t + slope / bend
        if following == math.inf:
            return 0.0
        slope -= bend * (following - t)
        t = following
    return 0.0


@inlined
def _step(
    E: Matrix, e: Vector, y: Vector, moves: Vector, d: Vector, turn: Vector, U: Matrix
) -> float:
    """Write d = (E diag(moves) Eᵀ)⁻¹ (E y − e) and turn = Eᵀd; returns d·(E y − e)."""
    if not _factor(E, moves, 0.0, turn, U):
        _factor(E, moves, SPREAD, turn, U)
    for j in range(d.size):
        d[j] = dot(E[j], y) - e[j]
    _solve(U, d)
    turn[:] = 0.0
    slope = 0.0
    for j in range(d.size):
        add(turn, d[j], E[j])
        slope += d[j] * (dot(E[j], y) - e[j])
    return slope


@inlined
def _maximise(
    E: Matrix,
    e: Vector,
    price: float,
    s: Vector,
    kappa: float,
    least: Vector,
    most: Vector,
    work: Matrix,
    d: Vector,
    U: Matrix,
    y: Vector,
    multipliers: Vector,
) -> bool:
    """Find y, and λ from where it is; False where there is none, or it takes too many steps."""
    k, n = E.shape
    r, moves, turn, pieces = work[0, :n], work[1, :n], work[2, :n], work[3:6]
    for _ in range(STEPS):
        for i in range(n):
            r[i] = -price * s[i]
        for j in range(k):
            add(r, -multipliers[j], E[j])
        for i in range(n):
            y[i], moves[i] = _answer(r[i], kappa, least[i], most[i])
        missing = 0.0
        for j in range(k):
            missing = max(missing, abs(dot(E[j], y) - e[j]))
        if missing == 0.0:
            return True
        slope = _step(E, e, y, moves, d, turn, U)
        if missing <= max(SETTLED * largest(y), ROUNDING * largest(multipliers)):
            for i in range(n):  # y is a difference of r and κ: what that lost is put right in y
                y[i] -= moves[i] * turn[i]
            return True
        far = _farthest(pieces, _stretches(r, turn, kappa, least, most, pieces), slope)
        if far == 0.0:
            return False
        for j in range(k):
            multipliers[j] += far * d[j]
    return False


@kernel()
def dual_newton(
    rows: Matrix,
    m: int,
    least: Vector,
    most: Vector,
    low: float,
    high: float,
    price: float,
    kappa: float,
    work: Matrix,
    small: Matrix,
    U: Matrix,
    y: Vector,
    multipliers: Vector,
) -> bool:
    """Find y and the multipliers of all rows, if no row of A holds y back.

    Args:
        rows: of A, s and C, (m + 1 + k, n), of length 1.
        m: rows of A.
        least: limits of y and the rows, (n + m + 1 + k,).
        most: likewise, b and c.
        low: of s·y; −1e30 is none, and the same as `high` makes an equation of it.
        high: likewise.
        price: of s·y.
        kappa: κ, the weight of |y|₁.
        work: scratch, (6, 2n).
        small: scratch, (2, 1 + k or more).
        U: scratch, (1 + k, 1 + k), or more rows and columns.
        y: written, (n,).
        multipliers: written, (m + 1 + k,): positive where an upper limit holds y back.

    Returns:
        Whether there is such an answer.
    """
    count, n = rows.shape
    k = count - m
    e, d, found = small[0, :k], small[1, :k], multipliers[m:]
    for j in range(k):
        e[j] = most[n + m + j]
    multipliers[:] = 0.0
    solved, limited = False, low > -NO_BOUND or high < NO_BOUND
    if limited:
        e[0] = low if low > -NO_BOUND else high
        found[0] = -price  # so that the robot is at rest
        solved = _maximise(rows[m:], e, price, rows[m], kappa, least, most, work, d, U, y, found)
        solved &= abs(dot(rows[m], y) - e[0]) <= EXACT * abs(e[0])
        if low < high:  # one side alone, which must hold s·y back
            solved &= found[0] <= 0.0 if low > -NO_BOUND else found[0] >= 0.0
    if not limited or (not solved and low < high):
        multipliers[:] = 0.0
        solved = _maximise(
            rows[m + 1 :],
            e[1:],
            price,
            rows[m],
            kappa,
            least,
            most,
            work,
            d[1:],
            U,
            y,
            found[1:],
        )
        if solved and limited:
            given = dot(rows[m], y)
            solved = low <= given <= high
    if not solved:
        return False
    kept = True
    for j in range(m):
        kept &= dot(rows[j], y) <= most[n + j]
    return kept
