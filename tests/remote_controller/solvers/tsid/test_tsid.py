"""Inverse dynamics: the compiled rows and solver against numpy and other solvers."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from support.amounts import seed_ranges
from tsid_problems import by_quadprog, cost, exceeding, least_excess, problem, with_rows

from hoap3.remote_controller.solvers.base import status
from hoap3.remote_controller.solvers.tsid.tsid import VIOLATION, Tsid

SEEDS = seed_ranges(200, 1100, 6000)


def case(seed: int):
    """Of 1 to 12 joints, with efforts that are often too small, ample, or in between."""
    return with_rows(seed, [1, 3, 7, 12][seed % 4], [3.0, 0.5, 6.0][seed % 3])


def assert_kept(it, ddq: np.ndarray) -> None:
    """Bounds are kept exactly, rows but for rounding."""
    assert (ddq >= it.lower).all()
    assert (ddq <= it.upper).all()
    values, slack = it.R @ ddq, 1e-9 * (np.abs(it.R) @ (1.0 + np.abs(ddq)))
    assert (values >= it.least - slack).all()
    assert (values <= it.most + slack).all()


def assert_least_excess_of_torques(it, solver: Tsid) -> None:
    """As `VIOLATION` weighs it; one of the first two weights is met by all of these problems."""
    assert solver.kkt_residual == np.inf
    try:
        least = [cost(it, exceeding(it, weight), weight) for weight in VIOLATION[:2]]
    except ValueError:  # quadprog calls equations that depend on each other inconsistent
        return
    costs = [cost(it, solver.ddq, weight) for weight in VIOLATION[:2]]
    assert min(mine / best for mine, best in zip(costs, least, strict=True)) <= 1.0 + 1e-4


@pytest.mark.parametrize("seeds", SEEDS)
def test_it_finds_what_other_solvers_find(seeds):
    seen: Counter[int] = Counter()
    for seed in seeds:
        it = case(seed)
        found, solver = it.solve()
        expected = by_quadprog(it)
        seen[found] += 1
        if found == status.INFEASIBLE_CONSTRAINTS:
            assert least_excess(it, efforts=False) > 1e-9
            assert expected is None
            assert solver.kkt_residual == np.inf
            continue
        assert_kept(it, solver.ddq)
        if found == status.INFEASIBLE:
            assert least_excess(it, efforts=True) > 1e-9
            assert expected is None
            assert_least_excess_of_torques(it, solver)
            continue
        assert found == status.OK
        assert solver.kkt_residual <= 1e-9
        assert (np.abs(solver.tau) <= (1.0 + 1e-9) * it.effort).all()
        if expected is None:  # as above
            assert least_excess(it, efforts=True) <= 1e-9
            seen[-1] += 1
        else:
            size = max(1.0, np.abs(expected).max())
            np.testing.assert_allclose(solver.ddq, expected, rtol=0, atol=1e-6 * size)
    assert min(seen[status.OK], seen[status.INFEASIBLE], seen[7]) >= len(seeds) // 10
    assert seen[-1] <= len(seeds) // 100


def test_rows_that_are_off_change_nothing():
    it = problem(5)
    plain, rows = it.solver(), Tsid(it.effort, rows=4)
    assert plain.solve(*it.arrays) == rows.solve(*it.arrays) == status.OK
    np.testing.assert_array_equal(rows.ddq, plain.ddq)
    rows.rows[:] = np.random.default_rng(5).normal(size=(4, 7))
    assert rows.solve(*it.arrays) == status.OK
    np.testing.assert_allclose(rows.ddq, plain.ddq, rtol=1e-12)
    assert rows.kkt_residual <= 1e-12


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_the_residual_counts_a_row_that_is_violated_and_a_pull_that_no_row_has(side):
    it = problem(5, strength=9.0)
    it.lower, it.upper = np.full(7, -1e30), np.full(7, 1e30)
    it.R = np.random.default_rng(5).normal(size=(1, 7))
    it.least, it.most = np.array([-np.inf]), np.array([np.inf])
    _, free = it.solve()
    value = float(it.R[0] @ free.ddq)
    solver = it.solver()
    attempt = solver._attempt
    bound = solver.rows_upper if side > 0.0 else solver.rows_lower
    bound[0] = value - side  # one within what is wanted
    assert solver.solve(*it.arrays) == status.OK
    assert solver.kkt_residual <= 1e-12
    assert it.R[0] @ solver.ddq == pytest.approx(value - side)
    held = np.r_[solver.ddq], attempt(1e-11)[2]
    for spoilt in ((free.ddq, np.zeros(8)), (held[0], np.zeros(8)), (free.ddq, held[1])):
        residual = solver._prove(
            *(*spoilt, solver._program.H, solver._program.f, it.M, it.h, it.effort),
            *(it.lower, it.upper, solver.rows, solver.rows_lower, solver.rows_upper),
            *(True, np.zeros(7), np.zeros(7)),
        )
        assert residual > 1e-6


@pytest.mark.parametrize("crossed", [False, True])
def test_rows_that_contradict_leave_the_posture_within_its_bounds_and_say_so(crossed):
    it = problem(1)
    it.R = np.vstack([it.J[0], it.J[0]])
    it.least, it.most = np.array([1.0, -np.inf]), np.array([np.inf, 0.5])
    if crossed:
        it.R, it.least, it.most = it.J[:1], np.array([1.0]), np.array([0.5])
    found, solver = it.solve()
    assert found == status.INFEASIBLE_CONSTRAINTS
    np.testing.assert_array_equal(solver.ddq, np.clip(it.p, it.lower, it.upper))
    np.testing.assert_allclose(solver.tau, it.M @ solver.ddq + it.h, rtol=1e-12, atol=1e-12)


def test_an_answer_depends_on_nothing_solved_before():
    it, other = case(2), case(6)
    assert len(it.p) == len(other.p)
    fresh, used = it.solver(), Tsid(it.effort, rows=len(it.R))
    used.rows[:], used.rows_lower[:], used.rows_upper[:] = 1.0, -0.1, 0.1
    used.solve(*other.arrays)
    used.rows[:], used.rows_lower[:], used.rows_upper[:] = it.R, it.least, it.most
    assert used.solve(*it.arrays) == fresh.solve(*it.arrays)
    np.testing.assert_array_equal(used.ddq, fresh.ddq)
    assert used.kkt_residual == fresh.kkt_residual


SOLVER_SEEDS = st.integers(0, 2**32 - 1)


@given(SOLVER_SEEDS)
def test_its_residual_tells_a_wrong_answer(seed):
    it = problem(seed, strength=6.0)
    solver = it.solver()
    attempt, nudge = solver._attempt, np.random.default_rng(seed).normal(size=7)

    def wrong(tolerance: float):
        solved, x, multipliers = attempt(tolerance)
        return solved, x + 1e-3 * np.abs(x).max() * nudge, multipliers

    solver._attempt = wrong
    right = by_quadprog(it)
    if solver.solve(*it.arrays) == status.OK:
        off = np.abs(solver.ddq - right).max() / np.abs(right).max()
        assert off <= 1e-8 or solver.kkt_residual > 1e-9


@example(11200780)  # daqp takes a point for solved that exceeds an effort by a third more
@example(26089)  # daqp takes it for infeasible, unless less counts as singular
@given(SOLVER_SEEDS)
def test_where_efforts_are_too_small_the_bounds_are_kept_and_torques_cost_as_little_as_can_be(seed):
    it = problem(seed, strength=0.5)
    found, solver = it.solve()
    assert found in {status.OK, status.INFEASIBLE}
    assert (solver.ddq >= it.lower).all()
    assert (solver.ddq <= it.upper).all()
    if found == status.OK:
        expected = by_quadprog(it)
        size = max(1.0, np.abs(expected).max())
        np.testing.assert_allclose(solver.ddq, expected, rtol=0, atol=1e-8 * size)
    if found == status.INFEASIBLE:
        assert by_quadprog(it) is None
        beyond = np.maximum(0.0, np.abs(solver.tau) / it.effort - 1.0)
        assert beyond.max() > 0.0
        costs = [(cost(it, solver.ddq, w), cost(it, exceeding(it, w), w)) for w in VIOLATION[:2]]
        assert min(mine / least for mine, least in costs) <= 1.0 + 1e-4
        assert solver.kkt_residual == np.inf


def test_a_solver_that_gives_up_leaves_the_posture_within_its_bounds():
    it = problem(1)
    solver = it.solver()
    solver._attempt = solver._insist = lambda tolerance: (False, np.full(7, np.nan), np.zeros(7))
    solver._soften = [solver._attempt]
    assert solver.solve(*it.arrays) == status.UNSOLVED
    np.testing.assert_array_equal(solver.ddq, np.clip(it.p, it.lower, it.upper))


def test_without_bounds_and_limits_it_is_the_least_squares_solution():
    it = problem(4, strength=30.0)
    it.lower, it.upper = np.full(7, -1e30), np.full(7, 1e30)
    found, solver = it.solve()
    assert found == status.OK
    stacked = np.vstack([it.J, np.sqrt(it.w) * np.eye(7)])
    wanted = np.concatenate([it.y, np.sqrt(it.w) * it.p])
    expected = np.linalg.lstsq(stacked, wanted, rcond=None)[0]
    np.testing.assert_allclose(solver.ddq, expected, rtol=1e-9)
