"""The QP of task-space inverse dynamics against another solver, and its fallback."""

from __future__ import annotations

import numpy as np
from hypothesis import example, given
from hypothesis import strategies as st
from tsid_problems import by_quadprog, cost, exceeding, problem

from hoap3.remote_controller.solvers.base import status
from hoap3.remote_controller.solvers.tsid.tsid import VIOLATION

SEEDS = st.integers(0, 2**32 - 1)


@given(SEEDS, st.sampled_from([1, 3, 7, 12]))
def test_it_finds_what_another_solver_finds(seed, n):
    it = problem(seed, n)
    found, solver = it.solve()
    expected = by_quadprog(it)
    assert (found == status.OK) == (expected is not None)
    if expected is not None:
        scale = max(1.0, np.abs(expected).max())
        np.testing.assert_allclose(solver.ddq, expected, rtol=0, atol=1e-8 * scale)
        np.testing.assert_allclose(solver.tau, it.M @ solver.ddq + it.h, rtol=1e-12, atol=1e-9)
        assert solver.kkt_residual <= 1e-9
        assert (np.abs(solver.tau) <= (1.0 + 1e-9) * it.effort).all()
        assert ((it.lower <= solver.ddq) & (solver.ddq <= it.upper)).all()


@given(SEEDS)
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
@given(SEEDS)
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
