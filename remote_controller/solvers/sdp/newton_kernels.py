"""Newton's method on the optimality conditions of the gains, from a guess of what is active.

    min (β − 1)² + δ|λ|²   subject to   C(λ, β) ⪰ 0,  lower ≤ S λ ≤ upper

(`lmi_kernels` has C; time is counted in units of 1/β̃.) The multiplier of C is Z = Y Yᵀ with few
columns y_k, one as a rule, those of the limits that hold are ν. Optimal is where

    2δ λ_i − 2 Σ_k (v_iᵀ y_k) y_ki + (Sᵀν)_i = 0,   2(β − 1) + Σ |y_k|² = 0,
    C y_k = 0,   rows of S that hold a limit: S λ = limit,

with C ⪰ 0, ν ≥ 0 and all limits kept. The Newton matrix, with C y_k = 0 times −2, is
symmetric. Its block of (λ, β) is positive definite, and what is left of the other one, its Schur
complement, is negative definite at an optimum that is not degenerate. So in this order it has a
factorisation without pivoting, as a quasidefinite matrix has in any order (Vanderbei, SIAM Journal
on Optimization 5, 1995). A column of Y lies within one block of C. Two columns in one block may be
rotated without changing Z; a term along that rotation makes the answer unique.
"""

from __future__ import annotations

import math

from hoap3.protocol.runtime.numba_jit import Matrix, Vector, inlined, kernel
from hoap3.remote_controller.solvers.clik.lmi_kernels import stability_matrix
from hoap3.remote_controller.solvers.linalg.ldlt_kernels import solve_quasidefinite
from hoap3.remote_controller.solvers.sdp.memory_kernels import (
    HOLDING,
    RANK,
    Active,
    Newton,
    Program,
)

CONVERGED = 1e-6  # of 1 + |λ|: the step after one of that size is rounding
STEPS = 8  # of one Newton iteration; from a good guess it takes two or three
FAR = 1e3  # of 1 + |λ|: a step as long leads nowhere
SLOW = 0.5  # of the step before: after the first few, a step that is longer leads nowhere
NEAR = 0.1  # of 1 + |λ|: after a step as short it shows which limits are wrong
NOTHING = 1e-300  # squares of that size are none
KEPT = 1e-10  # of 1 + |limit|: how far a limit may be broken
PULLING = -1e-10  # a multiplier below it says that its limit need not hold
LEAST = -1e-10  # of C's diagonal: an eigenvalue below it is negative


@inlined
def _limit(limits: Matrix, held: int) -> float:
    found: float = limits[1, held - 1] if held > 0 else limits[0, -held - 1]
    return found


@inlined
def _fill(  # noqa: PLR0912 - one case after the other
    program: Program, x: Vector, active: Active, newton: Newton
) -> int:
    """Write K, its upper triangle, and b, both of the conditions above; how many unknowns."""
    G, St, dt, delta = program.G, program.St, program.dt, program.delta
    Y, nu, block, home = active.Y, active.nu, active.block, active.home
    C, V, K, b, w = newton.C, newton.V, newton.K, newton.b, newton.w
    n, size, rank = block.size, block.size + 1, active.counts[RANK]
    for i in range(n):  # ∂²/∂λ² of the Lagrange function, 2δI + 2Δt G∘Z, and of β, 2
        for j in range(i, n):
            K[i, j] = Y[0, i] * Y[0, j]
        for k in range(1, rank):
            for j in range(i, n):
                K[i, j] += Y[k, i] * Y[k, j]
        for j in range(i, n):
            K[i, j] *= 2.0 * dt * G[i, j]
        K[i, i] += 2.0 * delta
        K[i, n] = 0.0
        b[i] = -2.0 * delta * x[i]
    K[n, n], b[n] = 2.0, -2.0 * (x[n] - 1.0)
    for k in range(rank):  # −2 C y_k = 0, with ∂(C y_k)/∂λ_i = v_i y_ki + e_i (v_iᵀy_k)
        for i in range(n):
            w[i] = 0.0
        for j in range(n):
            factor = Y[k, j]
            for i in range(n):
                w[i] += factor * V[j, i]
        for i in range(n):
            b[i] += 2.0 * w[i] * Y[k, i]
            b[n] -= Y[k, i] * Y[k, i]
        begin = size
        for p in range(n):
            if block[p] != home[k]:
                continue
            for i in range(n):
                K[i, size] = -2.0 * V[p, i] * Y[k, i]
            K[p, size] -= 2.0 * w[p]
            K[n, size] = 2.0 * Y[k, p]
            for column in range(n + 1, begin):
                K[column, size] = 0.0
            column, pull = begin, 0.0
            for q in range(p + 1):
                if block[q] == home[k]:
                    K[column, size] = -2.0 * C[p, q]
                    column += 1
            for q in range(n):
                pull += C[p, q] * Y[k, q]
            b[size] = 2.0 * pull
            size += 1
    for a in range(active.counts[HOLDING]):  # S λ = limit
        held = active.held[a]
        sign, r = (1.0, held - 1) if held > 0 else (-1.0, -held - 1)
        value = 0.0
        for i in range(n):
            K[i, size] = sign * St[i, r]
            value += St[i, r] * x[i]
            b[i] -= sign * St[i, r] * nu[a]
        for column in range(n, size + 1):
            K[column, size] = 0.0
        b[size] = sign * (_limit(program.limits, held) - value)
        size += 1
    return size


