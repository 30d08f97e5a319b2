"""Rows of accelerations beside the bounds, (13c), of `Ghc`, `ghc`, `hqp` and `weighted`."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
import quadprog
from hypothesis import given
from hypothesis import strategies as st
from row_problems import Rows, limits, plain, violation, with_rows
from support.solvers.one_shot import ghc, hqp, weighted

from hoap3.protocol.errors import BadProblemError, InfeasibleError, SolverError
from hoap3.remote_controller.solvers import Ghc
from hoap3.remote_controller.solvers.base import status as codes

SEEDS = st.integers(0, 2**32 - 1)
INF = np.inf


def solver_for(it, rows: Rows) -> tuple[Ghc, int]:
    sizes, s = [len(J) for J in it.jacobians], len(rows.lower)
    solver = Ghc(sizes, len(it.bias), regularise=it.regularise, rows=s)
    solver.qdd_lower[:], solver.qdd_upper[:], solver.tau_lower[:], solver.tau_upper[:] = it.bounds
    solver.rows[:], solver.rows_lower[:], solver.rows_upper[:] = rows.R, rows.lower, rows.upper
    stack = np.vstack(it.jacobians), np.concatenate(it.targets)
    return solver, solver.solve(*stack, it.alpha, it.M, it.bias, it.w_r)


def agrees(seed: int) -> str:
    """Compare one problem with the plain program; what came out."""
    it, rows = with_rows(seed)
    solver, status = solver_for(it, rows)
    if status != codes.OK:
        assert status == codes.INFEASIBLE, seed
        assert violation(it, rows) > 1e-9, seed
        assert not solver.qdd.any()
        assert not solver.rows_multipliers.any()
        return "infeasible"
    assert solver.kkt_residual < 1e-7, seed
    assert rows.missed(solver.qdd).max() < 1e-8, seed
    right = plain(it, rows)
    if right is None:  # quadprog is wrong now and then: then the proof is the solver's own
        return "proved"
    assert np.abs(solver.qdd - right).max() <= 1e-6 * (1 + np.abs(right).max()), seed
    return "same"


def test_equals_the_plain_program():
    came = [agrees(seed) for seed in range(400)]
    assert came.count("same") > 150
    assert came.count("infeasible") > 50
    assert came.count("proved") < 10


@pytest.mark.long
def test_equals_the_plain_program_on_thousands():
    came = [agrees(seed) for seed in range(1000, 11000)]
    assert came.count("same") > 5000
    assert came.count("proved") < 100


@given(SEEDS)
def test_equations_are_kept_to_rounding(seed):
    it, rows = with_rows(seed)
    solver, status = solver_for(it, rows)
    equal = rows.lower == rows.upper
    if status == codes.OK and equal.any():
        off = np.abs(rows.R @ solver.qdd - rows.lower)[equal]
        size = rows.lengths[equal] * (1 + np.abs(solver.qdd).max())
        assert (off <= 1e-10 * size).all()


@given(SEEDS)
def test_multipliers_prove_the_answer_in_the_rows_own_units(seed):
    """Stationarity of the Lagrangian of (13) in every x_i, with the rows as they were given."""
    it, rows = with_rows(seed)
    solver, status = solver_for(it, rows)
    if status != codes.OK:
        return
    from row_problems import spanned

    effort = {"none": 0.0, "torque": solver.tau}.get(it.regularise, solver.tau - it.bias)
    pull = it.M @ (it.w_r * effort + solver.tau_multipliers) + solver.qdd_multipliers
    pull = pull + rows.R.T @ solver.rows_multipliers
    n, P = solver.n, spanned(it)
    reached = np.zeros(n)
    for i, (J, b) in enumerate(zip(it.jacobians, it.targets, strict=True)):
        own = P[:, i * n : i * n + n]
        x = np.linalg.solve(J.T @ J + it.w_r * np.eye(n), J.T @ b - own.T @ pull)
        reached += own @ x
    assert np.abs(reached - solver.qdd).max() < 1e-7 * (1 + np.abs(solver.qdd).max())
    held = solver.rows_multipliers != 0
    value = rows.R @ solver.qdd
    side = np.where(solver.rows_multipliers > 0, rows.upper, rows.lower)
    off = np.abs(value - side)[held]
    assert (off <= 1e-8 * (rows.lengths + np.abs(side))[held]).all()
    given = [*solver.qdd_multipliers, *solver.tau_multipliers, *solver.rows_multipliers]
    assert np.count_nonzero(given) <= solver.active


@given(SEEDS)
def test_units_of_rows_do_not_matter(seed):
    it, rows = with_rows(seed)
    units = np.random.default_rng(seed).choice([1e-150, 1e-3, 4.0, 1e120], size=len(rows.lower))
    other = Rows(units[:, None] * rows.R, units * rows.lower, units * rows.upper)
    (one, said), (two, also) = solver_for(it, rows), solver_for(it, other)
    assert said == also
    np.testing.assert_allclose(one.qdd, two.qdd, rtol=1e-7, atol=1e-7)
    np.testing.assert_allclose(
        one.rows_multipliers,
        units * two.rows_multipliers,
        rtol=1e-5,
        atol=1e-5 / rows.lengths.min(),
    )


def test_rows_that_are_off_or_hold_nothing_change_no_bit():
    for seed in range(60):
        it, rows = with_rows(seed)
        without, said = solver_for(it, Rows(rows.R[:0], rows.lower[:0], rows.upper[:0]))
        off = np.full(len(rows.lower), INF)
        solver, status = solver_for(it, Rows(rows.R, -off, off))
        assert status == said
        np.testing.assert_array_equal(solver.qdd, without.qdd)
        np.testing.assert_array_equal(solver.tau_multipliers, without.tau_multipliers)
        assert solver.steps == without.steps


def test_a_row_of_one_joint_is_a_bound():
    for seed in range(60):
        it, _ = with_rows(seed)
        n = it.bias.size
        expected, said = solver_for(it, Rows(np.zeros((0, n)), np.zeros(0), np.zeros(0)))
        rows = Rows(3 * np.eye(n), 3 * it.bounds[0], 3 * it.bounds[1])
        it.bounds = (-INF * np.ones(n), INF * np.ones(n), *it.bounds[2:])
        solver, status = solver_for(it, rows)
        assert status == said
        np.testing.assert_allclose(solver.qdd, expected.qdd, rtol=0, atol=1e-8)
        np.testing.assert_allclose(
            3 * solver.rows_multipliers, expected.qdd_multipliers, rtol=1e-6, atol=1e-7
        )


class TestWithoutFreedom:
    """Strict priorities leave S singular: what the tasks do not span, no row can ask for."""

    n = 5

    def solve(self, R, lower, upper, regularise="none"):
        rng = np.random.default_rng(3)
        J = rng.normal(size=(2, self.n))
        solver = Ghc([2, 2], self.n, regularise=regularise, rows=len(lower))
        solver.rows[:], solver.rows_lower[:], solver.rows_upper[:] = R, lower, upper
        alpha = np.array([[0.0, 0], [1, 1]])  # the second, the same rows, is kept out of all
        alpha[0, 0] = 1.0  # and so the first out of its own: nothing moves along J
        stack = np.vstack([J, J])
        status = solver.solve(stack, np.ones(4), alpha, np.eye(self.n), np.zeros(self.n), 1e-2)
        return J, solver, status

    @pytest.mark.parametrize("regularise", ["none", "torque", "gravity_compensated"])
    def test_a_row_of_what_nothing_spans(self, regularise):
        J, solver, status = self.solve(np.zeros((0, self.n)), [], [])
        assert status == codes.OK
        for lower, upper in ((0.5, 0.5), (0.5, INF), (-INF, -0.1)):
            _, solver, status = self.solve(J[:1], [lower], [upper], regularise)
            assert status == codes.INFEASIBLE
            assert not solver.qdd.any()
        for lower, upper in ((0.0, 0.0), (-0.1, 0.1), (-INF, 0.0)):
            _, solver, status = self.solve(J[1:], [lower], [upper], regularise)
            assert status == codes.OK
            assert abs(J[1] @ solver.qdd) < 1e-9

    def test_equations_that_contradict_or_follow_from_each_other(self):
        R = np.array([[0.0, 0, 1, 0, 0], [0, 0, 0, 1, 0], [0, 0, 2, 1, 0]])
        _J, solver, status = self.solve(R, [1, 2, 4], [1, 2, 4])
        assert status == codes.OK
        assert solver.active == 2
        np.testing.assert_allclose(R @ solver.qdd, [1, 2, 4], atol=1e-12)
        assert self.solve(R, [1, 2, 4.001], [1, 2, 4.001])[2] == codes.INFEASIBLE
        assert self.solve(R, [1, 2, 4.001], [1, 2, INF])[2] == codes.INFEASIBLE

    def test_a_row_of_zeros(self):
        R = np.zeros((1, self.n))
        assert self.solve(R, [-1], [1])[2] == codes.OK
        assert self.solve(R, [0], [0])[2] == codes.OK
        assert self.solve(R, [0.1], [1])[2] == codes.INFEASIBLE
        assert self.solve(R, [0.1], [0.1])[2] == codes.INFEASIBLE

    def test_a_lower_one_above_the_upper_one(self):
        assert self.solve(np.eye(5)[:1], [1.0], [0.0])[2] == codes.INFEASIBLE

    def test_what_is_not_a_number(self):
        assert self.solve(np.full((1, 5), np.nan), [1.0], [2.0])[2] == codes.BAD_INPUT
        assert self.solve(np.eye(5)[:1], [np.nan], [2.0])[2] == codes.BAD_INPUT
        assert self.solve(np.eye(5)[:1], [INF], [INF])[2] == codes.BAD_INPUT


def nearest(H, f, G, h, equations):
    """By quadprog; None where it finds nothing."""
    try:
        some = (G.T, h, equations) if len(h) else ()
        return quadprog.solve_qp(H, f, *some)[0]
    except ValueError:
        return None


def far_apart(it, rows) -> bool:
    """Whether bounds and rows contradict each other by more than rounding, for any q̈."""
    G, h, equations = limits(it, rows)
    G, h = np.vstack([G, -G[:equations]]), np.concatenate([h, -h[:equations]])
    H = np.diag([*np.full(it.bias.size, 1e-9), 1.0])
    x = quadprog.solve_qp(H, np.zeros(len(H)), np.column_stack([G, np.ones(len(h))]).T, h)[0]
    return bool(x[-1] > 1e-9)


def weights_agree(seed: int) -> str:
    it, rows = with_rows(seed)
    omega = np.random.default_rng(seed).uniform(0.1, 10, size=len(it.targets))
    options = it.options | rows.options
    try:
        qdd, tau = weighted(it.jacobians, it.targets, omega, it.M, it.bias, it.w_r, **options)
    except InfeasibleError:
        assert far_apart(it, rows), seed
        return "infeasible"
    H, f = it.w_r * np.eye(it.bias.size), np.zeros(it.bias.size)
    for weight, J, b in zip(omega, it.jacobians, it.targets, strict=True):
        H, f = H + weight * J.T @ J, f + weight * J.T @ b
    if it.regularise != "none":
        H, f = H + it.w_r * it.M @ it.M, f - it.w_r * it.M @ it.bias * (it.regularise == "torque")
    right = nearest(H, f, *limits(it, rows))
    assert rows.missed(qdd).max() < 1e-8, seed
    np.testing.assert_allclose(tau, it.M @ qdd + it.bias)
    if right is None:
        return "none"
    assert np.abs(qdd - right).max() <= 1e-6 * (1 + np.abs(right).max()), seed
    return "same"


def test_weights_equal_quadprog():
    came = [weights_agree(seed) for seed in range(300)]
    assert came.count("same") > 100
    assert came.count("infeasible") > 30
    assert came.count("none") < 10


def small(seed: int):
    """Two or three tasks, bounds, a row or two and perhaps an equation, feasible in every case."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(3, 6))
    J = [rng.normal(size=(int(rng.integers(1, 3)), n)) for _ in range(int(rng.integers(2, 4)))]
    b = [3 * rng.normal(size=len(each)) for each in J]
    s = int(rng.integers(1, 4))
    R, inside = rng.normal(size=(s, n)), 0.3 * rng.normal(size=n)
    lower, upper = R @ inside - rng.random(s), R @ inside + rng.random(s)
    if s > 1 and n > 3 and rng.random() < 0.4:
        lower[0] = upper[0] = R[0] @ inside
    reach = 0.4 + rng.random(n) + np.abs(inside)
    return J, b, Rows(R, lower, upper), reach


