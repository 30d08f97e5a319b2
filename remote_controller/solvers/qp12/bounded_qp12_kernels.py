"""QP12 with bounds, without a QP solver: joints beyond their limits are clamped, exactly.

    min  γ|W u|₁ + (1−γ)/2 |W u|²   subject to   gradient·u = −decrease,  lower ≤ u ≤ upper

with W = diag(weights) > 0 and 0 within the bounds. Without bounds this is QP12 of Gonçalves et al.,
IEEE T-RO 2020, (26), in y = W u and with the gradient W⁻¹∇V: a weight of 2 makes a speed count
twice in both norms, which is why both norms carry W.

QP12 is solved for the free joints; those beyond their limit are clamped to it, what they deliver
is taken off the decrease, and the rest is solved again. A clamped joint delivers less than it
would have, so the multiplier of the equation can only rise: no clamp is ever taken back, and the
set is exact after at most n rounds. The multiplier is guessed first, by Newton's method on
what all joints deliver together. Who moves at the guess nearly always moves at the answer, which
then takes no round at all but one exact sum over them, and a check of every joint. The guess is
never above the multiplier, and x rises with it: what is clamped for a guess, beyond its limit by
more than rounding, is clamped in the answer, so guessing costs no digit.

As a joint moves only down the gradient (Lemma 4; up for a negative decrease), only one of its
limits counts. The most that the bounds allow is Σ |gradient_i|·limit_i, the closed form of (7).
"""

from __future__ import annotations

import math

from hoap3.protocol.runtime.numba_jit import Matrix, Vector, inlined, kernel
from hoap3.remote_controller.solvers.base.status import BAD_INPUT, BAD_SHAPE, OK
from hoap3.remote_controller.solvers.linalg.scaling_kernels import MAX, TINY
from hoap3.remote_controller.solvers.qp12.qp12_kernels import solve_qp12

TRIALS = 16  # of the search for the multiplier
SETTLED = 1e-12  # of the decrease: by so little too little, it is found
SHORT = 0.5 * SETTLED  # of the decrease: what is aimed at lies below it, for certain
CERTAIN = 1e-14  # relative: more than rounding
LARGE = 1e100  # what lies between this and its inverse is squared without a second thought
ROUNDING = 1e-15  # relative, per joint: a remainder below n times this share of the demand is 0


def work_shape(n: int) -> tuple[int, int]:
    """Shape of the work array for n joints: [weights | a | limit | x], of which one sets the first.

    The rest is scratch: a = W⁻¹∇V, the limit of W u that counts, and W u of a round.
    """
    return 4, n


@inlined
def bounds_fit(lower: Vector, upper: Vector) -> bool:
    """Whether 0 is within all bounds; ±inf is no bound, NaN never fits."""
    fit = True
    for i in range(lower.size):
        fit &= lower[i] <= 0.0 <= upper[i]
    return fit


@inlined
def most_decrease(gradient: Vector, lower: Vector, upper: Vector, downhill: bool) -> float:
    """Largest −gradient·u (`downhill`), or largest gradient·u, within the bounds; may be inf."""
    most = 0.0
    for i in range(gradient.size):
        if gradient[i] != 0.0:
            limit = -lower[i] if (gradient[i] > 0.0) == downhill else upper[i]
            if limit > 0.0:
                most += abs(gradient[i]) * limit
    return most


@inlined
def _multiplier(a: Vector, limit: Vector, demand: float, kappa: float) -> float:
    """A little less than the λ for which Σ |a_i|·x_i is the demand, 0 ≤ x_i = λ|a_i| − κ ≤ limit_i.

    It is λ_M/(1 − γ) of (28).

    The sum rises with λ, piecewise linearly. Where Newton's method does not find the place, it is
    the largest λ that was seen to deliver too little; not finite where the numbers are too extreme.
    """
    squares, total = 0.0, 0.0
    for i in range(a.size):
        squares += a[i] * a[i]
        total += abs(a[i])
    below, above, aim = 0.0, math.inf, demand * (1.0 - SHORT)
    trial = (aim + kappa * total) / squares  # the λ if all joints move and none is at its limit
    for _ in range(TRIALS):
        delivered, slope = 0.0, 0.0
        for i in range(a.size):
            share = abs(a[i])
            x = trial * share - kappa
            delivered += share * min(max(x, 0.0), limit[i])
            slope += share * share if 0.0 < x < limit[i] else 0.0
        lacking = demand - delivered
        if lacking > CERTAIN * demand:
            below = trial
            if lacking <= SETTLED * demand:
                break
        else:
            above = trial
        step = trial + (aim - delivered) / slope
        if not below < step < above:
            step = 0.5 * (below + above) if above < math.inf else 2.0 * trial
        trial = step
    return below


