"""What the solver of the gains works on, each array by its name, with its shape and its equation.

The arrays are parts of four blocks, each of one width: to hand an array to a kernel costs 0.1 µs.
`layout` alone says where in a block an array is. Symbols are those of `lmi_kernels`, n is the
number of rows of the tasks; time is counted in units of 1/β̃.
"""

from __future__ import annotations

from typing import NamedTuple

from hoap3.protocol.runtime.numba_jit import Indices, Matrix, Vector, inlined
from hoap3.remote_controller.solvers.clik.clik_kernels import Basis

RANK, HOLDING, RANK_BEFORE, HOLDING_BEFORE, SAME, ENDED = range(6)
"""What `Active.counts` counts: see there."""

INTEGERS, ROWS, SQUARES, TALL, UNKNOWNS = 6, 11, 26, 21, 15
"""How much of each block does not depend on n: see `layout`."""


class Program(NamedTuple):
    """Min (β − 1)² + δ|λ|² subject to C(λ, β) ⪰ 0 (20) and lower ≤ S λ ≤ upper (25).

    Attributes:
        L: (n, n), of ė = −L Λ e.
        G: (n, n), LᵀL.
        St: (n, joints), Sᵀ of S = B diag(e) (24): a row for each gain.
        limits: (2, joints), of S λ, ∓inf where there is none.
        dt, delta: Δt β̃ and δ.
    """

    L: Matrix
    G: Matrix
    St: Matrix
    limits: Matrix
    dt: float
    delta: float


class Points(NamedTuple):
    """Points (λ, β), (n + 1,) each.

    Attributes:
        x: where the search is, and the answer.
        trial: where Newton's method is while x stays.
        before, way: answer of the tick before, and the way from the one before it to there.
        inside: where the interior-point method was when the last budget was spent.
    """

    x: Vector
    trial: Vector
    before: Vector
    way: Vector
    inside: Vector


class Dual(NamedTuple):
    """Multipliers.

    Attributes:
        Z: (n, n), Z ⪰ 0, of C ⪰ 0.
        z: (2, joints), z ≥ 0, of the limits; 0 where there is none.
    """

    Z: Matrix
    z: Matrix


class Active(NamedTuple):
    """What is active at the optimum: Z = Y Yᵀ, and limits that hold.

    Attributes:
        block: (n,), which rows of L belong together, by the number of the first one.
        home: (n,), block of each y_k: y_k is 0 elsewhere.
        held: (n,), limits that hold: 1 + r for the upper one of row r, −1 − r for the lower.
        Y: (any, n), the columns y_k of Y, as rows.
        nu: (n,), ν, multipliers of the limits that hold.
        counts: (6,), by `RANK` how many y_k there are, none where nothing is known; by `HOLDING`
            how many limits hold; both at the tick before, 0 where no way leads from there; by
            `SAME` for how many ticks they have been the same; by `ENDED` where the last budget
            ended, or 0.
    """

    block: Indices
    home: Indices
    held: Indices
    Y: Matrix
    nu: Vector
    counts: Indices


class Past(NamedTuple):
    """The last two answers' active set, for where they lead.

    Attributes:
        block, home, held: (n,), at the tick before.
        Y, Y_way: (n, n), y_k at the tick before, and their way from the one before it.
        nu, nu_way: (n,), likewise.
    """

    block: Indices
    home: Indices
    held: Indices
    Y: Matrix
    Y_way: Matrix
    nu: Vector
    nu_way: Vector


class Newton(NamedTuple):
    """Newton's method on the conditions of optimality, K·step = b.

    Attributes:
        C, V: (n, n), C(λ, β), and V = L − Δt Λ G of its derivative.
        K: the Newton matrix's upper triangle; as wide as there are unknowns λ, β, Y, ν, or wider.
        b: (unknowns,), what shall vanish, negative; then the step.
        w: (n,), Vᵀy_k.
        inverses, factors: (unknowns,), 1/D and a row of U of K = UᵀD⁻¹U.
        row: (n,), a row of the Cholesky factor of C + ρ Y Yᵀ, which is left in K.
        speed: (joints,), S λ.
    """

    C: Matrix
    V: Matrix
    K: Matrix
    b: Vector
    w: Vector
    inverses: Vector
    factors: Vector
    row: Vector
    speed: Vector


class Iterate(NamedTuple):
    """The matrices of one iteration of the interior-point method, (n, n) each.

    Attributes:
        C, V: as for `Newton`.
        U: Cholesky factor of C, then of Z.
        P, PZ: U⁻ᵀ of either, so that P C Pᵀ = I and PZ Z PZᵀ = I.
        X: C⁻¹ = PᵀP.
        XV, ZV: X V and Z V.
        VXV, VZV: VᵀX V and VᵀZ V.
    """

    C: Matrix
    V: Matrix
    U: Matrix
    P: Matrix
    PZ: Matrix
    X: Matrix
    XV: Matrix
    ZV: Matrix
    VXV: Matrix
    VZV: Matrix


class Step(NamedTuple):
    """A step of the interior-point method.

    Attributes:
        K: the Schur complement of λ and β, upper triangle, (n + 1, n + 1) or larger; its factor.
        g: (n + 1,), right-hand side without the limits.
        dx: (n + 1,), of λ and β.
        D: (n, n), ∂C/∂x·dx.
        bent: (n, n), D − Δt dλ dλᵀ∘G: D with the curvature of C.
        Z_step: (n, n), dZ = Q − Z − the symmetric part of X D Z.
        Q: (n, n), μX less the symmetric part of what is of second order, X E with
            E = D_p dZ_p − Δt (dλ_p dλ_pᵀ∘G) Z, p: of the predictor.
        W, T: (n, n), products on the way to dZ and Q.
        scaled: (n, n), P bent Pᵀ and PZ dZ PZᵀ, whose least eigenvalues tell how far it may go.
        column: (n + 1 or joints,), a column or row of a factor at hand; weights z/s of the limits.
        weighted: (joints,), a row of Sᵀ with these weights.
        eigen: (3, n), of `least_eigenvalue`.
    """

    K: Matrix
    g: Vector
    dx: Vector
    D: Matrix
    bent: Matrix
    Z_step: Matrix
    Q: Matrix
    W: Matrix
    T: Matrix
    scaled: Matrix
    column: Vector
    weighted: Vector
    eigen: Matrix