def best_level(J, b, above, G, h, equations, w):
    """Min |J x − b|² + w|x|² over all active sets of G x ≥ h, A x = a of the levels above.

    Brute force: for each subset of rows as equations the KKT system is solved; the best feasible
    answer is the optimum, since the problem is convex.
    """
    n = J.shape[1]
    A, a = above
    H, f = J.T @ J + w * np.eye(n), J.T @ b
    best, found = np.inf, None
    base, right = np.vstack([A, G[:equations]]), np.concatenate([a, h[:equations]])
    _, s, Vt = np.linalg.svd(np.vstack([base, np.zeros((1, n))]))
    rank = int((s > 1e-9).sum())
    N, x0 = Vt[rank:].T, np.linalg.lstsq(base, right, rcond=1e-9)[0] if len(base) else np.zeros(n)
    free, rest, edge = N.shape[1], G[equations:], h[equations:] - G[equations:] @ x0
    Hz, fz, Gz = N.T @ H @ N, N.T @ (f - H @ x0), rest @ N
    for size in range(min(free, len(rest)) + 1):
        for active in itertools.combinations(range(len(rest)), size):
            on = list(active)
            K = np.block([[Hz, -Gz[on].T], [Gz[on], np.zeros((size, size))]])
            try:
                z = np.linalg.solve(K, np.concatenate([fz, edge[on]]))[:free]
            except np.linalg.LinAlgError:
                continue
            cost = 0.5 * z @ Hz @ z - fz @ z
            if (Gz @ z >= edge - 1e-9).all() and cost < best:
                best, found = cost, x0 + N @ z
        if found is not None and size == 0:
            break  # the free optimum is feasible: nothing is better
    return found


