"""A primal-dual interior-point method for the gains, on the n × n matrix inequality.

    min (β − 1)² + δ|λ|²   subject to   C(λ, β) ⪰ 0,  lower ≤ S λ ≤ upper,

which is (27) of Marti-Saumell et al. in units of β̃ = 1.

Predictor and corrector, after Mehrotra, along the direction of Helmberg, Rendl, Vanderbei and
Wolkowicz (SIAM Journal on Optimization 6, 1996). What a step aims at is told by the length of the
one before, not by that of the predictor, which saves two of four eigenvalues. C is quadratic in λ
and concave, so no larger matrix that is linear in λ is needed: its curvature enters the Hessian,
2Δt G∘Z, and the linearised condition C Z = μI. Every iterate has C ≻ 0; λ = 0 with β = −1 is the
first. The distances to the limits are unknowns of their own and positive, so a limit of 0 does no
harm; the others are kept throughout.
"""

from __future__ import annotations

import math

from hoap3.protocol.runtime.numba_jit import Matrix, Vector, inlined, kernel
from hoap3.remote_controller.solvers.clik.lmi_kernels import least_eigenvalue, stability_matrix
from hoap3.remote_controller.solvers.linalg.dense_kernels import (
    add,
    add_rows,
    dot,
    solve_lower,
    solve_upper,
)
from hoap3.remote_controller.solvers.linalg.small_product_kernels import (
    clear,
    dot_column,
    mirror,
    root_inverse,
    times,
    transposed_times,
)
from hoap3.remote_controller.solvers.linalg.tiled_product_kernels import factorise, syrk
from hoap3.remote_controller.solvers.sdp.memory_kernels import (
    Dual,
    Iterate,
    Program,
    Slacks,
    Step,
)

ROOM = 1e-10  # limits closer to 0 than that on both sides let nothing move
SHARE = 0.1  # of the largest entry of S: a limit closer to 0 is kept only in the end
SPRING = 1e10  # holds a joint that may not move at all, whose two limits leave no interior
COARSE = 1e-2  # accuracy of the eigenvalues that tell how far a step may go
CENTRED, LEAST_CENTRED = 0.4, 1e-5  # of μ: what a step aims at after one of length 0, and of 1
SMALL = 1e-3  # step: nothing is gained any more


@kernel(superwords=True)
def _reach(P: Matrix, D: Matrix, product: Matrix, scaled: Matrix, eigen: Matrix) -> float:
    """The longest step a, with A + a D ⪰ 0 where P A Pᵀ = I: −1/λ_min(P D Pᵀ).

    product, scaled: (n, n), written: P D and P D Pᵀ; eigen: of `least_eigenvalue`.
    """
    n = P.shape[0]
    times(P, D, product)
    for i in range(n):
        for j in range(i + 1):
            scaled[i, j] = dot(product[i, : j + 1], P[j, : j + 1])
            scaled[j, i] = scaled[i, j]
    least = least_eigenvalue(scaled, math.nan, COARSE, eigen)
    return -1.0 / least if least < 0.0 else math.inf


@inlined
def _change(V: Matrix, dx: Vector, D: Matrix) -> None:
    """∂C/∂x·dx, of which ∂C/∂λ_i = v_i e_iᵀ + e_i v_iᵀ and ∂C/∂β = −I."""
    n = V.shape[0]
    for i in range(n):
        for j in range(i, n):
            D[i, j] = V[i, j] * dx[j] + V[j, i] * dx[i]
            D[j, i] = D[i, j]
        D[i, i] -= dx[n]


@inlined
def _bend(G: Matrix, dx: Vector, dt: float, D: Matrix, out: Matrix) -> None:
    """Write D − Δt dλ dλᵀ∘G into out: C(x + a dx) ⪰ C + a·out for 0 ≤ a ≤ 1, as a² ≤ a."""
    n = G.shape[0]
    for i in range(n):
        for j in range(n):
            out[i, j] = D[i, j] - dt * dx[i] * dx[j] * G[i, j]


