"""A primal-dual interior-point method for the gains, on the n × n matrix inequality.

    min (β − 1)² + δ|λ|²   subject to   C(λ, β) ⪰ 0,  lower ≤ S λ ≤ upper

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

from hoap3.protocol.runtime.numba_jit import Cube, Matrix, Vector, inlined, kernel
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

ROOM = 1e-10  # limits closer to 0 than that on both sides let nothing move
SHARE = 0.1  # of the largest entry of S: a limit closer to 0 is kept only in the end
SPRING = 1e10  # holds a joint that may not move at all, whose two limits leave no interior
COARSE = 1e-2  # accuracy of the eigenvalues that tell how far a step may go
CENTRED, LEAST_CENTRED = 0.4, 1e-5  # of μ: what a step aims at after one of length 0, and of 1
SMALL = 1e-3  # step: nothing is gained any more


@kernel(superwords=True)
def _reach(P: Matrix, D: Matrix, W: Matrix, X: Matrix, vectors: Matrix) -> float:
    """The longest step a, with A + a D ⪰ 0 where P A Pᵀ = I."""
    n = P.shape[0]
    times(P, D, W)
    for i in range(n):
        for j in range(i + 1):
            X[i, j] = dot(W[i, : j + 1], P[j, : j + 1])
            X[j, i] = X[i, j]
    least = least_eigenvalue(X, math.nan, COARSE, vectors)
    return -1.0 / least if least < 0.0 else math.inf


@inlined
def _change(V: Matrix, dx: Vector, D: Matrix) -> None:
    """∂C/∂x · dx."""
    n = V.shape[0]
    for i in range(n):
        for j in range(i, n):
            D[i, j] = V[i, j] * dx[j] + V[j, i] * dx[i]
            D[j, i] = D[i, j]
        D[i, i] -= dx[n]


@inlined
def _bend(G: Matrix, dx: Vector, dt: float, D: Matrix, out: Matrix) -> None:
    """D less the curvature of C along dx: as far as a step of 1, C bends by no more than that."""
    n = G.shape[0]
    for i in range(n):
        for j in range(n):
            out[i, j] = D[i, j] - dt * dx[i] * dx[j] * G[i, j]


@kernel()
def _dual_step(
    X: Matrix, Z: Matrix, D: Matrix, Q: Matrix, W: Matrix, T: Matrix, out: Matrix
) -> None:
    """Q − Z − the symmetric part of X D Z."""
    n = X.shape[0]
    times(X, D, W)
    times(W, Z, T)
    for i in range(n):
        for j in range(n):
            out[i, j] = Q[i, j] - Z[i, j] - 0.5 * (T[i, j] + T[j, i])


@inlined
def locked(limits: Matrix, r: int) -> bool:
    """Whether the limits of a row are 0, or so close that nothing lies between them."""
    found: bool = limits[1, r] <= ROOM and limits[0, r] >= -ROOM
    return found


@kernel()
def _missing(
    S: Matrix, limits: Matrix, x: Vector, speed: Vector, slack: Matrix, miss: Matrix
) -> None:
    """How much more than the distance to the limits each slack is."""
    for r in range(speed.size):
        speed[r] = 0.0
    add_rows(speed, x, S, 0, S.shape[0], 0)
    for r in range(speed.size):
        if slack[0, r] < math.inf:
            miss[0, r] = slack[0, r] - (speed[r] - limits[0, r])
        if slack[1, r] < math.inf:
            miss[1, r] = slack[1, r] - (limits[1, r] - speed[r])


@kernel()
def _limit_step(
    S: Matrix,
    dx: Vector,
    slack: Matrix,
    z: Matrix,
    miss: Matrix,
    aim: Matrix,
    fall: Matrix,
    dz: Matrix,
) -> None:
    """How much each slack falls along dx, and how much its multiplier changes: z s = aim·s."""
    upper, n = fall[1], S.shape[0]
    for r in range(upper.size):
        upper[r] = 0.0
    add_rows(upper, dx, S, 0, n, 0)
    for r in range(upper.size):
        fall[0, r] = -upper[r]
        for side in range(2):
            if slack[side, r] < math.inf:
                fall[side, r] += miss[side, r]
                share = z[side, r] * fall[side, r] / slack[side, r]
                dz[side, r] = aim[side, r] - z[side, r] + share


@kernel()
def _shorten(
    slack: Matrix, fall: Matrix, z: Matrix, dz: Matrix, most: float, primal: float, dual: float
) -> tuple[float, float]:
    """Steps that leave every slack and every multiplier at least 1 − most of what it is."""
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
    G: Matrix,
    S: Matrix,
    limits: Matrix,
    Z: Matrix,
    z: Matrix,
    X: Matrix,
    V: Matrix,
    XV: Matrix,
    ZV: Matrix,
    slack: Matrix,
    dt: float,
    delta: float,
    VXV: Matrix,
    VZV: Matrix,
    scratch: Vector,
    weighted: Vector,
    K: Matrix,
) -> None:
    """The upper triangle of the matrix of a step, with the multipliers eliminated."""
    n, joints = S.shape
    transposed_times(V, XV, VXV, scratch)
    transposed_times(V, ZV, VZV, scratch)
    K[n, n] = 2.0
    for i in range(n):
        K[i, n] = 0.0
        for j in range(i, n):
            mixed = XV[i, j] * ZV[j, i] + XV[j, i] * ZV[i, j]
            plain = X[i, j] * VZV[i, j] + Z[i, j] * (VXV[i, j] + 2.0 * dt * G[i, j])
            K[i, j] = mixed + plain
        K[i, i] += 2.0 * delta
        for k in range(n):
            K[i, n] -= X[i, k] * ZV[k, i] + Z[i, k] * XV[k, i]
        K[n, n] += dot(X[i], Z[i])
    for r in range(joints):  # a slack of inf weighs 0
        scratch[r] = z[0, r] / slack[0, r] + z[1, r] / slack[1, r]
        scratch[r] = SPRING if locked(limits, r) else scratch[r]
    for i in range(n):
        for r in range(joints):
            weighted[r] = scratch[r] * S[i, r]
        for j in range(i, n):
            K[i, j] += dot(weighted[:joints], S[j])


@inlined
def _begin_limit(limits: Matrix, side: int, r: int, least: float, slack: Matrix, z: Matrix) -> None:
    """The first slack and multiplier of a limit, as units suggest; inf and 0 for none."""
    size = math.inf if locked(limits, r) else max(abs(limits[side, r]), least)
    slack[side, r] = size
    z[side, r] = min(0.1, 1.0 / size)


@kernel()
def begin_inside(S: Matrix, limits: Matrix, x: Vector, Z: Matrix, z: Matrix, slack: Matrix) -> None:
    """Write the first iterate: λ = 0, β = −1, Z as stationarity in β has it, z as units suggest."""
    (n, joints), largest = S.shape, ROOM
    for i in range(n):
        for j in range(n):
            Z[i, j] = 4.0 / n if i == j else 0.0
        for r in range(joints):
            largest = max(largest, abs(S[i, r]))
        x[i] = 0.0
    x[n] = -1.0
    for side in range(2):
        for r in range(joints):
            _begin_limit(limits, side, r, SHARE * largest, slack, z)


@kernel()
def renew(S: Matrix, limits: Matrix, z: Matrix, slack: Matrix) -> None:
    """Begin anew for each limit that was none, or is none now."""
    largest = ROOM
    for i in range(S.shape[0]):
        for r in range(S.shape[1]):
            largest = max(largest, abs(S[i, r]))
    for side in range(2):
        for r in range(S.shape[1]):
            none = locked(limits, r) or abs(limits[side, r]) == math.inf
            if none != (slack[side, r] == math.inf):
                _begin_limit(limits, side, r, SHARE * largest, slack, z)


@kernel()
def interior(  # noqa: PLR0912, PLR0915 - one iteration from its beginning to its end
    L: Matrix,
    G: Matrix,
    S: Matrix,
    limits: Matrix,
    dt: float,
    delta: float,
    x: Vector,
    Z: Matrix,
    z: Matrix,
    tolerance: float,
    budget: int,
    squares: Cube,
    K: Matrix,
    vectors: Matrix,
    sides: Cube,
) -> tuple[bool, int]:
    """Go on from C(x) ≻ 0, Z ≻ 0, z > 0 and slacks > 0 until x is known to the tolerance.

    Args:
        L, G: (n, n), and LᵀL.
        S: Sᵀ, (n, joints).
        limits: of S λ, (2, joints), ∓inf where there is none.
        dt, delta: Δt β̃ and δ.
        x: λ and β, (n + 1,); overwritten.
        Z: multiplier of C, (n, n); overwritten.
        z: multipliers of the limits, (2, joints), 0 where there is none; overwritten.
        tolerance: of what a step to the optimum would change, relative to 1 + |λ|.
        budget: how many iterations are allowed.
        squares: scratch, (13, n, n), C and V first.
        K: scratch, (n + 1, n + 1) or larger.
        vectors: scratch, (6, n + 1 or joints, whichever is more).
        sides: (5, 2, joints): the slacks, inf where there is no limit, overwritten; scratch.

    Returns:
        Whether the tolerance was reached; iterations.
    """
    n, joints = S.shape
    C, V, U, P, X = squares[0], squares[1], squares[2], squares[3], squares[4]
    XV, ZV, D, dZ = squares[5], squares[6], squares[7], squares[8]
    W, T, PZ, Q = squares[9], squares[10], squares[11], squares[12]
    dx: Vector = vectors[0, : n + 1]
    g: Vector = vectors[1, : n + 1]
    scratch, spectrum = vectors[2], vectors[3:]
    slack, fall, dz, aim, miss = sides[0], sides[1], sides[2], sides[3], sides[4]
    primal, dual = 0.5, 0.5  # steps before the first
    for taken in range(budget):
        stability_matrix(L, G, x[:n], float(x[n]), dt, C, V)
        _missing(S, limits, x, scratch[:joints], slack, miss)
        if not root_inverse(C, U, P, scratch) or not root_inverse(Z, U, PZ, scratch):
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
        times(X, V, XV)
        times(Z, V, ZV)
        _hessian(G, S, limits, Z, z, X, V, XV, ZV, slack, dt, delta, D, W, scratch, spectrum[0], K)
        if factorise(K, n + 1, 0.0, scratch) < n + 1:
            return False, taken
        for i in range(n):
            g[i] = -2.0 * delta * x[i]
        g[n] = -2.0 * (x[n] - 1.0)
        for r in range(joints):
            if locked(limits, r):
                pull = -SPRING * dot_column(S, r, x)
            else:  # a slack of inf misses nothing
                pull = z[0, r] * miss[0, r] / slack[0, r] - z[1, r] * miss[1, r] / slack[1, r]
            for i in range(n):
                g[i] += pull * S[i, r]
        error = 0.0
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

        # the predictor: where it leads tells what is neglected, of second order
        clear(Q)
        _change(V, dx, D)
        _dual_step(X, Z, D, Q, W, T, dZ)
        _limit_step(S, dx, slack, z, miss, aim, fall, dz)
        least = min(primal, dual)
        mu = gap / count * max(CENTRED * (1.0 - least), LEAST_CENTRED)

        # the corrector: with that, and aimed at μ
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
            dx[i] = g[i] + dot(S[i], aim[0]) - dot(S[i], aim[1])
            for k in range(n):
                dx[i] += 2.0 * V[k, i] * Q[k, i]
        dx[n] = g[n]
        solve_lower(K, dx)
        solve_upper(K, dx)
        _change(V, dx, D)
        _dual_step(X, Z, D, Q, W, T, dZ)
        _bend(G, dx, dt, D, W)
        most = 0.9 + 0.09 * least
        primal = min(1.0, most * _reach(P, W, T, U, spectrum))
        dual = min(1.0, most * _reach(PZ, dZ, T, U, spectrum))
        _limit_step(S, dx, slack, z, miss, aim, fall, dz)
        primal, dual = _shorten(slack, fall, z, dz, most, primal, dual)
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
