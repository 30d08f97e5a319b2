"""The gains of prioritised tasks with a certificate, from Jacobians and errors, in one call.

Marti-Saumell et al.: min (β − β̃)² + δ|λ|² such that V falls by V⁺ ≤ (1 − β Δt) V, and the joint
speeds dq = B(Λ e + L⁻¹ rates) stay within their limits. From the last two answers Newton's method
takes two or three steps (`newton_kernels`); where it does not arrive, an interior-point method
comes near enough for it (`interior_point_kernels`). Either may stop early: whatever λ is returned,
β is what it certifies, λ_min(C(λ, 0)), and a gap of duality says how far from optimal it may be.
"""

from __future__ import annotations

import math

from hoap3.protocol.runtime.numba_jit import IndexRows, Indices, Matrix, Vector, inlined, kernel
from hoap3.remote_controller.solvers.base.status import (
    BAD_INPUT,
    BAD_SHAPE,
    ITERATION_LIMIT,
    OK,
    OUT_OF_RANGE,
    STATIONARY,
    UNSOLVED,
)
from hoap3.remote_controller.solvers.clik.clik_kernels import (
    Basis,
    feed_forward,
    moves,
    prioritised,
    solve_loop,
    unfit,
)
from hoap3.remote_controller.solvers.clik.lmi_kernels import find_blocks
from hoap3.remote_controller.solvers.linalg.dense_kernels import MAX, dot, not_finite
from hoap3.remote_controller.solvers.linalg.tiled_product_kernels import syrk
from hoap3.remote_controller.solvers.sdp.certificate_kernels import certify, keep_better
from hoap3.remote_controller.solvers.sdp.driver_kernels import BUDGET, NONE, WARM, optimise

PROVED = 1e-9  # of β̃²: a gap up to that proves that the gains are optimal
FASTEST = 100.0  # of 1/Δt: a larger β̃, the unit of what is computed, counts as this one


@inlined
def _forget(gains: Vector, counts: Indices) -> None:
    """Stand still, and begin anew the next time."""
    for i in range(gains.size):
        gains[i] = 0.0
    counts[0], counts[1], counts[5] = 0, 0, 0


@inlined
def _look_ahead(
    points: Matrix, Y: Matrix, nu: Vector, integers: IndexRows, counts: Indices, past: Matrix
) -> None:
    """Go on from the last answers along a parabola, or a line, where the same was active in them.

    What is guessed decides how many of Newton's steps are left, and nothing else.

    Args:
        points: λ and β, (4, n + 1) or longer: the last answer, overwritten by the guess; scratch;
            the answer before, written; the way from there to here, written.
        Y, nu: the last answer's; overwritten by the guess.
        integers: its homes and held limits in rows 1 and 2, those before in rows 4 and 5; written.
        counts: rank and held limits of it, and of the one before (rank 0 where no way leads from
            there), and for how many ticks they have been the same, (5,) or longer; written.
        past: Y of the answer before and the way from there to here, (2n, n), and so of ν, (2, n);
            written.
    """
    n, x, before, way = nu.size, points[0], points[2], points[3]
    same = 0 < counts[0] <= n and counts[0] == counts[2] and counts[1] == counts[3]
    for side in range(2):
        for a in range(min(counts[side], n)):
            same = same and integers[1 + side, a] == integers[4 + side, a]
            integers[4 + side, a] = integers[1 + side, a]
    counts[2], counts[3] = counts[0], counts[1]
    counts[4] = counts[4] + 1 if same else 0
    ahead, bend = 1.0 if same else 0.0, 1.0 if counts[4] > 1 else 0.0
    for k in range(min(counts[0], n)):
        last, steps = past[k], past[n + k]
        sign = 1.0 if dot(Y[k], last) >= 0.0 else -1.0  # Y Yᵀ says nothing of it
        for i in range(n):
            step = Y[k, i] - sign * last[i]
            turn = step - sign * steps[i]
            last[i], steps[i] = Y[k, i], step
            Y[k, i] += ahead * (step + bend * turn)
    for i in range(n + 1):
        step = x[i] - before[i]
        turn = step - way[i]
        before[i], way[i] = x[i], step
        x[i] += ahead * (step + bend * turn)
    for i in range(n):
        step = nu[i] - past[2 * n, i]
        turn = step - past[2 * n + 1, i]
        past[2 * n, i], past[2 * n + 1, i] = nu[i], step
        nu[i] += ahead * (step + bend * turn) if i < counts[1] else 0.0