@inlined
def _dual_step(X: Matrix, Z: Matrix, step: Step) -> None:
    """Write dZ = Q − Z − the symmetric part of X D Z: C Z = μI, linearised (HKM)."""
    n, T, Q, dZ = X.shape[0], step.T, step.Q, step.Z_step
    times(X, step.D, step.W)
    times(step.W, Z, T)
    for i in range(n):
        for j in range(n):
            dZ[i, j] = Q[i, j] - Z[i, j] - 0.5 * (T[i, j] + T[j, i])


@inlined
def locked(limits: Matrix, r: int) -> bool:
    """Whether the limits of a row are 0, or so close that nothing lies between them."""
    found: bool = limits[1, r] <= ROOM and limits[0, r] >= -ROOM
    return found


@kernel()
def _missing(St: Matrix, limits: Matrix, x: Vector, speed: Vector, slacks: Slacks) -> None:
    """How much more than the distance to the limits each slack is; speed: (joints,), S λ."""
    slack, miss = slacks.s, slacks.miss
    for r in range(speed.size):
        speed[r] = 0.0
    add_rows(speed, x, St, 0, St.shape[0], 0)
    for r in range(speed.size):
        if slack[0, r] < math.inf:
            miss[0, r] = slack[0, r] - (speed[r] - limits[0, r])
        if slack[1, r] < math.inf:
            miss[1, r] = slack[1, r] - (limits[1, r] - speed[r])


@kernel()
def _limit_step(St: Matrix, dx: Vector, z: Matrix, slacks: Slacks) -> None:
    """How much each slack falls along dx, and how much its multiplier changes: z s = aim·s."""
    slack, miss, fall, aim, dz = slacks.s, slacks.miss, slacks.fall, slacks.aim, slacks.dz
    upper, n = fall[1], St.shape[0]
    for r in range(upper.size):
        upper[r] = 0.0
    add_rows(upper, dx, St, 0, n, 0)
    for r in range(upper.size):
        fall[0, r] = -upper[r]
        for side in range(2):
            if slack[side, r] < math.inf:
                fall[side, r] += miss[side, r]
                share = z[side, r] * fall[side, r] / slack[side, r]
                dz[side, r] = aim[side, r] - z[side, r] + share


@kernel()
def _shorten(
    slacks: Slacks, z: Matrix, most: float, primal: float, dual: float
) -> tuple[float, float]:
    """Steps that leave every slack and every multiplier at least 1 − most of what it is."""
    slack, fall, dz = slacks.s, slacks.fall, slacks.dz
    for side in range(2):
        for r in range(slack.shape[1]):
            if slack[side, r] < math.inf:
                if fall[side, r] > 0.0:
                    primal = min(primal, most * slack[side, r] / fall[side, r])
                if dz[side, r] < 0.0:
                    dual = min(dual, -most * z[side, r] / dz[side, r])
    return primal, dual


@kernel(superwords=True)
def _hessian(
    program: Program,
    dual: Dual,
    slack: Matrix,
    it: Iterate,
    K: Matrix,
    column: Vector,
    weighted: Vector,
) -> None:
    """The upper triangle of K, the matrix of a step with dZ and dz eliminated (Schur complement).

    2δI + 2Δt G∘Z for λ and 2 for β, of the Lagrange function; tr(∂C/∂x_i X ∂C/∂x_j Z), of C; and
    Sᵀ diag(z/s) S, of the limits. With ∂C/∂λ_i = v_i e_iᵀ + e_i v_iᵀ the trace of i and j is
    (XV)_ij (ZV)_ji + (XV)_ji (ZV)_ij + X_ij (VᵀZV)_ij + Z_ij (VᵀXV)_ij, that of λ_i and β,
    with ∂C/∂β = −I, is −(X Z V + Z X V)_ii, and that of β and β tr(X Z).

    column: scratch, then z/s; weighted: a row of Sᵀ times it.
    """
    G, St, Z, z = program.G, program.St, dual.Z, dual.z
    X, XV, ZV, VXV, VZV = it.X, it.XV, it.ZV, it.VXV, it.VZV
    n, joints = St.shape
    transposed_times(it.V, XV, VXV, column)
    transposed_times(it.V, ZV, VZV, column)
    K[n, n] = 2.0
    for i in range(n):
        K[i, n] = 0.0
        for j in range(i, n):
            mixed = XV[i, j] * ZV[j, i] + XV[j, i] * ZV[i, j]
            plain = X[i, j] * VZV[i, j] + Z[i, j] * (VXV[i, j] + 2.0 * program.dt * G[i, j])
            K[i, j] = mixed + plain
        K[i, i] += 2.0 * program.delta
        for k in range(n):
            K[i, n] -= X[i, k] * ZV[k, i] + Z[i, k] * XV[k, i]
        K[n, n] += dot(X[i], Z[i])
    for r in range(joints):  # a slack of inf weighs 0
        column[r] = z[0, r] / slack[0, r] + z[1, r] / slack[1, r]
        column[r] = SPRING if locked(program.limits, r) else column[r]
    for i in range(n):
        for r in range(joints):
            weighted[r] = column[r] * St[i, r]
        for j in range(i, n):
            K[i, j] += dot(weighted, St[j])