@inlined
def _begin(active: Active, k: int) -> int:
    """Where the entries of y_k begin among the unknowns."""
    n, begin = active.block.size, active.block.size + 1
    for other in range(k):
        for q in range(n):
            begin += 1 if active.block[q] == active.home[other] else 0
    return begin


@inlined
def _fix_rotation(active: Active, K: Matrix) -> None:
    """Add −2 g gᵀ for each rotation g of two columns within a block: y_k += y_l, y_l −= y_k."""
    Y, block, home = active.Y, active.block, active.home
    n = block.size
    for k in range(1, active.counts[RANK]):
        for other in range(k):
            if home[other] != home[k]:
                continue
            first, second = _begin(active, other), _begin(active, k)
            a = 0
            for p in range(n):
                if block[p] != home[k]:
                    continue
                c = 0
                for q in range(n):
                    if block[q] != home[k]:
                        continue
                    if c >= a:
                        K[first + a, first + c] -= 2.0 * Y[k, p] * Y[k, q]
                        K[second + a, second + c] -= 2.0 * Y[other, p] * Y[other, q]
                    K[first + a, second + c] += 2.0 * Y[k, p] * Y[other, q]
                    c += 1
                a += 1


@inlined
def _move(x: Vector, active: Active, step: Vector) -> float:
    """Take a Newton step; how long it was, relative."""
    Y, nu, block, home = active.Y, active.nu, active.block, active.home
    n, longest, whole, change = block.size, 0.0, 0.0, 0.0
    for i in range(n + 1):
        longest = max(longest, abs(step[i]) / (1.0 + abs(x[i])))
        x[i] += step[i]
    column = n + 1
    for k in range(active.counts[RANK]):
        for p in range(n):
            if block[p] == home[k]:
                change += step[column] * step[column]
                Y[k, p] += step[column]
                whole += Y[k, p] * Y[k, p]
                column += 1
    for a in range(active.counts[HOLDING]):
        longest = max(longest, abs(step[column]) / (1.0 + abs(nu[a])))
        nu[a] += step[column]
        column += 1
    if not (longest < FAR and change < math.inf):
        return math.inf
    return max(longest, math.sqrt(change / max(whole, NOTHING)))


@inlined
def _first_wrong(program: Program, x: Vector, active: Active, speed: Vector) -> tuple[int, int]:
    """Which held limit pulls most, or −1; which limit is broken most (signed, from 1), or 0."""
    St, limits, nu = program.St, program.limits, active.nu
    n, worst, out = St.shape[0], PULLING, -1
    for a in range(active.counts[HOLDING]):
        r = abs(active.held[a]) - 1
        if nu[a] < worst and limits[1, r] - limits[0, r] > KEPT:
            worst, out = nu[a], a
    for r in range(St.shape[1]):
        speed[r] = 0.0
    for i in range(n):
        for r in range(St.shape[1]):
            speed[r] += x[i] * St[i, r]
    beyond, broken = KEPT, 0
    for r in range(speed.size):
        over, under = speed[r] - limits[1, r], limits[0, r] - speed[r]
        if over > beyond * (1.0 + abs(limits[1, r])):
            beyond, broken = over / (1.0 + abs(limits[1, r])), r + 1
        if under > beyond * (1.0 + abs(limits[0, r])):
            beyond, broken = under / (1.0 + abs(limits[0, r])), -r - 1
    return out, broken


