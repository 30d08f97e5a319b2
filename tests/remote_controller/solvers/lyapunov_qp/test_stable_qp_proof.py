"""What a QP solver calls solved is looked at: an answer beyond its constraints is none."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from stable_problems import Problem, generic

from hoap3.remote_controller.solvers.base import status
from hoap3.remote_controller.solvers.lyapunov_qp.max_descent_lp import MaxDescentLp
from hoap3.remote_controller.solvers.lyapunov_qp.stable_qp import QP, STILL, StableQp

N, ROWS = 21, 4
BROKEN = 1e-8  # of a bound or row


def edge(rng: np.random.Generator) -> tuple[Any, ...]:
    """At the edge of a polygon that looks nearly down the gradient: V can hardly fall."""
    gradient = 0.01 * rng.normal(size=N)
    along, across = gradient / np.linalg.norm(gradient), rng.normal(size=N)
    across -= along * (along @ across)
    across /= np.linalg.norm(across)
    tilt = 10.0 ** rng.uniform(-4, -2)
    normal = -along + tilt * across
    A = 0.25 * np.array([normal, -normal, across, -across])
    b = np.array([10.0 ** rng.uniform(-6, -3), 0.6, 0.4, 0.6])
    psi = 10.0 ** rng.uniform(-4, -1)
    return gradient, psi, 0.0, A, b, np.full(N, -0.6), np.full(N, 0.6)


def needle(rng: np.random.Generator) -> tuple[Any, ...]:
    """Rows in and against the direction of the gradient, up to 1e-7 off it, that leave a little."""
    gradient = 10.0 ** rng.uniform(-4, 2) * rng.normal(size=N)
    along = gradient / np.linalg.norm(gradient)
    across = rng.normal(size=(ROWS, N))
    across -= np.outer(across @ along, along)
    across /= np.linalg.norm(across, axis=1)[:, None]
    tilts = 10.0 ** rng.uniform(-7, 0, ROWS)
    A = np.array([-along, -along, along, 0.0 * along]) + tilts[:, None] * across
    b = 10.0 ** rng.uniform(-7, -1, ROWS)
    psi = 10.0 ** rng.uniform(-6, 2)
    return gradient, psi, 0.0, A, b, -rng.uniform(0.1, 1, N), rng.uniform(0.1, 1, N)


@pytest.mark.parametrize("objective", ["qp12", 1, 2, np.inf])
@pytest.mark.parametrize("kind", [edge, needle])
def test_where_rows_are_nearly_parallel_to_the_gradient_v_falls_as_fast_as_it_can(
    kind: Any, objective: str | float
) -> None:
    rng = np.random.default_rng(3)
    solver = StableQp(N, ROWS, objective=objective)
    limited, steepest = 0, MaxDescentLp(N, ROWS, 0)
    for _ in range(150):
        problem = kind(rng)
        gradient, psi, _, A, b, lower, upper = problem
        steepest.fill(gradient, A, b, np.zeros((0, N)), np.zeros(0), lower, upper)
        best = min(1.0, steepest.fall(1.0, psi / steepest.top)[1] * steepest.top / psi)
        assert solver.solve(*problem) in (status.OK, status.STATIONARY)
        assert solver.margin >= -BROKEN
        if solver.status == status.OK:
            assert solver.rho >= (1.0 - 2e-5) * best
            assert solver.kkt_residual <= 1e-8
            limited += solver.rho < 1.0
    assert limited > 40


@given(st.integers(0, 2**32 - 1))
def test_a_row_says_the_same_without_what_it_has_along_an_equation(seed: int) -> None:
    """On s·x = r the slack of a turned row is λ times that of the row; both look the same way."""
    from hoap3.remote_controller.solvers.lyapunov_qp.row_projection_kernels import across_kernel

    rng = np.random.default_rng(seed)
    v, count, place = 7, 4, int(rng.integers(4))
    rows = rng.normal(size=(count + 1, v))
    least, most = np.full(v + count + 1, -1e30), rng.normal(size=v + count + 1)
    least[v + (place + 1) % count] = most[v + (place + 1) % count]
    turns, turned = np.zeros((count, 2)), np.zeros_like(rows)
    low, high = np.zeros_like(least), np.zeros_like(most)
    x = rng.normal(size=v)
    r = float(rows[place] @ x)
    across_kernel(place, r, rows, least, most, turns, turned, low, high)
    others = [j for j in range(count) if j != place]
    slack, of_turned = most[v:] - rows @ x, high[v:] - turned @ x
    np.testing.assert_allclose(of_turned[others], (turns[:, 0] * slack[:count])[others], atol=1e-9)
    assert np.all(turns[:, 0] >= 1.0)
    np.testing.assert_allclose(turned[others] @ rows[place], 0.0, atol=1e-9)
    np.testing.assert_allclose(
        np.linalg.norm(turned, axis=1), np.linalg.norm(rows, axis=1), rtol=1e-12
    )
    np.testing.assert_array_equal(turned[[place, count]], rows[[place, count]])
    np.testing.assert_array_equal(high[:v], most[:v])
    np.testing.assert_array_equal(low > -1e30, least > -1e30)
    multipliers = rng.normal(size=count)
    old = turns[:, 0] * multipliers
    old[place] -= turns[:, 1] @ old
    np.testing.assert_allclose(old @ rows[:count], multipliers @ turned[:count], atol=1e-9)


def test_a_row_along_the_equation_is_left_as_short_as_it_becomes() -> None:
    from hoap3.remote_controller.solvers.lyapunov_qp.row_projection_kernels import across_kernel

    rows, none = np.array([[1.0, 2.0], [3.0, 6.0]]), np.full(4, -1e30)
    turns, turned, low, high = np.zeros((2, 2)), np.zeros((2, 2)), np.zeros(4), np.zeros(4)
    most = np.array([1.0, 1.0, 0.5, 2.0])
    across_kernel(0, 0.5, rows, none, most, turns, turned, low, high)
    np.testing.assert_allclose(turned[1], 0.0, atol=1e-15)
    assert turns[1, 0] == 1.0
    assert high[3] == pytest.approx(0.5)


def test_what_the_lp_is_not_sure_of_lowers_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where it ends before the vertex the QP is asked first, whatever was solved before."""
    problem, solver = problem_of_the_qp().arguments, StableQp(N, 5)
    fall = solver._steepest.fall

    def short(*given: float) -> tuple[int, float]:
        found, best = fall(*given)
        solver._steepest.sure = False
        return found, 0.5 * best

    monkeypatch.setattr(solver._steepest, "fall", short)
    solver._limited = True
    assert solver.solve(*problem) == status.OK
    assert solver.rho == 1.0
    assert solver.kkt_residual <= 1e-8