@inlined
def _begin_limit(limits: Matrix, side: int, r: int, least: float, slack: Matrix, z: Matrix) -> None:
    """The first slack and multiplier of a limit, as units suggest; inf and 0 for none."""
    size = math.inf if locked(limits, r) else max(abs(limits[side, r]), least)
    slack[side, r] = size
    z[side, r] = min(0.1, 1.0 / size)


@kernel()
def begin_inside(program: Program, x: Vector, dual: Dual, slack: Matrix) -> None:
    """Write the first iterate: λ = 0, β = −1, Z as stationarity in β has it, z as units suggest."""
    St, Z = program.St, dual.Z
    (n, joints), largest = St.shape, ROOM
    for i in range(n):
        for j in range(n):
            Z[i, j] = 4.0 / n if i == j else 0.0
        for r in range(joints):
            largest = max(largest, abs(St[i, r]))
        x[i] = 0.0
    x[n] = -1.0
    for side in range(2):
        for r in range(joints):
            _begin_limit(program.limits, side, r, SHARE * largest, slack, dual.z)


@kernel()
def renew(program: Program, z: Matrix, slack: Matrix) -> None:
    """Begin anew for each limit that was none, or is none now."""
    St, limits, largest = program.St, program.limits, ROOM
    for i in range(St.shape[0]):
        for r in range(St.shape[1]):
            largest = max(largest, abs(St[i, r]))
    for side in range(2):
        for r in range(St.shape[1]):
            none = locked(limits, r) or abs(limits[side, r]) == math.inf
            if none != (slack[side, r] == math.inf):
                _begin_limit(limits, side, r, SHARE * largest, slack, z)


