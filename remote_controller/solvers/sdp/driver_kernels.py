"""The way to the optimal gains: from the last ones if these are of any use, else from inside."""

from __future__ import annotations

import math

from hoap3.protocol.runtime.numba_jit import Vector, inlined, kernel
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
from hoap3.remote_controller.solvers.sdp.memory_kernels import (
    ENDED,
    HOLDING,
    RANK,
    Active,
    Check,
    Dual,
    Points,
    Program,
    Slacks,
    Work,
)
from hoap3.remote_controller.solvers.sdp.newton_kernels import active_set_newton

NONE, WARM, IPM, BUDGET = range(4)  # the ways to an answer
FIRST_TRY = 1e-3  # of λ: how near the interior-point method is to bring Newton's
TRIES = 6  # more, each ten times as near
INSIDE = 1  # where the budget ended: on the way from inside
CLOSE = 2  # or so near the optimum that Newton's method had begun


@kernel()
def _guess(program: Program, x: Vector, dual: Dual, active: Active, check: Check) -> None:
    """From an interior point: which eigenvectors of Z and which limits are active at the optimum.

    Those whose multiplier is larger than what it is the multiplier of. `check` has C; written are
    all of `active` but the blocks.
    """
    St, limits, Z, z = program.St, program.limits, dual.Z, dual.z
    C, W, E, Y, block = check.C, check.W, check.E, active.Y, active.block
    held, nu = active.held, active.nu
    n, rank, holding = St.shape[0], 0, 0
    for i in range(n):
        for j in range(n):
            W[i, j] = Z[i, j]
    eigenvectors(W, E, n)
    for k in range(n):
        other, largest = 0.0, 0
        for i in range(n):
            other += E[k, i] * dot(C[i], E[k])
            largest = i if abs(E[k, i]) > abs(E[k, largest]) else largest
        if W[k, k] > max(other, 0.0) and rank < Y.shape[0]:
            root = math.sqrt(W[k, k])
            active.home[rank] = block[largest]
            for i in range(n):
                Y[rank, i] = root * E[k, i] if block[i] == active.home[rank] else 0.0
            rank += 1
    for r in range(St.shape[1]):
        speed = 0.0
        for i in range(n):
            speed += St[i, r] * x[i]
        if locked(limits, r) and holding < n:
            held[holding], nu[holding] = r + 1, 0.0
            holding += 1
        elif z[1, r] > limits[1, r] - speed and holding < n:
            held[holding], nu[holding] = r + 1, z[1, r]
            holding += 1
        elif z[0, r] > speed - limits[0, r] and holding < n:
            held[holding], nu[holding] = -r - 1, z[0, r]
            holding += 1
    active.counts[RANK], active.counts[HOLDING] = rank, holding


@inlined
def _multipliers(active: Active, dual: Dual) -> None:
    """Write Z = Y Yᵀ and the multipliers of the limits."""
    Y, held, nu, Z, z = active.Y, active.held, active.nu, dual.Z, dual.z
    n = Z.shape[0]
    for i in range(n):
        for j in range(n):
            Z[i, j] = Y[0, i] * Y[0, j]
        for k in range(1, active.counts[RANK]):
            for j in range(n):
                Z[i, j] += Y[k, i] * Y[k, j]
    for side in range(2):
        for r in range(z.shape[1]):
            z[side, r] = 0.0
    for a in range(active.counts[HOLDING]):
        side, r = (1, held[a] - 1) if held[a] > 0 else (0, -held[a] - 1)
        z[side, r] = max(nu[a], 0.0)
        if nu[a] < 0.0:  # of a joint that may not move: its other limit holds
            z[1 - side, r] = -nu[a]


@inlined
def _spring_multipliers(program: Program, x: Vector, dual: Dual) -> None:
    """Write what holds the joints that may not move, where the interior-point method held them."""
    for r in range(program.St.shape[1]):
        if locked(program.limits, r):
            pull = SPRING * dot_column(program.St, r, x)
            dual.z[0, r], dual.z[1, r] = max(-pull, 0.0), max(pull, 0.0)


