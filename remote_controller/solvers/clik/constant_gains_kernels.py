"""Joint speeds by constant gains of prioritised tasks, and what is proved of them, in one call."""

from __future__ import annotations

import math

from hoap3.protocol.runtime.numba_jit import Cube, Indices, Matrix, Vector, kernel
from hoap3.remote_controller.solvers.base.status import BAD_INPUT, BAD_SHAPE, OK, OUT_OF_RANGE
from hoap3.remote_controller.solvers.clik.clik_kernels import (
    Basis,
    feed_forward,
    moves,
    prioritised,
    solve_loop,
    unfit,
)
from hoap3.remote_controller.solvers.clik.lmi_kernels import least_eigenvalue, stability_matrix
from hoap3.remote_controller.solvers.linalg.dense_kernels import MAX, add, not_finite
from hoap3.remote_controller.solvers.linalg.tiled_product_kernels import syrk

ACCURACY = 1e-9  # of β, relative


@kernel()
def constant_gains_kernel(  # noqa: PLR0912 - one step after the other
    jacobian: Matrix,
    errors: Vector,
    rates: Vector,
    offsets: Indices,
    weights: Vector,
    speeds: Matrix,
    dt: float,
    damping: float,
    wanted: Vector,
    by_tasks: Cube,
    by_joints: Cube,
    P: Matrix,
    lines: Matrix,
    gains: Vector,
    dq: Vector,
) -> tuple[int, int, float, float]:
    """Write dq = B(Λ e + x) and the gains Λ, shortened alike until dq keeps its limits.

    x is what `feed_forward` feeds for moving targets. Where B x breaks the limits, and no shortened
    Λ e takes all joints back within them, the gains are 0 and B x is cut off, each joint by itself.

    Args:
        jacobian, errors, rates, offsets: (n, joints), (n,), (n,), (h + 1,).
        weights: of the squared errors in V, (n,).
        speeds: lower and upper limits of dq, which hold lower ≤ 0 ≤ upper, and what moving
            targets take of dq, written; (3, joints).
        dt, damping: Δt, d.
        wanted: λ, (n,).
        by_tasks: memory of the (n, n) matrices L; G = LᵀL; C(λ, 0) and V of `stability_matrix`; U
            of `solve_loop`; R, M and T of `Basis`; (8, n, n).
        by_joints: memory of the (n, joints) matrices Bᵀ, and Q of `Basis`; (2, n, joints).
        P: memory of P of `Basis`, (n, 2n).
        lines: memory of the roots √w, (n,), the diagonal of D; of B Λ e, (joints,); of L₀⁻¹ rates,
            (n,); and of the lengths of `Basis`, (n,); the first three then of `least_eigenvalue`;
            (4, n or joints, whichever is more).
        gains, dq: written, (n,) and (joints,); zeros where there is no answer.

    Returns:
        Status, rank of the Jacobian, β of the gains that are written, share of `feed_forward`.
    """
    n, joints = jacobian.shape
    known = gains.size == n and dq.size == joints and wanted.size == n
    if not (known and errors.size == n and rates.size == n and weights.size == n):
        return BAD_SHAPE, 0, 0.0, 1.0
    fed, fed_share = speeds[2], 1.0
    for r in range(joints):
        dq[r], fed[r] = 0.0, 0.0
    for i in range(n):
        gains[i] = 0.0
    fit = 0.0 < dt <= MAX and 0.0 <= damping <= MAX and not not_finite(wanted)
    if not fit or unfit(jacobian, errors, rates, weights, speeds):
        return BAD_INPUT, 0, 0.0, 1.0
    L, G, C, V, U = by_tasks[0], by_tasks[1], by_tasks[2], by_tasks[3], by_tasks[4]
    Bt = by_joints[0]  # Bᵀ
    basis = Basis(by_joints[1], by_tasks[5], by_tasks[6], by_tasks[7], P, lines[3, :n])
    roots, move, through = lines[0, :n], lines[1, :joints], lines[2, :n]
    for i in range(n):
        roots[i] = math.sqrt(weights[i])
    rank = prioritised(jacobian, offsets, damping, roots, L, Bt, basis)
    for r in range(joints):
        move[r] = 0.0
    if moves(rates):
        regular = damping == 0.0 and solve_loop(L, offsets, roots, rates, U, through)
        fed_share = feed_forward(Bt, rates, through, regular, speeds, fed)
    for r in range(joints):
        dq[r] = fed[r]
    for i in range(n):  # B Λ e, (7)
        add(move, wanted[i] * errors[i], Bt[i])
    share, least = 1.0, 0.0  # of Λ e: the largest and the least that keep the limits
    for r in range(joints):
        if dq[r] + move[r] > speeds[1, r]:
            share = min(share, (speeds[1, r] - dq[r]) / move[r])
        if dq[r] + move[r] < speeds[0, r]:
            share = min(share, (speeds[0, r] - dq[r]) / move[r])
        if dq[r] > speeds[1, r]:
            least = max(least, (speeds[1, r] - dq[r]) / move[r] if move[r] < 0.0 else math.inf)
        if dq[r] < speeds[0, r]:
            least = max(least, (speeds[0, r] - dq[r]) / move[r] if move[r] > 0.0 else math.inf)
    share = max(share, 0.0) if least <= share else 0.0
    for r in range(joints):
        dq[r] = min(max(dq[r] + share * move[r], speeds[0, r]), speeds[1, r])
    for i in range(n):
        gains[i] = share * wanted[i]
        for j in range(n):
            G[i, j] = 0.0
    syrk(G, 1.0, L, n)
    for i in range(n):
        for j in range(i):
            G[i, j] = G[j, i]
    stability_matrix(L, G, gains, 0.0, dt, C, V)
    beta = least_eigenvalue(C, 0.0, ACCURACY, lines)  # the largest β of (20)
    if not_finite(dq) or not abs(beta) <= MAX:
        for r in range(joints):
            dq[r], fed[r] = 0.0, 0.0
        return OUT_OF_RANGE, 0, 0.0, 1.0
    return OK, rank, beta, fed_share