def lexicographic(J, b, rows, reach, w, slack=1e-8):
    """J_i q̈ of each level, the best that the levels above, the bounds and the rows leave.

    As in `hqp`, bounds give way by the slack from level to level, since they are met exactly.
    """
    n, equal = J[0].shape[1], rows.lower == rows.upper
    one = np.eye(n)
    G = np.vstack([rows.R[equal], rows.R[~equal], -rows.R[~equal], one, -one])
    h = np.concatenate([rows.lower[equal], rows.lower[~equal], -rows.upper[~equal], -reach, -reach])
    A, a, reached = np.zeros((0, n)), np.zeros(0), []
    for each, wanted in zip(J, b, strict=True):
        x = best_level(each, wanted, (A, a), G, h, int(equal.sum()), w)
        if x is None:
            return None
        A, a = np.vstack([A, each]), np.concatenate([a, each @ x])
        reached.append(each @ x)
        h = h - slack * (np.arange(len(h)) >= equal.sum())
    return reached


def lexicographic_problems(seeds):
    """Strict priorities of `hqp`, level by level, and of the top level of `ghc`; how many had rows
    that hold something back.

    `hqp` is compared in what its levels reach, J_i q̈, which is unique where q̈ is not, with ω_r =
    1e-8 on both sides. Below the top `ghc` is no lexicographic optimum in one tick, rows or not
    (its x_i do not see each other): there the top level is compared, without a regularisation of
    torques. The limit ω_r → 0 shows in two values of it: what the top level misses at 1e-4 falls
    at least fiftyfold at 1e-6, unless it is 1e-6 already.
    """
    held = 0
    for seed in seeds:
        J, b, rows, reach = small(seed)
        n, k = J[0].shape[1], len(J)
        sides = {"qdd_lower": -reach, "qdd_upper": reach} | rows.options
        right = lexicographic(J, b, rows, reach, 1e-8)
        if right is None:
            continue
        qdd, _ = hqp(J, b, np.eye(n), np.zeros(n), 1e-8, **sides)
        assert rows.missed(qdd).max() < 1e-7, seed
        off = [np.abs(each @ qdd - best).max() for each, best in zip(J, right, strict=True)]
        if max(off) > 1e-5:  # levels that are nearly in conflict: as much as three slacks do
            other = lexicographic(J, b, rows, reach, 1e-8, 3e-8)
            moves = [np.abs(x - y).max() for x, y in zip(right, other, strict=True)]
            assert max(off) < 1e-5 + 2 * max(moves), (seed, off, moves)
        tasks, wanted = [*J, np.eye(n)], [*b, np.zeros(n)]
        alpha = np.tril(np.ones((k + 1, k + 1)), -1)
        missed = []
        for w in (1e-4, 1e-6):
            found, _ = ghc(
                tasks, wanted, alpha, np.eye(n), np.zeros(n), w, regularise="none", **sides
            )
            missed.append(np.abs(J[0] @ found - right[0]).max())
            assert rows.missed(found).max() < 1e-8, seed
        assert missed[1] < max(missed[0] / 50, 1e-6), (seed, missed)
        alone, _ = hqp(J, b, np.eye(n), np.zeros(n), 1e-8, qdd_lower=-reach, qdd_upper=reach)
        held += rows.missed(alone).max() > 1e-6
    return held