@kernel()
def polish(
    program: Program, budget: int, points: Points, active: Active, dual: Dual, work: Work
) -> tuple[bool, int]:
    """Newton's method from a point near the optimum with its multipliers; as for `optimise`.

    Returns:
        Whether it arrived, and all is overwritten by the optimum; steps taken.
    """
    n, x, trial, check = program.St.shape[0], points.x, points.trial, work.check
    stability_matrix(program.L, program.G, x[:n], float(x[n]), program.dt, check.C, check.V)
    _guess(program, x, dual, active, check)
    for i in range(n + 1):
        trial[i] = x[i]
    good, taken = active_set_newton(program, trial, active, budget, work.newton)
    if good:
        for i in range(n + 1):
            x[i] = trial[i]
        _multipliers(active, dual)
    else:
        active.counts[RANK], active.counts[HOLDING] = 0, 0
    return good, taken


@inlined
def _begin_or_go_on(
    program: Program, points: Points, active: Active, dual: Dual, slacks: Slacks
) -> bool:
    """Write where the interior-point method begins: where the last budget ended, if it did.

    A limit that has become one since, or is none any more, begins anew. Returns whether it goes on.
    On the way from inside it may; close to the optimum of the tick before a limit or an eigenvalue
    is nearly 0, from where it would not get on, and Newton's method is all there is to try.
    """
    x, inside = points.x, points.inside
    going_on: bool = active.counts[ENDED] > 0
    for i in range(program.St.shape[0] + 1 if going_on else 0):
        x[i] = inside[i]
    if going_on:
        renew(program, dual.z, slacks.s)
    else:
        begin_inside(program, x, dual, slacks.s)
    active.counts[ENDED] = 0
    return going_on


@inlined
def optimise(
    program: Program, budget: int, points: Points, active: Active, dual: Dual, work: Work
) -> tuple[int, int, int]:
    """Find λ and β in the units of β̃ = 1, from the last ones if these are of any use.

    Args:
        program: see there.
        budget: how many iterations are allowed, of both kinds together.
        points: x: the last answer, overwritten by the new one; inside: where the interior-point
            method was when the last budget was spent, likewise.
        active: of the last answer; overwritten.
        dual: written. It and the slacks are to be kept where the interior-point method goes on
            the next time.
        work: scratch.

    Returns:
        Path; Newton steps; iterations of the interior-point method.
    """
    x, counts, newton = points.x, active.counts, 0
    if counts[RANK] > 0:
        half = max(budget // 2, 1)  # from a guess that misleads, there must be time to begin anew
        good, newton = active_set_newton(program, x, active, half, work.newton)
        if good:
            _multipliers(active, dual)
            return WARM, newton, 0
    tries, inner, close, spent = 0, 0, counts[ENDED] == CLOSE, False
    going_on = _begin_or_go_on(program, points, active, dual, work.slacks)
    while True:
        near, taken = True, 0
        if not close:
            left, tolerance = budget - newton - inner, FIRST_TRY * 0.1**tries
            near, taken = interior(
                program, x, dual, tolerance, left, work.iterate, work.step, work.slacks
            )
        inner += taken
        left = budget - newton - inner
        good, taken = polish(program, left, points, active, dual, work)
        newton += taken
        if good:
            return IPM, newton, inner
        spent = newton + inner >= budget
        if going_on and not spent and (close or not near):
            going_on = _begin_or_go_on(program, points, active, dual, work.slacks)
            close = False
            continue
        if not near or tries == TRIES or spent:
            break
        tries += 1
    if spent and not close:
        counts[ENDED] = CLOSE if near else INSIDE
        for i in range(program.St.shape[0] + 1):
            points.inside[i] = x[i]
    _spring_multipliers(program, x, dual)
    return BUDGET if spent else IPM, newton, inner