@inlined
def _remaining(rest: float, demand: float, n: int) -> float:
    """What clamped joints leave of a demand, 0 where it is rounding: see `ROUNDING`.

    Otherwise a joint with a gradient of rounding size would move at its limit.
    """
    return rest if rest > n * ROUNDING * demand else 0.0


@inlined
def _clamp(
    a: Vector, limit: Vector, demand: float, gamma: float, out: Vector, step: Vector
) -> tuple[float, int, bool]:
    """Clamp joints that are beyond their limit for certain; what is left to deliver, and how many.

    Their a becomes 0, and their u, in the signs of a positive decrease, is written. The third value
    says that `step` is the answer for the others.
    """
    kappa, rest, clamped = gamma / (1.0 - gamma), demand, 0
    guess = _multiplier(a, limit, demand, kappa)
    if not guess * demand <= MAX:
        return rest, clamped, False
    for i in range(a.size):
        x = abs(a[i]) * guess
        certain = x - kappa > limit[i] + CERTAIN * (x + kappa)
        rest -= abs(a[i]) * limit[i] if certain else 0.0
        out[i] = math.copysign(limit[i], -a[i]) if certain else 0.0
        a[i] = 0.0 if certain else a[i]
        clamped += certain
    rest = _remaining(rest, demand, a.size)
    return rest, clamped, _share(a, limit, rest, kappa, guess, step)


@inlined
def _share(a: Vector, limit: Vector, rest: float, kappa: float, guess: float, step: Vector) -> bool:
    """Write QP12's answer for what is left, if those move that do at the guess; whether they do.

    The formula and its order of operations are those of `qp12_kernels`, which scales first.
    """
    A = 0.0
    for i in range(a.size):
        step[i] = abs(a[i]) if guess * abs(a[i]) > kappa else 0.0
        A = max(A, step[i])
    if not (1.0 / LARGE <= A <= LARGE and 1.0 / LARGE <= rest <= LARGE and kappa <= LARGE):
        return False
    price, supply, weight = kappa / A, rest, 0.0
    for i in range(a.size):
        supply += step[i] * (price * (A - step[i]))
        weight += step[i] * step[i]
    tau, as_guessed = supply / weight, True
    for i in range(a.size):
        x = abs(a[i]) * tau - price * (A - abs(a[i]))
        as_guessed &= (x <= limit[i]) & ((x > 0.0) == (step[i] > 0.0))
        step[i] = math.copysign(max(x, 0.0), -a[i])
    return as_guessed


@inlined
def solve_bounded_qp12(
    gradient: Vector,
    decrease: float,
    gamma: float,
    lower: Vector,
    upper: Vector,
    work: Matrix,
    out: Vector,
) -> tuple[int, int]:
    """Solve one QP12 within bounds; for other kernels to call.

    Args:
        gradient: ∇V, shape (n,).
        decrease: −V̇ to be reached; any sign.
        gamma: 0 (even) to 1 (sparse, the limit: joints with equal |gradient|/weight share evenly).
        lower: ≤ 0, (n,), −inf where there is none.
        upper: ≥ 0, (n,), inf where there is none.
        work: shape `work_shape(n)`; its first row holds the weights, positive.
        out: u, (n,), not `gradient`. Zeros where the status is not `OK`, untouched where it is
            `BAD_SHAPE`.

    Returns:
        Status, and the number of joints that were clamped. `INFEASIBLE`: the bounds, or a zero
        gradient, do not allow that decrease; `BAD_INPUT`: something is not finite, γ not in
        [0, 1], a weight not positive, 0 not within the bounds; `BAD_SHAPE`; `OUT_OF_RANGE`.
    """
    n = gradient.size
    if not (out.size == n and lower.size == n and upper.size == n and work.shape == (4, n)):
        return BAD_SHAPE, 0
    weights, a, limit, step = work[0], work[1], work[2], work[3]
    down = -1.0 if decrease < 0.0 else 1.0
    fit = True
    for i in range(n):
        out[i] = 0.0
        fit &= (TINY <= weights[i] <= MAX) & (lower[i] <= 0.0 <= upper[i])
        slope = gradient[i] / weights[i]
        limit[i] = (-lower[i] if slope * down > 0.0 else upper[i]) * weights[i]
        a[i] = 0.0 if limit[i] == 0.0 and abs(slope) <= MAX else slope
    if not fit:
        return BAD_INPUT, 0
    demand, clamped, done = abs(decrease), 0, False
    rest = demand
    if 0.0 <= gamma < 1.0 and 0.0 < demand <= MAX:
        rest, clamped, done = _clamp(a, limit, demand, gamma, out, step)
    while not done:
        status = solve_qp12(a, rest, gamma, step)
        if status != OK:
            out[:] = 0.0
            return status, 0
        beyond = 0
        for i in range(n):
            beyond += abs(step[i]) > limit[i]
        if beyond == 0:
            break
        clamped += beyond
        for i in range(n):
            if abs(step[i]) > limit[i]:
                rest -= abs(a[i]) * limit[i]
                out[i] = math.copysign(limit[i], step[i])
                a[i] = 0.0
        rest = _remaining(rest, demand, n)
    for i in range(n):
        u = (out[i] + step[i]) * down / weights[i]  # one of them is 0
        out[i] = min(max(u, lower[i]), upper[i]) + 0.0  # the division may miss by one bit
    return OK, clamped


