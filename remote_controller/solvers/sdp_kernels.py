"""The gains of prioritised tasks with a certificate, from Jacobians and errors, in one call.

Marti-Saumell et al.: min (β − β̃)² + δ|λ|² such that V falls by V⁺ ≤ (1 − β Δt) V, and the joint
speeds dq = B(Λ e + rates) stay within their limits. From the last answer Newton's method takes two
or three steps (`sdp_newton_kernels`); where it does not arrive, an interior-point method comes near
enough for it (`sdp_interior_kernels`). Either may stop early: whatever λ is returned, β is what it
certifies, λ_min(C(λ, 0)), and a gap of duality says how far from optimal it may be.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from protocol.compilation import inlined, kernel
from remote_controller.solvers.clik_kernels import prioritised
from remote_controller.solvers.dense_kernels import (
    MAX,
    add_rows,
    dot,
    eigenvectors,
    gram,
    not_finite,
)
from remote_controller.solvers.lmi_kernels import (
    find_blocks,
    least_eigenvalue,
    stability_matrix,
)
from remote_controller.solvers.sdp_interior_kernels import (
    SPRING,
    begin_inside,
    dot_column,
    interior,
    locked,
)
from remote_controller.solvers.sdp_newton_kernels import settle
from remote_controller.solvers.status import (
    BAD_INPUT,
    BAD_SHAPE,
    OK,
    OUT_OF_RANGE,
    SPENT,
    STATIONARY,
    UNSOLVED,
)

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

NONE, WARM, IPM, BUDGET = range(4)  # the ways to an answer
FIRST_TRY, LAST_TRY = 1e-2, 1e-9  # of λ: how near the interior-point method is to bring Newton's
NOTHING = 1e-8  # of β̃: a β up to that is no certificate
OVER = 1e-9  # of 1 + |limit|: what is cut off as rounding
PROVED = 1e-9  # of β̃²: a gap up to that proves that the gains are optimal


@inlined
def _unfit(jacobian: Array, errors: Array, rates: Array, weights: Array, limits: Array) -> bool:
    """Whether a value is not finite, or the limits do not allow to stand still."""
    found = not_finite(errors) or not_finite(rates) or not_finite(weights)
    for i in range(jacobian.shape[0]):
        found = found or not_finite(jacobian[i]) or not weights[i] > 0.0
    for r in range(limits.shape[1]):
        found = found or not (limits[0, r] <= 0.0 <= limits[1, r])
    return found


@inlined
def _feed_forward(B: Array, rates: Array, limits: Array, speed: Array) -> float:
    """Write B·rates, shortened until it keeps the limits; returns the factor."""
    n, share = B.shape[0], 1.0
    for r in range(speed.size):
        speed[r] = 0.0
    add_rows(speed, rates, B, 0, n, 0)
    for r in range(speed.size):
        if speed[r] > limits[1, r]:
            share = min(share, limits[1, r] / speed[r])
        if speed[r] < limits[0, r]:
            share = min(share, limits[0, r] / speed[r])
    if share < 1.0:
        for r in range(speed.size):
            speed[r] = min(max(share * speed[r], limits[0, r]), limits[1, r])
    return share


@kernel("f8(f8[:,::1], f8[:,::1], f8[::1], f8[::1])")
def _fit(S: Array, limits: Array, gains: Array, speed: Array) -> float:
    """Write S λ, with λ shortened until it keeps the limits; how near it comes to them."""
    n, share = S.shape[0], 1.0
    for r in range(speed.size):
        speed[r] = 0.0
    add_rows(speed, gains, S, 0, n, 0)
    for r in range(speed.size):
        if speed[r] - limits[1, r] > OVER * (1.0 + limits[1, r]):
            share = min(share, limits[1, r] / speed[r])
        if limits[0, r] - speed[r] > OVER * (1.0 - limits[0, r]):
            share = min(share, limits[0, r] / speed[r])
    margin = math.inf
    for i in range(n):
        gains[i] *= share
    for r in range(speed.size):
        speed[r] = min(max(share * speed[r], limits[0, r]), limits[1, r])
        margin = min(margin, limits[1, r] - speed[r], speed[r] - limits[0, r])
    return margin


@kernel(
    "f8(f8[:,::1], f8[:,::1], f8[:,::1], f8[:,::1], f8, f8, f8[::1], f8, f8[:,::1], f8[:,::1],"
    " f8[:,::1], f8[:,::1])"
)
def duality_gap(
    L: Array,
    G: Array,
    S: Array,
    limits: Array,
    dt: float,
    delta: float,
    gains: Array,
    beta: float,
    Z: Array,
    z: Array,
    C: Array,
    V: Array,
) -> float:
    """How much less than that of feasible (λ, β) the objective may be, in the units of β̃ = 1.

    For any Z ⪰ 0 and z ≥ 0 the Lagrange function is a bound from below where it is least. It is
    quadratic, with a Hessian of 2δ (λ) and 2 (β) at least, so it falls below its value here by
    |g_λ|²/4δ + g_β²/4 at most, g its gradient. By the same curvature of the objective
    |β − β*|² ≤ gap and δ|λ − λ*|² ≤ gap.
    """
    n, joints = S.shape
    stability_matrix(L, G, gains, beta, dt, C, V)
    gap, slope = 0.0, 2.0 * (beta - 1.0)
    for r in range(joints):
        speed = 0.0
        for i in range(n):
            speed += S[i, r] * gains[i]
        if z[1, r] > 0.0:
            gap += z[1, r] * (limits[1, r] - speed)
        if z[0, r] > 0.0:
            gap += z[0, r] * (speed - limits[0, r])
    for i in range(n):
        gap += dot(C[i], Z[i])
        slope += Z[i, i]
    gap += 0.25 * slope * slope
    for i in range(n):
        slope = 2.0 * delta * gains[i] + dot(S[i], z[1]) - dot(S[i], z[0])
        for k in range(n):
            slope -= 2.0 * V[k, i] * Z[k, i]
        gap += 0.25 * slope * slope / delta
    return gap


@kernel(
    "UniTuple(i8, 2)(f8[:,::1], f8[:,::1], f8[::1], f8[:,::1], f8[:,::1], i8[::1], f8[:,::1],"
    " i8[::1], i8[::1], f8[::1], f8[:,::1], f8[:,::1], f8[:,::1])"
)
def _guess(
    S: Array,
    limits: Array,
    x: Array,
    Z: Array,
    z: Array,
    block: Indices,
    Y: Array,
    home: Indices,
    held: Indices,
    nu: Array,
    C: Array,
    W: Array,
    Q: Array,
) -> tuple[int, int]:
    """From an interior point: which eigenvectors of Z and which limits matter at the optimum.

    Those whose multiplier is larger than what it is the multiplier of. Returns how many of each.
    """
    n, rank, holding = S.shape[0], 0, 0
    for i in range(n):
        for j in range(n):
            W[i, j] = Z[i, j]
    eigenvectors(W, Q, n)
    for k in range(n):
        other, largest = 0.0, 0
        for i in range(n):
            other += Q[k, i] * dot(C[i], Q[k])
            largest = i if abs(Q[k, i]) > abs(Q[k, largest]) else largest
        if W[k, k] > max(other, 0.0) and rank < Y.shape[0]:
            root = math.sqrt(W[k, k])
            home[rank] = block[largest]
            for i in range(n):
                Y[rank, i] = root * Q[k, i] if block[i] == home[rank] else 0.0
            rank += 1
    for r in range(S.shape[1]):
        speed = 0.0
        for i in range(n):
            speed += S[i, r] * x[i]
        if locked(limits, r) and holding < n:
            held[holding], nu[holding] = r + 1, 0.0
            holding += 1
        elif z[1, r] > limits[1, r] - speed and holding < n:
            held[holding], nu[holding] = r + 1, z[1, r]
            holding += 1
        elif z[0, r] > speed - limits[0, r] and holding < n:
            held[holding], nu[holding] = -r - 1, z[0, r]
            holding += 1
    return rank, holding


@inlined
def _multipliers(
    Y: Array, rank: int, held: Indices, holding: int, nu: Array, Z: Array, z: Array
) -> None:
    """Write Z = Y Yᵀ and the multipliers of the limits."""
    n = Z.shape[0]
    for i in range(n):
        for j in range(n):
            Z[i, j] = 0.0
            for k in range(rank):
                Z[i, j] += Y[k, i] * Y[k, j]
    for r in range(z.shape[1]):
        z[0, r], z[1, r] = 0.0, 0.0
    for a in range(holding):
        side, r = (1, held[a] - 1) if held[a] > 0 else (0, -held[a] - 1)
        z[side, r] = max(nu[a], 0.0)
        if nu[a] < 0.0:  # of a joint that may not move: its other limit holds
            z[1 - side, r] = -nu[a]


@inlined
def _forget(gains: Array, counts: Indices) -> None:
    """Stand still, and begin anew the next time."""
    for i in range(gains.size):
        gains[i] = 0.0
    counts[0], counts[1] = 0, 0


@inlined
def _certified(
    L: Array, G: Array, gains: Array, dt: float, guess: float, squares: Array, vectors: Array
) -> float:
    """β(λ) = λ_min(C(λ, 0))."""
    stability_matrix(L, G, gains, 0.0, dt, squares[0], squares[1])
    return least_eigenvalue(squares[0], guess, 0.0, vectors[3:])


@inlined
def _spring_multipliers(S: Array, limits: Array, x: Array, z: Array) -> None:
    """Write what holds the joints that may not move, where the interior-point method held them."""
    for r in range(S.shape[1]):
        if locked(limits, r):
            pull = SPRING * dot_column(S, r, x)
            z[0, r], z[1, r] = max(-pull, 0.0), max(pull, 0.0)


@kernel(
    "Tuple((b1, i8))(f8[:,::1], f8[:,::1], f8[:,::1], f8[:,::1], f8, f8, i8, f8[:,::1],"
    " f8[:,::1], i8[:,::1], i8[::1], f8[::1], f8[:,::1], f8[:,::1], f8[:,:,::1], f8[:,::1],"
    " f8[:,::1])"
)
def polish(
    L: Array,
    G: Array,
    S: Array,
    limits: Array,
    dt: float,
    delta: float,
    budget: int,
    points: Array,
    Y: Array,
    integers: Indices,
    counts: Indices,
    nu: Array,
    Z: Array,
    z: Array,
    squares: Array,
    K: Array,
    vectors: Array,
) -> tuple[bool, int]:
    """Newton's method from a point near the optimum with its multipliers; as for `optimise`.

    Returns:
        Whether it arrived, and all is overwritten by the optimum; steps taken.
    """
    n = S.shape[0]
    block, home, held, x, trial = integers[0], integers[1], integers[2], points[0], points[1]
    stability_matrix(L, G, x[:n], x[n], dt, squares[0], squares[1])
    rank, holding = _guess(
        S, limits, x, Z, z, block, Y, home, held, nu, squares[0], squares[2], squares[3]
    )
    for i in range(n + 1):
        trial[i] = x[i]
    good, holding, taken = settle(
        L,
        G,
        S,
        limits,
        dt,
        delta,
        trial,
        Y,
        block,
        home,
        rank,
        held,
        holding,
        nu,
        budget,
        squares[0],
        squares[1],
        K,
        vectors,
    )
    counts[0], counts[1] = 0, 0
    if good:
        for i in range(n + 1):
            x[i] = trial[i]
        counts[0], counts[1] = rank, holding
        _multipliers(Y, rank, held, holding, nu, Z, z)
    return good, taken


@kernel(
    "Tuple((i8, i8, i8))(f8[:,::1], f8[:,::1], f8[:,::1], f8[:,::1], f8, f8, i8, f8[:,::1],"
    " f8[:,::1], i8[:,::1], i8[::1], f8[::1], f8[:,::1], f8[:,::1], f8[:,:,::1], f8[:,::1],"
    " f8[:,::1], f8[:,::1], f8[:,:,::1])"
)
def optimise(
    L: Array,
    G: Array,
    S: Array,
    limits: Array,
    dt: float,
    delta: float,
    budget: int,
    points: Array,
    Y: Array,
    integers: Indices,
    counts: Indices,
    nu: Array,
    Z: Array,
    z: Array,
    squares: Array,
    K: Array,
    H: Array,
    vectors: Array,
    sides: Array,
) -> tuple[int, int, int]:
    """Find λ and β in the units of β̃ = 1, from the last ones if these are of any use.

    Args:
        L, G, S, limits, dt, delta: as for `settle`.
        budget: how many iterations are allowed, of both kinds together.
        points: λ and β, (2, n + 1): the last one, overwritten by the answer, and scratch.
        Y: of the last one, (any, n); overwritten.
        integers: blocks of L, homes of the y_k, limits that hold, (3, n); the latter two from last.
        counts: how many y_k and how many held limits there are, (2,); none where nothing is known.
        nu: multipliers of the limits, (n,).
        Z, z: written: multipliers of C and the limits, (n, n) and (2, joints).
        squares, K, H, vectors, sides: scratch; see `SdpGains`.

    Returns:
        Path; Newton steps; iterations of the interior-point method.
    """
    n = S.shape[0]
    block, home, held = integers[0], integers[1], integers[2]
    x, newton = points[0], 0
    if counts[0] > 0:
        good, counts[1], newton = settle(
            L,
            G,
            S,
            limits,
            dt,
            delta,
            x,
            Y,
            block,
            home,
            counts[0],
            held,
            counts[1],
            nu,
            budget,
            squares[0],
            squares[1],
            K,
            vectors,
        )
        if good:
            _multipliers(Y, counts[0], held, counts[1], nu, Z, z)
            return WARM, newton, 0
    begin_inside(S, limits, x, Z, z, sides[0])
    tolerance, inner = FIRST_TRY, 0
    while True:
        near, taken = interior(
            L,
            G,
            S,
            limits,
            dt,
            delta,
            x,
            Z,
            z,
            tolerance,
            budget - newton - inner,
            squares,
            H,
            vectors,
            sides,
        )
        inner += taken
        good, taken = polish(
            L,
            G,
            S,
            limits,
            dt,
            delta,
            budget - newton - inner,
            points,
            Y,
            integers,
            counts,
            nu,
            Z,
            z,
            squares,
            K,
            vectors,
        )
        newton += taken
        if good:
            return IPM, newton, inner
        if not near or tolerance <= LAST_TRY or newton + inner >= budget:
            break
        tolerance *= 0.1
    _spring_multipliers(S, limits, x, z)
    return BUDGET if newton + inner >= budget else IPM, newton, inner


@inlined
def _keep_better(
    L: Array,
    G: Array,
    S: Array,
    limits: Array,
    dt: float,
    desired: float,
    last: Array,
    points: Array,
    squares: Array,
    vectors: Array,
) -> None:
    """Replace λ by the gains of the last solve, if these, shortened, certify more."""
    n, joints = S.shape
    found, kept, speed = points[0], points[1], vectors[0, :joints]
    for i in range(n):
        kept[i] = last[i] / desired
    _fit(S, limits, found[:n], speed)
    _fit(S, limits, kept[:n], speed)
    beta = _certified(L, G, found[:n], dt, math.nan, squares, vectors)
    kept[n] = _certified(L, G, kept[:n], dt, math.nan, squares, vectors)
    if kept[n] > beta:
        for i in range(n + 1):
            found[i] = kept[i]


@kernel(
    "Tuple((f8, f8, f8, f8, b1))(f8[:,::1], f8[:,::1], f8[:,::1], f8[:,::1], f8, f8, f8[:,::1],"
    " f8[:,::1], f8[:,::1], f8[:,:,::1], f8[:,::1])"
)
def conclude(
    L: Array,
    G: Array,
    S: Array,
    limits: Array,
    dt: float,
    delta: float,
    points: Array,
    Z: Array,
    z: Array,
    squares: Array,
    vectors: Array,
) -> tuple[float, float, float, float, bool]:
    """What is known of gains, wherever they come from; in the units of β̃ = 1, as for `optimise`.

    Gains that break a limit are shortened; without a certificate they become 0. S λ is left in the
    first of the vectors.

    Returns:
        β, slack of the matrix inequality, margin of the limits, gap, whether there is a certificate.
    """
    n, joints = S.shape
    x, speed = points[0], vectors[0, :joints]
    _fit(S, limits, x[:n], speed)
    beta = _certified(L, G, x[:n], dt, x[n], squares, vectors)
    kept = beta > NOTHING
    if not kept:
        beta = 0.0
        for i in range(n + 1):
            x[i] = 0.0
    margin = _fit(S, limits, x[:n], speed)
    gap = duality_gap(L, G, S, limits, dt, delta, x[:n], beta, Z, z, squares[0], squares[1])
    return beta, beta - x[n], margin, gap, kept


@kernel(
    "Tuple((i8, i8, i8, i8, i8, i8, f8, f8, f8, f8, f8))(f8[:,::1], f8[::1], f8[::1], i8[::1],"
    " f8[::1], f8[:,::1], f8, f8, f8, f8, i8, f8[:,::1], f8[:,::1], i8[:,::1], i8[::1], f8[::1],"
    " f8[:,:,::1], f8[:,:,::1], f8[:,::1], f8[:,::1], f8[:,::1], f8[:,::1], f8[:,:,::1], f8[::1],"
    " f8[::1])"
)
def sdp_gains_kernel(
    jacobian: Array,
    errors: Array,
    rates: Array,
    offsets: Indices,
    weights: Array,
    speeds: Array,
    dt: float,
    desired: float,
    delta: float,
    damping: float,
    budget: int,
    points: Array,
    Y: Array,
    integers: Indices,
    counts: Indices,
    nu: Array,
    squares: Array,
    wide: Array,
    own: Array,
    K: Array,
    H: Array,
    vectors: Array,
    sides: Array,
    gains: Array,
    dq: Array,
) -> tuple[int, int, int, int, int, int, float, float, float, float, float]:
    """Solve one problem; `SdpGains` describes the arguments and has the shapes of the scratch.

    Args:
        jacobian, errors, rates, offsets: (n, joints), (n,), (n,), (h + 1,).
        weights: of the squared errors in V, (n,).
        speeds: lower and upper limits of dq, (2, joints).
        dt, desired, delta, damping, budget: Δt, β̃, δ, d, iterations.
        points, Y, integers, counts, nu: of the last solve; (2, n + 1), (any, n), (4, n), (2,),
            (n,).
        squares, wide, own, K, H, vectors, sides: scratch.
        gains: λ of the last solve, overwritten.
        dq: written; zeros where there is no answer.

    Returns:
        Status, path, rank of the Jacobian, of Z, Newton steps, iterations of the interior-point
        method, β, slack of the matrix inequality, margin of dq, gap, factor of the rates.
    """
    n, joints = jacobian.shape
    known = gains.size == n and dq.size == joints
    if not (known and errors.size == n and rates.size == n and weights.size == n):
        return BAD_SHAPE, NONE, 0, 0, 0, 0, 0.0, 0.0, 0.0, math.inf, 0.0
    L, G, Z = squares[0], squares[1], squares[2]
    room, z, B, S = sides[0], sides[1], wide[1], wide[2]
    for r in range(joints):
        dq[r] = 0.0
    fit = 0.0 < dt <= MAX and 0.0 < desired <= MAX and 0.0 < delta <= MAX
    fit = fit and 0.0 <= damping <= MAX
    if not fit or _unfit(jacobian, errors, rates, weights, speeds):
        _forget(gains, counts)
        return BAD_INPUT, NONE, 0, 0, 0, 0, 0.0, 0.0, 0.0, math.inf, 0.0
    for i in range(n):
        vectors[0, i] = math.sqrt(weights[i])
    task_rank = prioritised(
        jacobian,
        offsets,
        damping,
        vectors[0, :n],
        L,
        B,
        wide[0],
        squares[3],
        squares[4],
        squares[5],
        own,
    )
    share = _feed_forward(B, rates, speeds, dq)
    for r in range(joints):
        for side in range(2):
            room[side, r] = (speeds[side, r] - dq[r]) / desired
    for i in range(n):
        for j in range(n):
            G[i, j] = 0.0
        for r in range(joints):
            S[i, r] = errors[i] * B[i, r]
    gram(G, 1.0, L, n, vectors[0])
    for i in range(n):
        for j in range(i):
            G[i, j] = G[j, i]
    block, before, same = integers[0], integers[3], True
    find_blocks(L, block)
    for i in range(n):
        same = same and block[i] == before[i]
        before[i] = block[i]
    if not same:
        counts[0] = 0
    path, newton, inner = optimise(
        L,
        G,
        S,
        room,
        dt * desired,
        delta,
        budget,
        points,
        Y,
        integers,
        counts,
        nu,
        Z,
        z,
        squares[3:],
        K,
        H,
        vectors,
        sides[2:],
    )
    if path == BUDGET:
        _keep_better(L, G, S, room, dt * desired, desired, gains, points, squares[3:], vectors)
    beta, slack, margin, gap, kept = conclude(
        L, G, S, room, dt * desired, delta, points, Z, z, squares[3:], vectors
    )
    x, speed = points[0], vectors[0, :joints]
    if not kept:
        counts[0] = 0
        path = NONE if path != BUDGET else BUDGET
    finite = abs(beta * desired) <= MAX
    for r in range(joints):
        dq[r] = min(max(dq[r] + desired * speed[r], speeds[0, r]), speeds[1, r])
    for i in range(n):
        gains[i] = desired * x[i]
    if not finite or not_finite(gains) or not_finite(dq):
        _forget(gains, counts)
        for r in range(joints):
            dq[r] = 0.0
        return OUT_OF_RANGE, NONE, 0, 0, newton, inner, 0.0, 0.0, 0.0, math.inf, 0.0
    status = OK if gap <= PROVED else UNSOLVED
    if path == BUDGET:
        status = SPENT
    elif path == NONE:
        status = STATIONARY
    return (
        status,
        path,
        task_rank,
        counts[0],
        newton,
        inner,
        desired * beta,
        desired * slack,
        desired * margin,
        desired * desired * gap,
        share,
    )