@inlined
def _positive(C: Matrix, Y: Matrix, rank: int, K: Matrix, row: Vector) -> bool:
    """Whether C + Σ ρ y_k y_kᵀ is positive definite, so C semidefinite where C y_k = 0 (Cholesky).

    Its factor is left in K; row: (n,), scratch.
    """
    n = C.shape[0]
    size, whole = 0.0, 1e-300
    for i in range(n):
        size += abs(C[i, i])
        for k in range(rank):
            whole += Y[k, i] * Y[k, i]
    rho = size / whole
    for i in range(n):
        for j in range(i, n):
            entry = C[i, j]
            for k in range(rank):
                entry += rho * Y[k, i] * Y[k, j]
            K[i, j] = entry
        K[i, i] -= LEAST * size
    for i in range(n):
        for j in range(i, n):
            row[j] = K[i, j]
        for k in range(i):
            factor = K[k, i]
            for j in range(i, n):
                row[j] -= factor * K[k, j]
        if not row[i] > 0.0:
            return False
        inverse = 1.0 / math.sqrt(row[i])
        for j in range(i, n):
            K[i, j] = row[j] * inverse
    return True


@kernel()
def active_set_newton(  # noqa: PLR0912 - one case after the other
    program: Program, x: Vector, active: Active, budget: int, newton: Newton
) -> tuple[bool, int]:
    """Find the optimum by Newton's method, and which limits hold: one more, or less, at a time.

    Args:
        program: see there.
        x: guess of λ and β, (n + 1,); overwritten by the optimum.
        active: guess of what is active; overwritten.
        budget: how many Newton steps are allowed.
        newton: scratch; C and V are left where they were evaluated last.

    Returns:
        Whether x is optimal: the conditions hold and C is positive semidefinite; Newton steps
        taken.
    """
    L, G, dt, C, V = program.L, program.G, program.dt, newton.C, newton.V
    nu, held, counts = active.nu, active.held, active.counts
    n, rank, taken, dual = active.block.size, active.counts[RANK], 0, 0
    for k in range(rank):
        for other in range(k + 1):
            dual += 1 if active.home[other] == active.home[k] else 0
    for _ in range(2 * n + 2):
        if rank == 0 or dual + counts[HOLDING] > n + 1:  # Z and ν would not be unique
            break
        close, before, out, broken = False, math.inf, -1, 0
        for step in range(STEPS):
            if taken == budget:
                return False, taken
            taken += 1
            stability_matrix(L, G, x[:n], x[n], dt, C, V)
            size = _fill(program, x, active, newton)
            _fix_rotation(active, newton.K)
            if not solve_quasidefinite(newton.K, size, newton.b, newton.inverses, newton.factors):
                return False, taken
            length = _move(x, active, newton.b)
            close = length < CONVERGED
            lost = not length < math.inf or (step > 2 and length > SLOW * before)
            if lost and not close:
                return False, taken
            before = length
            if length < NEAR:
                out, broken = _first_wrong(program, x, active, newton.speed)
            if close or out >= 0 or broken != 0:
                break
        if out >= 0:
            counts[HOLDING] -= 1
            for a in range(out, counts[HOLDING]):
                held[a], nu[a] = held[a + 1], nu[a + 1]
        elif broken != 0:
            if counts[HOLDING] == n:
                return False, taken
            held[counts[HOLDING]], nu[counts[HOLDING]] = broken, 0.0
            counts[HOLDING] += 1
        elif not close:
            break
        else:
            stability_matrix(L, G, x[:n], x[n], dt, C, V)
            return _positive(C, active.Y, rank, newton.K, newton.row), taken
    return False, taken