@pytest.mark.slow
@pytest.mark.parametrize(
    ("seeds", "least"),
    [
        (range(40), 20),
        pytest.param(range(1000, 1100), 80, marks=pytest.mark.slow),
        pytest.param(range(1100, 1600), 415, marks=pytest.mark.long),
    ],
)
def test_strict_levels_are_lexicographic_with_rows(seeds, least):
    assert lexicographic_problems(seeds) > least


@given(SEEDS)
def test_the_cascade_keeps_rows_and_calls_only_what_is_infeasible_so(seed):
    it, rows = with_rows(seed)
    named = ("qdd_lower", "qdd_upper", "tau_lower", "tau_upper")
    options = {name: it.options[name] for name in named} | rows.options
    try:
        qdd, tau = hqp(it.jacobians, it.targets, it.M, it.bias, it.w_r, **options)
    except InfeasibleError:
        assert far_apart(it, rows)
        return
    equal = rows.lower == rows.upper
    assert rows.missed(qdd).max() < 1e-6
    if equal.any():
        assert rows.missed(qdd)[equal].max() < 1e-10
    np.testing.assert_allclose(tau, it.M @ qdd + it.bias)


@pytest.mark.parametrize("solver", [ghc, hqp, weighted])
class TestErrors:
    """What is wrong with rows is named."""

    def call(self, solver, **rows):
        middle = {ghc: [[[0]]], hqp: [], weighted: [[1.0]]}[solver]
        return solver([np.eye(2)], [[1.0, 1]], *middle, np.eye(2), np.zeros(2), 1e-3, **rows)

    def test_they_hold(self, solver):
        qdd, tau = self.call(solver, rows=[[1, 1]], rows_upper=[0.5])
        np.testing.assert_allclose(qdd, [0.25, 0.25], atol=1e-3)
        assert qdd.sum() <= 0.5 + 1e-9
        np.testing.assert_allclose(tau, qdd)
        qdd, _ = self.call(solver, rows=[[2, 0], [0, 1]], rows_lower=[3, 1], rows_upper=[3, 1])
        np.testing.assert_allclose(qdd, [1.5, 1], rtol=0, atol=1e-14)

    @pytest.mark.parametrize(
        "rows",
        [
            {"rows": [[1, np.inf]]},
            {"rows": [[1, 1]], "rows_lower": [INF]},
            {"rows": [[1, 1]], "rows_upper": [np.nan]},
        ],
    )
    def test_bad_input(self, solver, rows):
        with pytest.raises(SolverError):
            self.call(solver, **rows)

    def test_infeasible(self, solver):
        with pytest.raises(InfeasibleError):
            self.call(solver, rows=[[1, 1]], rows_lower=[1], rows_upper=[0])
        for lower, upper in (([1, -INF], [INF, 0.5]), ([1, 0.5], [1, 0.5])):
            with pytest.raises(InfeasibleError):
                self.call(solver, rows=[[1, 1], [1, 1]], rows_lower=lower, rows_upper=upper)
        with pytest.raises(InfeasibleError):
            self.call(
                solver, rows=np.eye(2), rows_lower=[1, 1], rows_upper=[1, 1], qdd_upper=[2, 0]
            )


def test_a_negative_number_of_rows_is_refused():
    with pytest.raises(BadProblemError, match="rows"):
        Ghc([2], 2, rows=-1)