@kernel()
def sdp_gains_kernel(  # noqa: PLR0912, PLR0915 - one case after the other
    jacobian: Matrix,
    errors: Vector,
    dt: float,
    desired: float,
    delta: float,
    damping: float,
    budget: int,
    plan: Indices,
    rows: Matrix,
    tall: Matrix,
    unknowns: Matrix,
) -> tuple[int, int, int, int, int, int, float, float, float, float, float]:
    """Solve one problem. Arrays of one width share a block: to hand an array over costs 0.1 µs.

    Args:
        jacobian, errors: (n, joints), (n,).
        dt, desired, delta, damping, budget: Δt, β̃, δ, d, iterations.
        plan: `counts` of `_look_ahead` and `optimise`, (6,); blocks of L, homes of the y_k, limits
            that hold, of the last solve, and those of the one before, (6, n); where each task
            begins, and n, (h + 1,).
        rows: rates; weights of the squared errors in V; λ of the last solve, overwritten; ν of the
            last; its Y, (n, n); what `_look_ahead` remembers of Y and ν, (2n + 2, n); then scratch,
            (16, n, n).
        tall: lower and upper limits of dq; dq, written, zeros where there is no answer; then
            scratch, (3n + 14, joints); what moving targets take of dq, written.
        unknowns: `points` of `_look_ahead` and `optimise` in the first n + 1 columns, 5 rows; then
            scratch: 6 rows and as many as `optimise` has unknowns, each as long, or as the joints,
            whichever is more.

    Returns:
        Status, path, rank of the Jacobian, of Z, Newton steps, iterations of the interior-point
        method, β, slack of the matrix inequality, margin of dq, gap, share of `feed_forward`.
    """
    n, joints = jacobian.shape
    if not (errors.size == n and rows.shape[1] == n and tall.shape[1] == joints):
        return BAD_SHAPE, NONE, 0, 0, 0, 0, 0.0, 0.0, 0.0, math.inf, 1.0
    counts, integers, offsets = plan[:6], plan[6 : 6 + 6 * n].reshape(6, n), plan[6 + 6 * n :]
    rates, weights, gains, nu, Y = rows[0], rows[1], rows[2], rows[3], rows[4 : 4 + n]
    past, squares = rows[4 + n : 6 + 3 * n], rows[6 + 3 * n :].reshape(16, n, n)
    speeds, dq, fed = tall[:2], tall[2], tall[17 + 3 * n]
    Q, B, S = tall[3 : 3 + n], tall[3 + n : 3 + 2 * n], tall[3 + 2 * n : 3 + 3 * n]
    sides = tall[3 + 3 * n : 17 + 3 * n].reshape(7, 2, joints)
    points, vectors, K = unknowns[:5], unknowns[5:11], unknowns[11:]
    L, G, Z, spare = squares[0], squares[1], squares[2], squares[3:]
    room, z = sides[0], sides[1]
    fed_share = 1.0
    for r in range(joints):
        dq[r], fed[r] = 0.0, 0.0
    fit = 0.0 < dt <= MAX and 0.0 < desired <= MAX and 0.0 < delta <= MAX
    fit = fit and 0.0 <= damping <= MAX
    if not fit or unfit(jacobian, errors, rates, weights, speeds):
        _forget(gains, counts)
        return BAD_INPUT, NONE, 0, 0, 0, 0, 0.0, 0.0, 0.0, math.inf, 1.0
    desired = min(desired, FASTEST / dt)
    for i in range(n):
        vectors[0, i] = math.sqrt(weights[i])
    basis = Basis(Q, spare[0], spare[1], spare[2], K, vectors[2, :n])
    task_rank = prioritised(jacobian, offsets, damping, vectors[0, :n], L, B, basis)
    if moves(rates):
        roots, through = vectors[0, :n], vectors[1, :n]
        regular = damping == 0.0 and solve_loop(L, offsets, roots, rates, spare[0], through)
        fed_share = feed_forward(B, rates, through, regular, speeds, fed)
    for r in range(joints):
        dq[r] = fed[r]
        room[0, r] = min(speeds[0, r] - dq[r], 0.0) / desired
        room[1, r] = max(speeds[1, r] - dq[r], 0.0) / desired
    for i in range(n):
        for j in range(n):
            G[i, j] = 0.0
        for r in range(joints):
            S[i, r] = errors[i] * B[i, r]
    syrk(G, 1.0, L, n)
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
    _look_ahead(points, Y, nu, integers, counts, past)
    problem = L, G, S, room, dt * desired, delta
    path, newton, inner = optimise(
        *problem, budget, points, Y, integers, counts, nu, Z, z, spare, K, vectors, sides[2:]
    )
    if path != WARM:
        counts[2] = 0  # no way leads from the answer before to this one
    if path == BUDGET:
        keep_better(L, G, S, room, dt * desired, desired, gains, points, spare, vectors)
    beta, slack, margin, gap, kept = certify(*problem, points, Z, z, spare, vectors)
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
            dq[r], fed[r] = 0.0, 0.0
        return OUT_OF_RANGE, NONE, 0, 0, newton, inner, 0.0, 0.0, 0.0, math.inf, 1.0
    status = OK if gap <= PROVED else UNSOLVED
    if path == BUDGET:
        status = ITERATION_LIMIT
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
        fed_share,
    )