@inlined
def bounded_kkt_residual(  # noqa: PLR0912 - three cases, in two passes
    gradient: Vector,
    decrease: float,
    gamma: float,
    lower: Vector,
    upper: Vector,
    u: Vector,
    work: Matrix,
) -> float:
    """How far u is from optimal, relative and without units; for other kernels to call.

    With x_i = ∓sign(gradient_i) w_i u_i, a_i = |gradient_i|/w_i, the limit l_i in that direction
    and κ = γ/(1−γ), optimality means that there is one multiplier for all joints:

        x_i = min(l_i, max(0, (a_i t − κ (A − a_i)) / A)),   a·x = |decrease|

    where A and t are a and x of any joint that moves below its limit. The one with the largest a
    is taken; where there is none, the joint at its limit that needs the largest multiplier. The
    residual is the larger of the relative error of the equation and the largest deviation of an
    x_i from its right side, relative to the largest x. inf where nothing can be judged, never NaN.
    """
    n = gradient.size
    if not (0.0 <= gamma <= 1.0 and abs(decrease) <= MAX):
        return math.inf
    weights, a, limit, x = work[0], work[1], work[2], work[3]
    down = -1.0 if decrease < 0.0 else 1.0
    kappa = gamma / (1.0 - gamma) if gamma < 1.0 else 0.0
    A, t, fits = 0.0, 0.0, True
    span, power, total = 0.0, -abs(decrease), abs(decrease)
    for i in range(n):
        a[i] = abs(gradient[i]) / weights[i]
        x[i] = -math.copysign(1.0, gradient[i]) * down * u[i] * weights[i]
        limit[i] = (-lower[i] if gradient[i] * down > 0.0 else upper[i]) * weights[i]
        fits &= (a[i] <= MAX) & (abs(x[i]) <= MAX)
        span = max(span, abs(x[i]))
        power += a[i] * x[i]
        total += a[i] * abs(x[i])
        if a[i] > A and 0.0 < x[i] < limit[i]:
            A, t = a[i], x[i]
    if not fits:
        return math.inf
    if A == 0.0:  # every joint that moves is at its limit
        need = -1.0
        for i in range(n):
            if a[i] > 0.0 and x[i] > 0.0:
                needed = (kappa + x[i]) / a[i] if gamma < 1.0 else 1.0 / a[i]
                if needed > need:
                    need, A, t = needed, a[i], x[i]
    slope, price = (t / A, kappa / A) if A > 0.0 else (0.0, 0.0)
    deviation = 0.0
    for i in range(n):
        if a[i] == 0.0 or A == 0.0:
            wanted = 0.0
        elif gamma < 1.0:
            wanted = min(limit[i], max(0.0, a[i] * slope - price * (A - a[i])))
        elif a[i] == A:
            wanted = min(limit[i], max(0.0, x[i]))
        else:
            wanted = limit[i] if a[i] > A else 0.0
        deviation = max(deviation, abs(x[i] - wanted))
    if total == 0.0 and deviation == 0.0:
        return 0.0
    residual = max(abs(power) / max(total, TINY), deviation / max(span, TINY))
    return residual if residual <= MAX else math.inf


@kernel()
def bounded_qp12_kernel(
    gradient: Vector,
    decrease: float,
    gamma: float,
    lower: Vector,
    upper: Vector,
    work: Matrix,
    out: Vector,
) -> float:
    """`solve_bounded_qp12`: its KKT residual, or −status where that is not `OK`.

    One number, as a tuple of them costs as much as a twentieth of the solve.
    """
    status, _ = solve_bounded_qp12(gradient, decrease, gamma, lower, upper, work, out)
    if status != OK:
        return -float(status)
    return bounded_kkt_residual(gradient, decrease, gamma, lower, upper, out, work)
