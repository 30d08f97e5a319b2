"""Newton's method for the dual of (3), against a plain QP of p − m."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray

from hoap3.remote_controller.solvers.lyapunov_qp.dual_newton_kernels import dual_newton
from hoap3.remote_controller.solvers.lyapunov_qp.lyapunov_qp_kernels import NO_BOUND
from hoap3.remote_controller.solvers.qp.reference import solve_qp

Array = NDArray[np.float64]
COUNT = [300, pytest.param(2000, marks=pytest.mark.long)]
SIDES = ("free", "equation", "at least", "at most")


@dataclass
class Problem:
    """What `dual_newton` takes: rows of A, s and C."""

    rows: Array
    m: int
    least: Array
    most: Array
    low: float
    high: float
    price: float
    kappa: float

    @property
    def n(self) -> int:
        return self.rows.shape[1]

    def solve(self) -> tuple[bool, Array, Array]:
        """Whether there is an answer, y, and the multipliers."""
        count, n = self.rows.shape
        y, multipliers = np.full(n, np.nan), np.full(count, np.nan)
        work, small, U = np.zeros((6, 2 * n)), np.zeros((2, count)), np.zeros((count, count))
        limits = self.least, self.most, self.low, self.high
        costs = self.price, self.kappa
        solved = dual_newton(self.rows, self.m, *limits, *costs, work, small, U, y, multipliers)
        return solved, y, multipliers

    def expected(self) -> Array | None:
        """The optimal y = p − m, by the reference; None where no y keeps the limits."""
        n, pull = self.n, -self.price * self.rows[self.m]
        f = np.concatenate([pull - self.kappa, -pull - self.kappa])
        one = np.eye(2 * n)
        V = np.vstack([one, np.hstack([np.eye(n), -np.eye(n)]), np.hstack([self.rows, -self.rows])])
        least, most = self.least.copy(), self.most.copy()
        least[n + self.m], most[n + self.m] = self.low, self.high
        least = np.where(least <= -NO_BOUND, -np.inf, least)
        most = np.where(most >= NO_BOUND, np.inf, most)
        lower = np.concatenate([np.zeros(2 * n), least])
        upper = np.concatenate([np.full(2 * n, np.inf), most])
        x = solve_qp(one, f, V, lower, upper)
        return None if x is None else x[:n] - x[n:]

    def held_by_a_row(self, y: Array) -> bool:
        """Whether a row of A is active."""
        room = self.most[self.n : self.n + self.m] - self.rows[: self.m] @ y
        return bool((room <= 1e-9).any())


def random_problem(rng: np.random.Generator, side: str, n: int, m: int, k: int) -> Problem:
    """One that a known y solves, some joints of which are at rest, and some at a bound."""
    rows = rng.normal(size=(m + 1 + k, n)) * (rng.random((m + 1 + k, n)) < 0.8)
    rows[np.arange(m + 1 + k), rng.integers(0, n, m + 1 + k)] += 1.0
    rows /= np.linalg.norm(rows, axis=1)[:, None]
    rows[m] /= np.abs(rows[m]).max()
    upper, lower = rng.uniform(0.05, 1, n), -rng.uniform(0.05, 1, n)
    upper[rng.random(n) < 0.1] = NO_BOUND
    lower[rng.random(n) < 0.1] = -NO_BOUND
    inside = rng.uniform(np.maximum(lower, -1), np.minimum(upper, 1)) * (rng.random(n) < 0.5)
    given = rows @ inside
    least = np.concatenate([lower, np.full(m + 1, -NO_BOUND), given[m + 1 :]])
    most = np.concatenate([upper, given[:m] + rng.exponential(size=m), [NO_BOUND], given[m + 1 :]])
    low = given[m] if side in ("equation", "at least") else -NO_BOUND
    high = given[m] if side in ("equation", "at most") else NO_BOUND
    price = 0.0 if side == "equation" else float(rng.normal() * 3.0)
    kappa = float(rng.choice([0.0, 0.1, 1.0, 9.0]))
    return Problem(rows, m, least, most, low, high, price, kappa)


def check_proof(problem: Problem, y: Array, multipliers: Array) -> None:
    """y is the answer of each joint for the multipliers, which have the sign of their side."""
    m, n = problem.m, problem.n
    r = -problem.price * problem.rows[m] - problem.rows.T @ multipliers
    best = np.sign(r) * np.maximum(np.abs(r) - problem.kappa, 0.0)
    scale = 1.0 + np.abs(multipliers).max()
    np.testing.assert_allclose(
        y, np.clip(best, problem.least[:n], problem.most[:n]), rtol=0, atol=1e-12 * scale
    )
    np.testing.assert_allclose(problem.rows[m + 1 :] @ y, problem.most[n + m + 1 :], atol=1e-12)
    assert not multipliers[:m].any()
    given = problem.rows[m] @ y
    assert problem.low - 1e-12 <= given <= problem.high + 1e-12
    if problem.low < problem.high:
        assert multipliers[m] <= 0.0 or given >= problem.high - 1e-12
        assert multipliers[m] >= 0.0 or given <= problem.low + 1e-12


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("count", COUNT)
def test_it_is_the_optimum_where_no_row_holds_it_back(side, count):
    """To 1e-10 of the largest bound, which is 1.

    A hundredth may be left to another solver besides those that a row holds back: where fewer
    joints move than there are equations, or s·y has to be exactly 0.
    """
    rng = np.random.default_rng(SIDES.index(side))
    found, left, lost = 0, 0, 0
    for _ in range(count):
        n, k = int(rng.integers(4, 22)), int(rng.integers(0, 8))
        problem = random_problem(rng, side, n, int(rng.integers(0, 5)), min(k, n - 2))
        solved, y, multipliers = problem.solve()
        expected = problem.expected()
        if solved:
            found += 1
            check_proof(problem, y, multipliers)
        if expected is None:  # the reference went astray: there is an answer to each
            lost += 1
        elif solved:
            np.testing.assert_allclose(y, expected, rtol=0, atol=1e-10)
        elif not problem.held_by_a_row(expected):
            left += 1
    assert found > count // 4
    assert left <= 0.01 * count
    assert lost <= 0.001 * count


@pytest.mark.parametrize("count", COUNT)
def test_equations_that_say_the_same_twice_have_the_same_answer(count):
    """Also where all joints that move are fewer than the equations: multipliers are not unique."""
    rng = np.random.default_rng(7)
    found = 0
    for _ in range(count):
        n = int(rng.integers(6, 22))
        problem = random_problem(rng, "equation", n, 0, 4)
        problem.rows[3:5] = problem.rows[1:3]
        problem.least[n + 3 :] = problem.least[[n + 1, n + 2]].tolist()
        problem.most[n + 3 :] = problem.most[[n + 1, n + 2]].tolist()
        solved, y, multipliers = problem.solve()
        if solved:
            found += 1
            np.testing.assert_allclose(y, problem.expected(), rtol=0, atol=1e-9)
            check_proof(problem, y, multipliers)
    assert found > 0.9 * count


@pytest.mark.parametrize("count", COUNT)
def test_what_no_y_does_has_no_answer(count):
    rng = np.random.default_rng(8)
    for _ in range(count):
        n = int(rng.integers(4, 22))
        problem = random_problem(rng, "equation", n, 0, 2)
        span = np.minimum(np.maximum(problem.most[:n], -problem.least[:n]), 1.0)
        problem.least[:n], problem.most[:n] = -span, span
        beyond = 1.01 * float(np.abs(problem.rows[1]) @ span)
        problem.least[n + 1] = problem.most[n + 1] = beyond
        assert not problem.solve()[0]


def test_at_rest_is_an_answer():
    rng = np.random.default_rng(9)
    problem = random_problem(rng, "equation", 21, 0, 6)
    problem.least[21:] = problem.most[21:] = problem.low = problem.high = 0.0
    problem.most[21] = NO_BOUND
    solved, y, _ = problem.solve()
    assert solved
    assert not y.any()


@pytest.mark.parametrize("small", [1e-6, 1e-9, 1e-12])
def test_a_slow_fall_is_exact_beside_fast_joints(small):
    """s·y counts by itself, to 1e-10 of it, also where it is nothing beside other joints' speed."""
    rng = np.random.default_rng(10)
    found = 0
    for _ in range(200):
        problem = random_problem(rng, "equation", 21, 0, 3)
        problem.rows[0, 10:] = problem.rows[1:, :10] = 0.0
        reached = problem.rows[1:] @ (rng.uniform(-1, 1, 21) * np.minimum(1, problem.most[:21]))
        problem.least[22:] = problem.most[22:] = 0.3 * reached
        problem.low = problem.high = -small
        solved, y, _ = problem.solve()
        if solved:
            found += 1
            assert np.abs(y).max() > 1e-3
            assert problem.rows[0] @ y == pytest.approx(-small, rel=1e-10)
    assert found > 100


def test_the_answer_depends_on_the_problem_alone():
    """The same bits, whatever was in the work arrays before."""
    rng = np.random.default_rng(11)
    problem = random_problem(rng, "at least", 21, 3, 6)
    count, n = problem.rows.shape
    answers, shapes = [], ((6, 2 * n), (2, count), (count, count))
    for filled in (0.0, np.nan, 1e300):
        work, small, U = (np.full(shape, filled) for shape in shapes)
        y, multipliers = np.full(n, filled), np.full(count, filled)
        solved = dual_newton(
            problem.rows, problem.m, problem.least, problem.most, problem.low, problem.high,
            problem.price, problem.kappa, work, small, U, y, multipliers,
        )  # fmt: skip
        answers.append((solved, y.tobytes(), multipliers.tobytes()))
    assert answers[0] == answers[1] == answers[2]
