"""The QP of task-space inverse dynamics against another solver, and its fallback."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
import quadprog
from hypothesis import example, given
from hypothesis import strategies as st

from hoap3.remote_controller.solvers.base import status
from hoap3.remote_controller.solvers.tsid.tsid import VIOLATION, Tsid

SEEDS = st.integers(0, 2**32 - 1)


@dataclass
class Problem:
    J: np.ndarray
    y: np.ndarray
    w: float
    p: np.ndarray
    M: np.ndarray
    h: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    effort: np.ndarray

    def solve(self) -> tuple[int, Tsid]:
        solver = Tsid(self.effort, np.ones(len(self.p)))
        arrays = (self.J, self.y, self.w, self.p, self.M, self.h, self.lower, self.upper)
        return solver.solve(*arrays), solver


def problem(seed: int, n: int = 7, strength: float = 3.0) -> Problem:
    """Of any scale; some bounds meet, and efforts around exp(`strength`) may be too small."""
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(n, n)) * np.exp(rng.normal(size=n))
    lower, upper = -np.exp(2 * rng.normal(size=n)), np.exp(2 * rng.normal(size=n))
    meet = rng.random(n) < 0.1
    lower[meet] = upper[meet]
    return Problem(
        J=rng.normal(size=(6, n)),
        y=10 * rng.normal(size=6),
        w=10 ** rng.uniform(-4, 0),
        p=10 * rng.normal(size=n),
        M=root @ root.T + 0.1 * np.eye(n),
        h=5 * rng.normal(size=n),
        lower=lower,
        upper=upper,
        effort=np.exp(rng.normal(size=n) + strength),
    )


def by_quadprog(it: Problem) -> np.ndarray | None:
    """The solution, by Goldfarb and Idnani; None where there is none."""
    n, meet = len(it.p), it.lower == it.upper
    one = np.eye(n)
    H, f = it.J.T @ it.J + it.w * one, it.J.T @ it.y + it.w * it.p
    rows = np.vstack([one[meet], one[~meet], -one[~meet], it.M, -it.M])
    least = [it.lower[meet], it.lower[~meet], -it.upper[~meet], -it.effort - it.h, it.h - it.effort]
    try:
        return quadprog.solve_qp(H, f, rows.T, np.concatenate(least), int(meet.sum()))[0]
    except ValueError:  # constraints are inconsistent
        return None


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
        assert solver.margin >= -1e-9


@given(SEEDS)
def test_its_residual_tells_a_wrong_answer(seed):
    it = problem(seed, strength=6.0)
    solver = Tsid(it.effort, np.ones(7))
    attempt, nudge = solver._attempt, np.random.default_rng(seed).normal(size=7)

    def wrong(tolerance: float):
        solved, x, multipliers = attempt(tolerance)
        return solved, x + 1e-3 * np.abs(x).max() * nudge, multipliers

    solver._attempt = wrong
    arrays = (it.J, it.y, it.w, it.p, it.M, it.h, it.lower, it.upper)
    right = by_quadprog(it)
    if solver.solve(*arrays) == status.OK:
        off = np.abs(solver.ddq - right).max() / np.abs(right).max()
        assert off <= 1e-8 or solver.kkt_residual > 1e-9


def exceeding(it: Problem, weight: float) -> np.ndarray:
    """The best ddq where efforts may be exceeded at that weight, by quadprog."""
    n, meet = len(it.p), it.lower == it.upper
    one, zero = np.eye(n), np.zeros((n, n))
    H, f = it.J.T @ it.J + it.w * one, it.J.T @ it.y + it.w * it.p
    S = np.diag(it.effort) / np.sqrt(weight * H.diagonal().max())
    rows = np.vstack(
        [
            np.hstack([one[meet], zero[meet]]),
            np.hstack([one[~meet], zero[~meet]]),
            np.hstack([-one[~meet], zero[~meet]]),
            np.hstack([it.M, S]),
            np.hstack([-it.M, S]),
        ]
    )
    least = [it.lower[meet], it.lower[~meet], -it.upper[~meet], -it.effort - it.h, it.h - it.effort]
    H, f = np.block([[H, zero], [zero, one]]), np.r_[f, np.zeros(n)]
    return quadprog.solve_qp(H, f, rows.T, np.concatenate(least), int(meet.sum()))[0][:n]


def cost(it: Problem, ddq: np.ndarray, weight: float) -> float:
    """Of the task and of exceeded efforts."""
    task = np.sum((it.y - it.J @ ddq) ** 2) + it.w * np.sum((it.p - ddq) ** 2)
    largest = (it.J.T @ it.J).diagonal().max() + it.w
    beyond = np.maximum(0.0, np.abs(it.M @ ddq + it.h) / it.effort - 1.0)
    return float(task + weight * largest * (beyond @ beyond))


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
        assert solver.torque_margin == pytest.approx(-beyond.max())
        costs = [(cost(it, solver.ddq, w), cost(it, exceeding(it, w), w)) for w in VIOLATION[:2]]
        assert min(mine / least for mine, least in costs) <= 1.0 + 1e-4
        assert solver.kkt_residual == np.inf


def test_a_solver_that_gives_up_leaves_the_posture_within_its_bounds():
    it = problem(1)
    solver = Tsid(it.effort, np.ones(7))
    solver._attempt = solver._insist = solver._soften = lambda tolerance: (
        False,
        np.full(7, np.nan),
        np.zeros(7),
    )
    arrays = (it.J, it.y, it.w, it.p, it.M, it.h, it.lower, it.upper)
    assert solver.solve(*arrays) == status.UNSOLVED
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
