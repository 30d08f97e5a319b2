"""The gains of prioritised tasks with a certificate, from Jacobians and errors, in one call.

Marti-Saumell et al.: min (β − β̃)² + δ|λ|² such that V falls by V⁺ ≤ (1 − β Δt) V, and the joint
speeds dq = B(Λ e + x), x of `clik_kernels.feed_forward`, stay within their limits. From the
last two answers Newton's method takes two or three steps (`newton_kernels`); where it does not
arrive, an interior-point method comes near enough for it (`interior_point_kernels`).
Either may stop early: whatever λ is returned, β is what it certifies, λ_min(C(λ, 0)), and a gap of
duality says how far from optimal it may be.
"""

from __future__ import annotations

import math

from hoap3.protocol.runtime.numba_jit import Indices, Matrix, Vector, inlined, kernel
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
    feed_forward,
    moves,
    prioritised,
    solve_loop,
    unfit,
)
from hoap3.remote_controller.solvers.clik.lmi_kernels import find_blocks
from hoap3.remote_controller.solvers.linalg.dense_kernels import MAX, dot, not_finite
from hoap3.remote_controller.solvers.linalg.tiled_product_kernels import syrk
from hoap3.remote_controller.solvers.sdp.certificate_kernels import OVER, certify, keep_better
from hoap3.remote_controller.solvers.sdp.driver_kernels import BUDGET, NONE, WARM, optimise
from hoap3.remote_controller.solvers.sdp.memory_kernels import (
    ENDED,
    HOLDING,
    HOLDING_BEFORE,
    RANK,
    RANK_BEFORE,
    SAME,
    Active,
    Past,
    Points,
    Program,
    named,
)

PROVED = 1e-9  # of β̃²: a gap up to that proves that the gains are optimal
FASTEST = 100.0  # of 1/Δt: a larger β̃, the unit of what is computed, counts as this one


Answer = tuple[int, int, int, int, int, int, float, float, float, float, float, bool]
"""What `sdp_gains_kernel` says of its answer; `SdpGains` has attributes of these names.

A plain tuple: one with names takes half a microsecond more on its way to Python.

    status, path: see `solvers.base.status` and `driver_kernels`.
    task_rank, rank: of the Jacobian, and of Z.
    newton, inner: iterations of Newton's and of the interior-point method.
    beta, slack: β and the slack of the matrix inequality [1/s].
    margin: how near dq comes to its limits [rad/s].
    gap: of duality [1/s²].
    fed_share: of `clik_kernels.feed_forward`.
    cut: whether dq was cut off at its limits; β says nothing of it then.
"""


@inlined
def _refused(status: int, newton: int, inner: int) -> Answer:
    """No answer."""
    return status, NONE, 0, 0, newton, inner, 0.0, 0.0, 0.0, math.inf, 1.0, False


@inlined
def _forget(gains: Vector, counts: Indices) -> None:
    """Stand still, and begin anew the next time."""
    for i in range(gains.size):
        gains[i] = 0.0
    counts[RANK], counts[HOLDING], counts[ENDED] = 0, 0, 0


