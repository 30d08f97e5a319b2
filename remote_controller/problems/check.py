"""Whether an answer solves its problem: by multipliers, which are tested and need not be trusted.

`check` asks whether the answer is the exact optimum of a problem whose limits and gradients differ
from the stated ones by no more than their errors. So no threshold decides what is "active": a row
may hold the answer where the answer is at its limit to that error.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.optimize import linprog, nnls

from hoap3.remote_controller.problems.gain_program import gap_of
from hoap3.remote_controller.problems.statement import (
    Array,
    Cascade,
    Claim,
    ClosedForm,
    Flags,
    GainProgram,
    MaximalRate,
    Problem,
    Program,
    Rows,
    Statement,
)

ROUNDING = 64.0 * float(np.finfo(float).eps)
"""Of a sum of some ten products, relative to the sizes of its terms."""
STEPS = 100  # of non-negative least squares, for each unknown
CLOSE = {"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10}
INFEASIBLE = 2  # status of scipy's linprog
DEPENDENT = 1e-9  # of a singular value of equations of length 1: less is 0
TINY = 1e-290  # in place of 0, so that all but 0 is many times as large


class Finding(NamedTuple):
    """One comparison.

    Attributes:
        name: of what was compared.
        stated, found: of the claim; of a problem the deviation and 0.
        off: how far apart they are, the wrong way.
        allowed: how far they may be.
    """

    name: str
    stated: float
    found: float
    off: float
    allowed: float

    @property
    def holds(self) -> bool:
        """Whether they are no further apart than allowed; false for NaN."""
        return self.off <= self.allowed


def check(statement: Statement) -> list[Finding]:
    """Compare everything that is claimed of an answer.

    Returns:
        Of each claim what was found, and of the problems those findings that hold, or else those
        of the problem that the answer is nearest to.
    """
    found = [_compared(claim) for claim in statement.claims]
    nearest: list[Finding] = []
    for make in statement.problems:
        tried = check_problem(make(), statement.answer, statement.answer_error)
        if all(each.holds for each in tried):
            return found + tried
        if not nearest or _worst(tried) < _worst(nearest):
            nearest = tried
    return found + nearest


def check_problem(problem: Problem, answer: Array, error: Array) -> list[Finding]:
    """Whether an answer, exact to `error`, both (p,), solves a problem."""
    if isinstance(problem, ClosedForm):
        return _check_closed_form(problem, answer, error)
    if isinstance(problem, MaximalRate):
        return _check_rate(problem, answer, error)
    if isinstance(problem, GainProgram):
        return _check_gains(problem)
    if isinstance(problem, Cascade):
        return _check_cascade(problem, answer, error)
    return _check_program(problem, answer, error)


def _worst(findings: list[Finding]) -> float:
    """The largest deviation, relative to what is allowed."""
    return max(
        0.0 if each.off <= 0.0 else each.off / each.allowed if each.allowed else np.inf
        for each in findings
    )


def _compared(claim: Claim) -> Finding:
    name, stated, value, error, relation = claim
    stated, value = float(stated), float(value)
    difference = stated - value
    if stated == value or (math.isnan(stated) and math.isnan(value)):
        off = 0.0
    elif math.isnan(difference):
        off = difference
    elif relation == "equal":
        off = abs(difference)
    else:
        off = max(difference if relation == "at_most" else -difference, 0.0)
    return Finding(name, stated, value, off, float(error))


def _largest(name: str, off: Array, allowed: Array) -> Finding:
    """The finding of the entry that is worst, relative to what is allowed."""
    if not off.size:
        return Finding(name, 0.0, 0.0, 0.0, 0.0)
    with np.errstate(invalid="ignore"):  # a row without a limit
        share = np.where(off <= 0.0, 0.0, off / np.maximum(allowed, TINY))
    at = share.argmax()  # the first NaN where there are any
    worst = float(off[at])
    return Finding(name, worst, 0.0, max(worst, 0.0), float(allowed[at]))


def _check_closed_form(problem: ClosedForm, answer: Array, error: Array) -> list[Finding]:
    allowed = problem.error + error
    tried = [_largest("answer", np.abs(answer - each), allowed) for each in problem.allowed]
    return [min(tried, key=lambda each: _worst([each]))]


def _check_rate(problem: MaximalRate, answer: Array, error: Array) -> list[Finding]:
    """That the rate is the largest one, and that the answer is the best one with that rate."""
    z, _ = _variables(problem.then, answer)
    bound = upper_bound(problem.rate, problem.rows)
    best, rate = min(bound.value, problem.wanted), float(problem.rate @ z)
    if np.isfinite(best):
        lacks, size = best - rate, abs(best)
        lacks = min(abs(lacks - share * size) for share in (0.0, *problem.retreats))
        lacks = 0.0 if rate >= best else lacks
        allowed = problem.error + float(problem.rows.error.max(initial=0.0)) * bound.pull
        allowed += max(problem.retreats[:1], default=0.0) * size
    else:
        lacks, allowed = np.inf, 0.0
    return [
        Finding("largest rate", rate, best, float(lacks), float(allowed)),
        *_check_program(problem.then, answer, error),
    ]


def _check_gains(problem: GainProgram) -> list[Finding]:
    speeds = problem.S @ problem.gains
    beyond = np.maximum(speeds - problem.most, problem.least - speeds)
    gap = gap_of(problem, 0.5 * problem.gap)
    return [
        _largest("limits", beyond, problem.error),
        Finding("optimum", gap, 0.0, gap, problem.gap),
    ]


def _check_cascade(problem: Cascade, answer: Array, error: Array) -> list[Finding]:
    """That each step is the optimum of its level, and that all together are the answer."""
    found: list[Finding] = []
    exact, slack = np.zeros(len(answer)), 0.0
    rows, (x, Z, _) = problem.rows, start_of(problem.equations)
    for (J, b), step in zip(problem.levels, problem.steps, strict=True):
        N = Z.shape[1]
        if not N:
            break
        within = replace(
            rows,
            A=rows.A @ Z,
            a=rows.a + rows.A @ x,
            lower=rows.lower - slack,
            upper=rows.upper + slack,
        )
        R, r = np.vstack([J @ Z, math.sqrt(problem.damping) * np.eye(N)]), b - J @ x
        none, given = np.zeros(N), (Z, x, problem.error, Z.T @ step)
        program = Program(R, np.append(r, none), none, none, within, *given)
        found += _check_program(program, x + step, exact)
        x, (Z, _), slack = x + step, remaining(Z, J, problem.rank), problem.slack
    return [*found, _largest("answer", np.abs(x - answer), problem.error + error)]


def start_of(equations: Rows) -> tuple[Array, Array, Array]:
    """Return the shortest x (n,) that keeps equations, rows of length 1, where a cascade starts.

    And a basis Z (n, N) of what they map to 0, and the error of x, (n,).
    """
    E, one = equations.A, np.eye(equations.A.shape[1])
    if not len(E):
        return 0.0 * one[0], one, 0.0 * one[0]
    rank = DEPENDENT / float(np.linalg.norm(E, 2))
    inverse, (Z, _) = np.linalg.pinv(E, rank), remaining(one, E, rank)
    return inverse @ equations.lower, Z, np.abs(inverse) @ equations.error


def remaining(Z: Array, J: Array, rank: float) -> tuple[Array, float]:
    """Return a basis of the part of span Z, Z (n, N), that J (m, n) maps to 0; see `Cascade`.

    And the least singular value of J Z that does not count as 0, relative to |J|.
    """
    size = max(float(np.linalg.norm(J, 2)), TINY)
    _, s, Vt = np.linalg.svd(J @ Z)
    kept = s[s > rank * size]
    return np.asarray(Z @ Vt[len(kept) :].T), float(kept.min(initial=size)) / size


def _variables(problem: Program, answer: Array) -> tuple[Array, Array]:
    """Variables that give the answer, (N,), and what a change of it makes of them, (N, p)."""
    E, e = problem.E, problem.e
    N = E.shape[1]
    if problem.z is not None:
        z = problem.z
    elif problem.shows_all:
        z = answer - e
    else:  # of all that give the answer those of the least cost
        H, f = problem.R.T @ problem.R, problem.c - problem.R.T @ problem.r
        equal = problem.rows.lower == problem.rows.upper
        C = np.vstack([E, problem.rows.A[equal]])
        d = np.concatenate([answer - e, (problem.rows.lower - problem.rows.a)[equal]])
        K = np.block([[H, C.T], [C, np.zeros((len(C), len(C)))]])
        z = np.linalg.lstsq(K, np.concatenate([-f, d]), rcond=None)[0][:N]
    return z, E if problem.shows_all else np.asarray(np.linalg.pinv(E), float)


class _Sides(NamedTuple):
    """Normals of the limits that may hold z, (k, N); a multiplier of each is not negative."""

    normals: Array
    A_error: Array


def _check_program(problem: Program, answer: Array, answer_error: Array) -> list[Finding]:
    """That z keeps the rows, and that multipliers show its cost to be the least."""
    z, to_z = _variables(problem, answer)
    rows, size, found = problem.rows, np.abs(z), []
    if not problem.shows_all or problem.z is not None:
        terms = np.abs(problem.E) @ size + np.abs(problem.e)
        off = np.abs(problem.E @ z + problem.e - answer)
        found.append(_largest("answer", off, answer_error + ROUNDING * terms))
    v, of_answer = rows.A @ z + rows.a, np.abs(rows.A @ to_z)
    near = rows.error + of_answer @ answer_error + ROUNDING * (np.abs(rows.A) @ size)
    over, under = v - rows.upper, rows.lower - v
    beyond = np.where(rows.optional, -np.inf, np.maximum(over, under))
    found.append(_largest("rows", beyond, near))
    near = near + of_answer @ problem.error  # the optimum may be at a limit where z is not quite
    upper, lower = np.abs(over) <= near, np.abs(under) <= near
    sides = _Sides(
        np.concatenate([rows.A[upper], -rows.A[lower]]),
        np.concatenate([rows.A_error[upper], rows.A_error[lower]]),
    )
    off, allowed = _stationarity(problem, z, to_z, answer_error, sides)
    return [*found, _largest("optimum", off, allowed)]


def _stationarity(
    problem: Program, z: Array, to_z: Array, answer_error: Array, sides: _Sides
) -> tuple[Array, Array]:
    """How far z is from the optimum for the best multipliers, in the answer's unit.

    The gradient that multipliers leave is divided by the curvature. Along variables without
    curvature, as the largest speed of an ℓ∞ cost, it is divided by the mean curvature of others.

    Args:
        problem: whose z it is.
        z: (N,).
        to_z: (N, p), what a change of the answer makes of z.
        answer_error: (p,), how exactly the answer is known.
        sides: the limits that may hold z.

    Returns:
        (q,) and how large each may be, (q,).
    """
    R, l1, normals, size = problem.R, problem.l1, sides.normals, np.abs(z)
    H, reach = R.T @ R, np.abs(to_z)
    D, away = _to_answer(H, problem), reach @ problem.error
    still = (size <= reach @ answer_error + away) & (l1 > 0.0)
    slack = np.where(still, l1, 0.0)
    smooth = H @ z - R.T @ problem.r + problem.c + (l1 - slack) * np.sign(z)
    sizes = np.abs(H) @ size + np.abs(R).T @ np.abs(problem.r) + np.abs(problem.c) + l1
    most = away if problem.shows_all else np.concatenate([problem.error, away])
    if len(D) > len(most):
        flat = np.full(len(D) - len(most), problem.error.max(initial=0.0))
        most = np.concatenate([most, flat])
    doubt, scale = ROUNDING * sizes + np.abs(H @ to_z) @ answer_error, np.abs(D)
    off, allowed = np.full(len(D), np.inf), most
    for multipliers in (_of_moving, _of_all):
        held = multipliers(D, smooth, normals, still, l1)
        pull = smooth + held @ normals
        pull -= np.maximum(np.minimum(pull, slack), -slack)
        rounding = doubt + ROUNDING * (held @ np.abs(normals))
        rest = ROUNDING * (np.abs(D @ normals.T) @ held).max(initial=0.0)  # of least squares
        off, allowed = np.abs(D @ pull), most + rest + scale @ (rounding + sides.A_error @ held)
        if (off <= allowed).all() or not still.any():
            break
    return off, allowed


def _of_moving(D: Array, smooth: Array, normals: Array, still: Flags, l1: Array) -> Array:
    """Multipliers for the variables that an ℓ1 cost does not hold at 0, which mostly suffice."""
    del l1
    free = ~still
    D = D[:, free]
    return _non_negative(D @ normals[:, free].T, -D @ smooth[free])


def _of_all(D: Array, smooth: Array, normals: Array, still: Flags, l1: Array) -> Array:
    """Multipliers of sides, (k,), together with those −1 ≤ σ ≤ 1 of variables that stand still.

    The unknowns of least squares are not negative: σ + 1 and 1 − σ, which add up to 2.
    """
    bends = np.diag(l1)[still]
    k, s = len(normals), len(bends)
    target = -D @ (smooth - bends.sum(0))
    A = np.zeros((len(target) + s, k + 2 * s))
    A[: len(target), :k], A[: len(target), k : k + s] = D @ normals.T, D @ bends.T
    weight = 1.0 + float(np.abs(target).max(initial=0.0))
    A[len(target) :, k : k + s] = A[len(target) :, k + s :] = weight * np.eye(s)
    return _non_negative(A, np.append(target, np.full(s, 2.0 * weight)))[:k]


def _to_answer(H: Array, problem: Program) -> Array:
    """What maps a gradient to a change of the answer and of all variables, (q, N).

    The variables as well: one that the answer does not show, such as a slack, may hide that the
    answer is not optimal.
    """
    curvature, N = H.diagonal(), len(H)
    if np.count_nonzero(H) == np.count_nonzero(curvature) == N:
        parts = [np.diag(1.0 / curvature)]
    else:
        values, vectors = np.linalg.eigh(H)
        curved = values > ROUNDING * values[-1]
        bent, free = vectors[:, curved], vectors[:, ~curved]
        free = free / (float(values[curved].mean()) if curved.any() else 1.0)
        parts = [(bent / values[curved]) @ bent.T, free.T]
    return np.concatenate(parts if problem.shows_all else [problem.E @ parts[0], *parts])


def _non_negative(A: Array, b: Array) -> Array:
    """The x ≥ 0 with the least |A x − b|, for columns of any length."""
    if not A.shape[1]:
        return np.zeros(0)
    length = np.sqrt((A * A).sum(0))
    length[length == 0.0] = 1.0
    try:
        found: Array = nnls(A / length, b, maxiter=STEPS * A.shape[1])[0] / length
    except (RuntimeError, ValueError):  # too many steps, or an overflow: not optimal
        return np.zeros(A.shape[1])
    return found


class Bound(NamedTuple):
    """What g·z does not exceed.

    Attributes:
        value: inf: nothing is proved, or there is no end; −inf: nothing keeps the rows.
        pull: its change if all limits are relaxed by 1: the sum of all multipliers.
    """

    value: float
    pull: float = 0.0


def upper_bound(g: Array, rows: Rows) -> Bound:
    """What g·z, g (N,), does not exceed within rows: weak duality (Farkas' lemma).

    For any multipliers λ ≥ 0 with Aᵀλ = g, g·z ≤ λ·limits. They come from scipy's linprog; what
    they leave of g counts with the largest entry of the z that was found.
    """
    equal = rows.lower == rows.upper
    up, down = np.isfinite(rows.upper) & ~equal, np.isfinite(rows.lower) & ~equal
    A = np.vstack([rows.A[up], -rows.A[down]])
    b = np.concatenate([(rows.upper - rows.a)[up], (rows.a - rows.lower)[down]])
    C, d = rows.A[equal], (rows.upper - rows.a)[equal]
    found = linprog(-g, A, b, C, d, bounds=(None, None), method="highs", options=CLOSE)
    if found.status:
        return Bound(-np.inf if found.status == INFEASIBLE else np.inf)
    held, tied = np.maximum(-found.ineqlin.marginals, 0.0), -found.eqlin.marginals
    rest = np.abs(g - held @ A - tied @ C)
    value = held @ b + tied @ d + rest.sum() * (1.0 + float(np.abs(found.x).max(initial=0.0)))
    return Bound(float(value), float(held.sum() + np.abs(tied).sum()))


def infeasibility(rows: Rows, kept: Rows | None = None) -> float:
    """By how much every z breaks some row, at the least, by the multipliers of a linear program.

    0 or less: there may be a z that keeps all. For any λ ≥ 0 with Σλ = 1 and Aᵀλ = 0, some row is
    broken by −λ·limits or more.

    Args:
        rows: of which some are broken.
        kept: rows that each such z keeps.
    """
    up, down = np.isfinite(rows.upper), np.isfinite(rows.lower)
    A = np.vstack([rows.A[up], -rows.A[down]])
    b = np.concatenate([(rows.upper - rows.a)[up], (rows.a - rows.lower)[down]])
    A = np.hstack([A, -np.ones((len(A), 1))])
    if kept is not None:
        up, down = np.isfinite(kept.upper), np.isfinite(kept.lower)
        exact = np.vstack([kept.A[up], -kept.A[down]])
        A = np.vstack([A, np.hstack([exact, np.zeros((len(exact), 1))])])
        b = np.concatenate([b, (kept.upper - kept.a)[up], (kept.a - kept.lower)[down]])
    cost = np.append(np.zeros(rows.A.shape[1]), 1.0)
    free: list[tuple[float | None, float | None]] = [(None, None)] * rows.A.shape[1]
    found = linprog(cost, A, b, bounds=[*free, (-1.0, None)], method="highs", options=CLOSE)
    if found.status:
        return np.inf if found.status == INFEASIBLE else np.nan  # nan: nothing is proved
    held = np.maximum(-found.ineqlin.marginals, 0.0)
    share = float(-(held @ A[:, -1]))  # 1, but for rounding and where t is at its end
    held = held / max(share, 1.0)
    rest = float(np.abs(held @ A[:, :-1]).sum()) * (1.0 + float(np.abs(found.x).max()))
    return float(-(held @ b) - max(1.0 - share, 0.0) - rest)
