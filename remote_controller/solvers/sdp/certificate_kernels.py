"""What gains certify, whether they keep the limits, and how far from optimal they may be.

Wherever the gains come from: a solver that ends early, or another one. Units are those of β̃ = 1.
"""

from __future__ import annotations

import math

from hoap3.protocol.runtime.numba_jit import Matrix, Vector, inlined, kernel
from hoap3.remote_controller.solvers.clik.lmi_kernels import least_eigenvalue, stability_matrix
from hoap3.remote_controller.solvers.sdp.memory_kernels import Check, Dual, Program

NOTHING = 1e-8  # of β̃: a β up to that is no certificate
OVER = 1e-9  # of 1 + |limit|: what is cut off as rounding


@kernel()
def fit(St: Matrix, limits: Matrix, gains: Vector, speed: Vector) -> float:
    """Write S λ, with λ shortened until it keeps the limits; how near it comes to them.

    St: Sᵀ, (n, joints); limits: (2, joints); gains: λ, (n,); speed: written, (joints,).
    """
    n, share = St.shape[0], 1.0
    for r in range(speed.size):
        speed[r] = 0.0
    for i in range(n):
        for r in range(speed.size):
            speed[r] += gains[i] * St[i, r]
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


@inlined
def _duality_gap(program: Program, gains: Vector, beta: float, dual: Dual, check: Check) -> float:
    """How much less than that of feasible (λ, β) the objective may be, in the units of β̃ = 1.

    `check` has C(λ, 0), V and S λ. For any Z ⪰ 0 and z ≥ 0 the Lagrange function is a bound from
    below where it is least (weak duality). It is quadratic, with a Hessian of 2δ (λ) and 2 (β) at
    least, so it falls below its value here by |g_λ|²/4δ + g_β²/4 at most, g its gradient. By the
    same curvature of the objective |β − β*|² ≤ gap and δ|λ − λ*|² ≤ gap.
    """
    St, limits, delta, Z, z = program.St, program.limits, program.delta, dual.Z, dual.z
    C, V, speed = check.C, check.V, check.speed
    n, joints = St.shape
    gap, trace, pulled = 0.0, 0.0, False
    for r in range(joints):
        if z[1, r] > 0.0:
            gap += z[1, r] * (limits[1, r] - speed[r])
            pulled = True
        if z[0, r] > 0.0:
            gap += z[0, r] * (speed[r] - limits[0, r])
            pulled = True
    for i in range(n):
        trace += Z[i, i]
        for j in range(n):
            gap += C[i, j] * Z[i, j]
    slope = 2.0 * (beta - 1.0) + trace  # g_β
    gap += 0.25 * slope * slope - beta * trace
    for i in range(n):
        slope = 2.0 * delta * gains[i]  # g_λ
        if pulled:
            for r in range(joints):
                slope += St[i, r] * (z[1, r] - z[0, r])
        for k in range(n):
            slope -= 2.0 * V[k, i] * Z[k, i]
        gap += 0.25 * slope * slope / delta
    return gap


@inlined
def certified(program: Program, gains: Vector, check: Check) -> float:
    """The largest β of (20), β(λ) = λ_min(C(λ, 0))."""
    stability_matrix(program.L, program.G, gains, 0.0, program.dt, check.C, check.V)
    return least_eigenvalue(check.C, math.nan, 0.0, check.eigen)


@kernel()
def certify(
    program: Program, x: Vector, dual: Dual, check: Check
) -> tuple[float, float, float, float, bool]:
    """What is known of gains, wherever they come from; in the units of β̃ = 1, as for `optimise`.

    Gains that break a limit are shortened; without a certificate they become 0. `check` is left
    with S λ.

    Returns:
        β, slack of the matrix inequality, margin of the limits, gap, whether V is proved to fall.
    """
    L, G, St, limits, dt = program.L, program.G, program.St, program.limits, program.dt
    C, V, W = check.C, check.V, check.W
    n = St.shape[0]
    gains = x[:n]
    margin = fit(St, limits, gains, check.speed)
    stability_matrix(L, G, gains, 0.0, dt, C, V)
    for i in range(n):
        for j in range(n):
            W[i, j] = C[i, j]
    beta = least_eigenvalue(W, float(x[n]), 0.0, check.eigen)
    kept = beta > NOTHING
    if not kept:
        beta = 0.0
        for i in range(n + 1):
            x[i] = 0.0
        margin = fit(St, limits, gains, check.speed)
        stability_matrix(L, G, gains, 0.0, dt, C, V)
    gap = _duality_gap(program, gains, beta, dual, check)
    return beta, beta - float(x[n]), margin, gap, kept


@inlined
def keep_better(
    program: Program, desired: float, last: Vector, found: Vector, kept: Vector, check: Check
) -> None:
    """Replace λ by the gains of the last solve, if these, shortened, certify more.

    `last` are these gains [1/s]; kept: (n + 1,), scratch: the same in the units of β̃, and β.
    """
    n = program.St.shape[0]
    for i in range(n):
        kept[i] = last[i] / desired
    fit(program.St, program.limits, found[:n], check.speed)
    fit(program.St, program.limits, kept[:n], check.speed)
    beta = certified(program, found[:n], check)
    kept[n] = certified(program, kept[:n], check)
    if kept[n] > beta:
        for i in range(n + 1):
            found[i] = kept[i]