class Slacks(NamedTuple):
    """Distances to the limits as unknowns, (2, joints) each: lower and upper ones.

    Attributes:
        s: slacks, s > 0; inf where there is no limit.
        miss: s less the distance at hand.
        fall: how much s falls along a step.
        aim: (μ − second order)/s, where z shall be.
        dz: how much z changes.
    """

    s: Matrix
    miss: Matrix
    fall: Matrix
    aim: Matrix
    dz: Matrix


class Check(NamedTuple):
    """What gains certify, and the first guess of what is active.

    Attributes:
        C, V: as for `Newton`.
        W: (n, n), a copy of a symmetric matrix, overwritten while its eigenvalues are sought.
        E: (n, n), eigenvectors of Z, as rows.
        speed: (joints,), S λ.
        eigen: (3, n), of `least_eigenvalue`.
    """

    C: Matrix
    V: Matrix
    W: Matrix
    E: Matrix
    speed: Vector
    eigen: Matrix


class Work(NamedTuple):
    """Memory of all parts; C and V are shared."""

    newton: Newton
    iterate: Iterate
    step: Step
    slacks: Slacks
    check: Check


class Memory(NamedTuple):
    """All that a solver keeps, and its scratch.

    Attributes:
        offsets: (h + 1,), where each task begins, and n.
        rates, weights: (n,), of the targets, and w of V = ½ Σ w_i e_i².
        gains: (n,), λ [1/s] of the last solve.
        speeds: (2, joints), lower and upper limits of dq.
        dq, fed: (joints,), joint speeds, and what moving targets take of them.
        roots, through: (n,), √w, and L₀⁻¹ rates.
        Bt: (n, joints), Bᵀ.
        U: (n, n), L as `solve_loop` eliminates it.
        L, G, St, limits: of `Program`.
        kept: (n + 1,), gains of the last solve and what they certify.
        basis, points, dual, active, past, work: see there.
    """

    offsets: Indices
    rates: Vector
    weights: Vector
    gains: Vector
    speeds: Matrix
    dq: Vector
    fed: Vector
    roots: Vector
    through: Vector
    Bt: Matrix
    U: Matrix
    basis: Basis
    L: Matrix
    G: Matrix
    St: Matrix
    limits: Matrix
    points: Points
    kept: Vector
    dual: Dual
    active: Active
    past: Past
    work: Work


def layout(plan: Indices, rows: Matrix, tall: Matrix, unknowns: Matrix) -> Memory:
    """Name the parts of the four blocks; for Python, and as `named` for kernels.

    Args:
        plan: integers, (INTEGERS + 6n + h + 1,).
        rows: what has rows of n, (ROWS + (3 + SQUARES)·n, n).
        tall: what has rows of joints, (TALL + 3n, joints).
        unknowns: what has rows of n + 1 or of joints, and K; (UNKNOWNS + u, u or joints, whichever
            is more) for u unknowns.
    """
    n = rows.shape[1]
    squares = rows[ROWS:].reshape(3 + SQUARES, n, n)  # no more reshapes: one takes 10 ns
    Y, A = squares[:3], squares[3:]
    Bt, Q, St = tall[TALL : TALL + n], tall[TALL + n : TALL + 2 * n], tall[TALL + 2 * n :]
    integers, offsets = plan[INTEGERS : INTEGERS + 6 * n], plan[INTEGERS + 6 * n :]
    block, home, held = integers[:n], integers[n : 2 * n], integers[2 * n : 3 * n]
    past = integers[3 * n : 4 * n], integers[4 * n : 5 * n], integers[5 * n :]
    u, eigen, K = unknowns, unknowns[12:15], unknowns[15:]
    C, V, m = A[3], A[4], n + 1
    newton = Newton(C, V, K, u[8], rows[9], u[9], u[10], rows[10], tall[18])
    iterate = Iterate(C, V, A[5], A[6], A[7], A[8], A[9], A[10], A[11], A[12])
    matrices = A[13], A[14], A[15], A[16], A[17], A[18], A[19]
    step = Step(K, u[6, :m], u[7, :m], *matrices, u[11], tall[20], eigen)
    slacks = Slacks(tall[8:10], tall[10:12], tall[12:14], tall[14:16], tall[16:18])
    check = Check(C, V, A[20], A[21], tall[19], eigen)
    return Memory(
        offsets,
        rows[0],
        rows[1],
        rows[2],
        tall[:2],
        tall[2],
        tall[3],
        rows[4],
        rows[5],
        Bt,
        A[22],
        Basis(Q, A[23], A[24], A[25], K, rows[6]),
        A[0],
        A[1],
        St,
        tall[4:6],
        Points(u[0, :m], u[1, :m], u[2, :m], u[3, :m], u[4, :m]),
        u[5, :m],
        Dual(A[2], tall[6:8]),
        Active(block, home, held, Y[0], rows[3], plan[:INTEGERS]),
        Past(*past, Y[1], Y[2], rows[7], rows[8]),
        Work(newton, iterate, step, slacks, check),
    )


named = inlined(layout)
