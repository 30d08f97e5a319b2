"""The way to the optimal gains: from the last ones if these are of any use, else from inside."""

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
from hoap3.remote_controller.solvers.clik.lmi_kernels import stability_matrix
from hoap3.remote_controller.solvers.linalg.dense_kernels import dot, eigenvectors
from hoap3.remote_controller.solvers.linalg.small_product_kernels import dot_column
from hoap3.remote_controller.solvers.sdp.interior_point_kernels import (
    SPRING,
    begin_inside,
    interior,
    locked,
    renew,
)
from hoap3.remote_controller.solvers.sdp.newton_kernels import active_set_newton

NONE, WARM, IPM, BUDGET = range(4)  # the ways to an answer
FIRST_TRY = 1e-3  # of λ: how near the interior-point method is to bring Newton's
TRIES = 6  # more, each ten times as near
INSIDE = 1  # where the budget ended: on the way from inside
CLOSE = 2  # or so near the optimum that Newton's method had begun


@kernel()
def _guess(
    S: Matrix,
    limits: Matrix,
    x: Vector,
    Z: Matrix,
    z: Matrix,
    block: Indices,
    Y: Matrix,
    home: Indices,
    held: Indices,
    nu: Vector,
    C: Matrix,
    W: Matrix,
    Q: Matrix,
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
    Y: Matrix, rank: int, held: Indices, holding: int, nu: Vector, Z: Matrix, z: Matrix
) -> None:
    """Write Z = Y Yᵀ and the multipliers of the limits."""
    n = Z.shape[0]
    for i in range(n):
        for j in range(n):
            Z[i, j] = Y[0, i] * Y[0, j]
        for k in range(1, rank):
            for j in range(n):
                Z[i, j] += Y[k, i] * Y[k, j]
    for side in range(2):
        for r in range(z.shape[1]):
            z[side, r] = 0.0
    for a in range(holding):
        side, r = (1, held[a] - 1) if held[a] > 0 else (0, -held[a] - 1)
        z[side, r] = max(nu[a], 0.0)
        if nu[a] < 0.0:  # of a joint that may not move: its other limit holds
            z[1 - side, r] = -nu[a]


@inlined
def _spring_multipliers(S: Matrix, limits: Matrix, x: Vector, z: Matrix) -> None:
    """Write what holds the joints that may not move, where the interior-point method held them."""
    for r in range(S.shape[1]):
        if locked(limits, r):
            pull = SPRING * dot_column(S, r, x)
            z[0, r], z[1, r] = max(-pull, 0.0), max(pull, 0.0)


@kernel()
def polish(
    L: Matrix,
    G: Matrix,
    S: Matrix,
    limits: Matrix,
    dt: float,
    delta: float,
    budget: int,
    points: Matrix,
    Y: Matrix,
    integers: IndexRows,
    counts: Indices,
    nu: Vector,
    Z: Matrix,
    z: Matrix,
    squares: Cube,
    K: Matrix,
    vectors: Matrix,
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
    problem, scratch = (L, G, S, limits, dt, delta), (squares[0], squares[1], K, vectors)
    good, holding, taken = active_set_newton(
        *problem, trial, Y, block, home, rank, held, holding, nu, budget, *scratch
    )
    counts[0], counts[1] = 0, 0
    if good:
        for i in range(n + 1):
            x[i] = trial[i]
        counts[0], counts[1] = rank, holding
        _multipliers(Y, rank, held, holding, nu, Z, z)
    return good, taken


@inlined
def _begin_or_go_on(
    S: Matrix, limits: Matrix, points: Matrix, Z: Matrix, z: Matrix, sides: Cube, counts: Indices
) -> bool:
    """Write where the interior-point method begins: where the last budget ended, if it did.

    A limit that has become one since, or is none any more, begins anew. Returns whether it goes on.
    On the way from inside it may; close to the optimum of the tick before a limit or an eigenvalue
    is nearly 0, from where it would not get on, and Newton's method is all there is to try.
    """
    x, inside, slack = points[0], points[4], sides[0]
    going_on: bool = counts[5] > 0
    for i in range(S.shape[0] + 1 if going_on else 0):
        x[i] = inside[i]
    if going_on:
        renew(S, limits, z, slack)
    else:
        begin_inside(S, limits, x, Z, z, slack)
    counts[5] = 0
    return going_on


@kernel()
def optimise(
    L: Matrix,
    G: Matrix,
    S: Matrix,
    limits: Matrix,
    dt: float,
    delta: float,
    budget: int,
    points: Matrix,
    Y: Matrix,
    integers: IndexRows,
    counts: Indices,
    nu: Vector,
    Z: Matrix,
    z: Matrix,
    squares: Cube,
    K: Matrix,
    vectors: Matrix,
    sides: Cube,
) -> tuple[int, int, int]:
    """Find λ and β in the units of β̃ = 1, from the last ones if these are of any use.

    Args:
        L, G, S, limits, dt, delta: as for `active_set_newton`.
        budget: how many iterations are allowed, of both kinds together.
        points: λ and β, (5, n + 1) or longer: the last one, overwritten by the answer; scratch; two
            that are others'; where the interior-point method is when the budget is spent.
        Y: of the last one, (any, n); overwritten.
        integers: blocks of L, homes of the y_k, limits that hold, (3, n); the latter two from last.
        counts: how many y_k and how many held limits there are, none where nothing is known; three
            that are others'; where the budget ended, for the next time; (6,).
        nu: multipliers of the limits, (n,).
        Z, z: written: multipliers of C and the limits, (n, n) and (2, joints). They and the first
            of `sides` are to be kept where the interior-point method goes on the next time.
        squares, K, vectors, sides: scratch; see `SdpGains`.

    Returns:
        Path; Newton steps; iterations of the interior-point method.
    """
    block, home, held = integers[0], integers[1], integers[2]
    x, newton = points[0], 0
    problem, scratch = (L, G, S, limits, dt, delta), (squares[0], squares[1], K, vectors)
    if counts[0] > 0:
        half = max(budget // 2, 1)  # from a guess that misleads, there must be time to begin anew
        good, counts[1], newton = active_set_newton(
            *problem, x, Y, block, home, counts[0], held, counts[1], nu, half, *scratch
        )
        if good:
            _multipliers(Y, counts[0], held, counts[1], nu, Z, z)
            return WARM, newton, 0
    tries, inner, close, spent = 0, 0, counts[5] == CLOSE, False
    going_on = _begin_or_go_on(S, limits, points, Z, z, sides, counts)
    while True:
        near, taken = True, 0
        if not close:
            left, tolerance = budget - newton - inner, FIRST_TRY * 0.1**tries
            near, taken = interior(*problem, x, Z, z, tolerance, left, squares, K, vectors, sides)
        inner += taken
        left = budget - newton - inner
        good, taken = polish(
            *problem, left, points, Y, integers, counts, nu, Z, z, squares, K, vectors
        )
        newton += taken
        if good:
            return IPM, newton, inner
        spent = newton + inner >= budget
        if going_on and not spent and (close or not near):
            going_on, close = _begin_or_go_on(S, limits, points, Z, z, sides, counts), False
            continue
        if not near or tries == TRIES or spent:
            break
        tries += 1
    if spent and not close:
        counts[5] = CLOSE if near else INSIDE
        for i in range(S.shape[0] + 1):
            points[4, i] = x[i]
    _spring_multipliers(S, limits, x, z)
    return BUDGET if spent else IPM, newton, inner