@inlined
def _look_ahead(points: Points, active: Active, past: Past) -> None:
    """Go on from the last answers along a parabola, or a line, where the same was active in them.

    What is guessed decides how many of Newton's steps are left, and nothing else.

    Args:
        points: x: the last answer, overwritten by the guess; before and way: of the tick before.
        active: the last answer's; Y and ν are overwritten by the guess.
        past: of the tick before; overwritten.
    """
    x, before, way, Y, nu, counts = (
        points.x, points.before, points.way, active.Y, active.nu, active.counts
    )  # fmt: skip
    n = nu.size
    same = (
        0 < counts[RANK] <= n
        and counts[RANK] == counts[RANK_BEFORE]
        and counts[HOLDING] == counts[HOLDING_BEFORE]
    )
    for k in range(min(counts[RANK], n)):
        same = same and active.home[k] == past.home[k]
        past.home[k] = active.home[k]
    for a in range(min(counts[HOLDING], n)):
        same = same and active.held[a] == past.held[a]
        past.held[a] = active.held[a]
    counts[RANK_BEFORE], counts[HOLDING_BEFORE] = counts[RANK], counts[HOLDING]
    counts[SAME] = counts[SAME] + 1 if same else 0
    ahead, bend = 1.0 if same else 0.0, 1.0 if counts[SAME] > 1 else 0.0
    for k in range(min(counts[RANK], n)):
        last, steps = past.Y[k], past.Y_way[k]
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
        step = nu[i] - past.nu[i]
        turn = step - past.nu_way[i]
        past.nu[i], past.nu_way[i] = nu[i], step
        nu[i] += ahead * (step + bend * turn) if i < counts[HOLDING] else 0.0


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
) -> Answer:
    """Solve one problem.

    Where what is fed forward breaks the limits of dq and Λ e does not take all joints back within
    them, dq is cut off, each joint by itself: it is no B(Λ e + x), and β, which is that of the
    gains, says nothing of it: `cut` tells.

    Args:
        jacobian, errors: (n, joints), (n,).
        dt, desired, delta, damping, budget: Δt, β̃, δ, d, iterations.
        plan, rows, tall, unknowns: blocks of `memory_kernels.Memory`, as `layout` names them;
            gains and dq are written, zeros where there is no answer.

    Returns:
        See `Answer`.
    """
    n, joints = jacobian.shape
    if not (errors.size == n and rows.shape[1] == n and tall.shape[1] == joints):
        return _refused(BAD_SHAPE, 0, 0)
    m = named(plan, rows, tall, unknowns)
    points, active, past, check = m.points, m.active, m.past, m.work.check
    counts, gains, dq, fed, room = active.counts, m.gains, m.dq, m.fed, m.limits
    L, G, St, Bt, fed_share = m.L, m.G, m.St, m.Bt, 1.0
    for r in range(joints):
        dq[r], fed[r] = 0.0, 0.0
    fit = 0.0 < dt <= MAX and 0.0 < desired <= MAX and 0.0 < delta <= MAX
    fit = fit and 0.0 <= damping <= MAX
    if not fit or unfit(jacobian, errors, m.rates, m.weights, m.speeds):
        _forget(gains, counts)
        return _refused(BAD_INPUT, 0, 0)
    desired = min(desired, FASTEST / dt)
    for i in range(n):
        m.roots[i] = math.sqrt(m.weights[i])
    task_rank = prioritised(jacobian, m.offsets, damping, m.roots, L, Bt, m.basis)
    if moves(m.rates):
        regular = damping == 0.0 and solve_loop(L, m.offsets, m.roots, m.rates, m.U, m.through)
        fed_share = feed_forward(Bt, m.rates, m.through, regular, m.speeds, fed)
    for r in range(joints):
        dq[r] = fed[r]
        room[0, r] = min(m.speeds[0, r] - dq[r], 0.0) / desired
        room[1, r] = max(m.speeds[1, r] - dq[r], 0.0) / desired
    for i in range(n):
        for j in range(n):
            G[i, j] = 0.0
        for r in range(joints):
            St[i, r] = errors[i] * Bt[i, r]  # (24), Sᵀ = diag(e) Bᵀ
    syrk(G, 1.0, L, n)
    for i in range(n):
        for j in range(i):
            G[i, j] = G[j, i]
    same = True
    find_blocks(L, active.block)
    for i in range(n):
        same = same and active.block[i] == past.block[i]
        past.block[i] = active.block[i]
    if not same:
        counts[RANK] = 0
    _look_ahead(points, active, past)
    program = Program(L, G, St, room, dt * desired, delta)
    path, newton, inner = optimise(program, budget, points, active, m.dual, m.work)
    if path != WARM:
        counts[RANK_BEFORE] = 0  # no way leads from the answer before to this one
    if path == BUDGET:
        keep_better(program, desired, gains, points.x, m.kept, check)
    beta, slack, margin, gap, kept = certify(program, points.x, m.dual, check)
    x, speed = points.x, check.speed
    if not kept:
        counts[RANK] = 0
        path = NONE if path != BUDGET else BUDGET
    finite = abs(beta * desired) <= MAX
    cut = False
    for r in range(joints):
        whole = dq[r] + desired * speed[r]  # B(Λ e + x)
        dq[r] = min(max(whole, m.speeds[0, r]), m.speeds[1, r])
        cut = cut or abs(whole - dq[r]) > OVER * (1.0 + abs(dq[r]))
    for i in range(n):
        gains[i] = desired * x[i]
    if not finite or not_finite(gains) or not_finite(dq):
        _forget(gains, counts)
        for r in range(joints):
            dq[r], fed[r] = 0.0, 0.0
        return _refused(OUT_OF_RANGE, newton, inner)
    status = OK if gap <= PROVED else UNSOLVED
    if path == BUDGET:
        status = ITERATION_LIMIT
    elif path == NONE:
        status = STATIONARY
    return (
        status,
        path,
        task_rank,
        counts[RANK],
        newton,
        inner,
        desired * beta,
        desired * slack,
        desired * margin,
        desired * desired * gap,
        fed_share,
        cut,
    )