@kernel()
def interior(  # noqa: PLR0912, PLR0915 - one iteration from its beginning to its end
    program: Program,
    x: Vector,
    duals: Dual,
    tolerance: float,
    budget: int,
    it: Iterate,
    step: Step,
    slacks: Slacks,
) -> tuple[bool, int]:
    """Go on from C(x) ≻ 0, Z ≻ 0, z > 0 and slacks > 0 until x is known to the tolerance.

    Args:
        program: see there.
        x: λ and β, (n + 1,); overwritten.
        duals: Z and z; overwritten.
        tolerance: of what a step to the optimum would change, relative to 1 + |λ|.
        budget: how many iterations are allowed.
        it, step: scratch.
        slacks: s; overwritten.

    Returns:
        Whether the tolerance was reached; iterations.
    """
    G, St, limits, dt, delta = program.G, program.St, program.limits, program.dt, program.delta
    Z, z = duals.Z, duals.z
    C, V, U, P, PZ, X = it.C, it.V, it.U, it.P, it.PZ, it.X
    K, g, dx, D, dZ, Q, W, T = step.K, step.g, step.dx, step.D, step.Z_step, step.Q, step.W, step.T
    slack, miss, fall, aim, dz = slacks.s, slacks.miss, slacks.fall, slacks.aim, slacks.dz
    n, joints = St.shape
    column = step.column
    primal, dual = 0.5, 0.5  # steps before the first
    for taken in range(budget):
        stability_matrix(program.L, G, x[:n], float(x[n]), dt, C, V)
        _missing(St, limits, x, column[:joints], slacks)
        if not root_inverse(C, U, P, column) or not root_inverse(Z, U, PZ, column):
            return False, taken
        clear(X)
        syrk(X, 1.0, P, n)
        mirror(X)
        gap, count = 0.0, n
        for i in range(n):
            gap += dot(C[i], Z[i])
        for side in range(2):
            for r in range(joints):
                aim[side, r] = 0.0
                miss[side, r] = 0.0 if slack[side, r] == math.inf else miss[side, r]
                if slack[side, r] < math.inf:
                    gap += slack[side, r] * z[side, r]
                    count += 1
        times(X, V, it.XV)
        times(Z, V, it.ZV)
        _hessian(program, duals, slack, it, K, column, step.weighted)
        if factorise(K, n + 1, 0.0, column) < n + 1:
            return False, taken
        for i in range(n):
            g[i] = -2.0 * delta * x[i]
        g[n] = -2.0 * (x[n] - 1.0)
        for r in range(joints):
            if locked(limits, r):
                pull = -SPRING * dot_column(St, r, x)
            else:  # a slack of inf misses nothing
                pull = z[0, r] * miss[0, r] / slack[0, r] - z[1, r] * miss[1, r] / slack[1, r]
            for i in range(n):
                g[i] += pull * St[i, r]
        error = 0.0  # the relative step to where μ is 0, the optimum of what is linearised here
        for i in range(n + 1):
            dx[i] = g[i]
        solve_lower(K, dx)
        solve_upper(K, dx)
        for i in range(n + 1):
            error = max(error, abs(dx[i]) / (1.0 + abs(x[i])))
        if error < tolerance:
            return True, taken
        if not error < math.inf:
            return False, taken

        # Mehrotra's predictor: where it leads tells what is neglected, of second order
        clear(Q)
        _change(V, dx, D)
        _dual_step(X, Z, step)
        _limit_step(St, dx, z, slacks)
        least = min(primal, dual)
        mu = gap / count * max(CENTRED * (1.0 - least), LEAST_CENTRED)

        # the corrector: with that, Q = μX − ½(X E + Eᵀ X), E = D dZ − Δt (dλ dλᵀ∘G) Z, aimed at μ;
        # in g, what dZ has with the change of ∂C/∂λ: −2Δt (G∘dZ) dλ for λ, and −tr Q for β
        times(D, dZ, W)
        for i in range(n):
            for k in range(n):
                add(W[i], -dt * dx[i] * dx[k] * G[i, k], Z[k])
                g[i] -= 2.0 * dt * G[i, k] * dZ[i, k] * dx[k]
        times(X, W, T)
        for i in range(n):
            for j in range(n):
                Q[i, j] = mu * X[i, j] - 0.5 * (T[i, j] + T[j, i])
            g[n] -= Q[i, i]
        for side in range(2):
            for r in range(joints):
                if slack[side, r] < math.inf:
                    aim[side, r] = (mu + fall[side, r] * dz[side, r]) / slack[side, r]
        for i in range(n):
            dx[i] = g[i] + dot(St[i], aim[0]) - dot(St[i], aim[1])
            for k in range(n):
                dx[i] += 2.0 * V[k, i] * Q[k, i]
        dx[n] = g[n]
        solve_lower(K, dx)
        solve_upper(K, dx)
        _change(V, dx, D)
        _dual_step(X, Z, step)
        _bend(G, dx, dt, D, step.bent)
        most = 0.9 + 0.09 * least
        primal = min(1.0, most * _reach(P, step.bent, T, step.scaled, step.eigen))
        dual = min(1.0, most * _reach(PZ, dZ, T, step.scaled, step.eigen))
        _limit_step(St, dx, z, slacks)
        primal, dual = _shorten(slacks, z, most, primal, dual)
        for i in range(n + 1):
            x[i] += primal * dx[i]
        for i in range(n):
            add(Z[i], dual, dZ[i])
        for side in range(2):
            for r in range(joints):
                if slack[side, r] < math.inf:
                    z[side, r] += dual * dz[side, r]
                    slack[side, r] -= primal * fall[side, r]
        if not max(primal, dual) > SMALL:
            return False, taken + 1
    return False, budget