@pytest.mark.parametrize("objective", ["qp12", 1, 2, np.inf])
def test_equations_nearly_parallel_to_the_gradient_are_kept(objective: str | float) -> None:
    rng = np.random.default_rng(7)
    solver = StableQp(N, 0, 1, objective=objective)
    none, nothing = np.zeros((0, N)), np.zeros(0)
    for _ in range(60):
        gradient, bound = rng.normal(size=N), np.full(N, 0.5)
        aside, inside = rng.normal(size=N), rng.uniform(-0.1, 0.1, N)
        C = (gradient + 10.0 ** rng.uniform(-7, -3) * aside)[None]
        c = C @ (inside - np.sign(gradient) * 0.2)
        psi = 10.0 * float(np.abs(gradient).sum())
        found = solver.solve(gradient, psi, 0.0, none, nothing, -bound, bound, C, c)
        assert found in (status.OK, status.STATIONARY)
        assert float(np.abs(C @ solver.u - c)[0]) <= 1e-9
        assert solver.kkt_residual <= 1e-8


def _spoilt(solver: StableQp, monkeypatch: pytest.MonkeyPatch, beyond: float) -> None:
    """Have the backend's answers exceed a bound, with multipliers that explain anything."""
    attempt = solver._program._attempt

    def spoilt(tolerance: float) -> tuple[bool, Any, Any]:
        solved, x, multipliers = attempt(tolerance)
        x = x.copy()
        x[0] += beyond
        return solved, x, 1e12 * (1.0 + multipliers)

    monkeypatch.setattr(solver._program, "_attempt", spoilt)


def problem_of_the_qp() -> Problem:
    """One whose first joint is far below its bound."""
    solver = StableQp(N, 5)
    for each in generic(seed=11, count=50):
        solver.solve(*each.arguments)
        if solver.path == QP and solver.status == status.OK:
            return each
    raise LookupError


def test_a_solver_that_calls_a_broken_bound_solved_is_not_believed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    problem, solver = problem_of_the_qp(), StableQp(N, 5)
    _spoilt(solver, monkeypatch, 1e3)
    solver.solve(*problem.arguments)
    assert (solver.status, solver.path) == (status.UNSOLVED, STILL)
    np.testing.assert_array_equal(solver.u, 0.0)


def test_a_broken_bound_is_in_the_residual_however_large_the_multipliers_are() -> None:
    from hoap3.remote_controller.solvers.lyapunov_qp.kkt_residual_kernels import residual_kernel

    y, none = np.array([0.9, 0.1]), np.zeros(2)
    rows = np.array([[1.0, 0.0], [0.0, 1.0]])
    least, most = np.full(4, -0.6), np.array([0.6, 0.6, 2.0, 2.0])
    multipliers = np.array([0.0, 1e12])
    residual, broken = residual_kernel(
        y, none, multipliers, rows, least, most, 1, 0.1, 0, 0.0, True, np.zeros(2)
    )
    assert broken == pytest.approx(0.3, abs=1e-8)
    assert residual >= 0.3 / 0.9
