"""What a QP solver calls solved is looked at: an answer beyond its constraints is none."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from stable_problems import Problem, generic

from remote_controller.solvers import status
from remote_controller.solvers.stable_qp import QP, STILL, StableQp

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


@pytest.mark.parametrize("objective", ["qp12", 1, 2, np.inf])
def test_at_an_edge_v_falls_nearly_as_fast_as_it_can_and_nothing_is_broken(
    objective: str | float,
) -> None:
    rng = np.random.default_rng(3)
    solver = StableQp(N, ROWS, objective=objective)
    for _ in range(150):
        given = edge(rng)
        _, best = solver.rho_star(*given)
        assert solver.solve(*given) == status.OK
        assert solver.margin >= -BROKEN
        assert solver.rho >= (0.9 - 1e-6) * best


def test_what_stands_for_another_optimum_has_no_proof(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where no sparse answer is found, the even one keeps the largest share."""
    given, solver = edge(np.random.default_rng(3)), StableQp(N, ROWS, objective=1)
    _, best = solver.rho_star(*given)
    run = solver._program.run
    monkeypatch.setattr(solver._program, "run", lambda g, *it: g == 0.0 and run(g, *it))
    assert solver.solve(*given) == status.OK
    assert solver.rho >= (1.0 - 1e-4) * best
    assert solver.margin >= -BROKEN
    assert solver.kkt_residual == np.inf


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
    from remote_controller.solvers.proof_kernels import residual_kernel

    y, none = np.array([0.9, 0.1]), np.zeros(2)
    rows = np.array([[1.0, 0.0], [0.0, 1.0]])
    least, most = np.full(4, -0.6), np.array([0.6, 0.6, 2.0, 2.0])
    multipliers = np.array([0.0, 1e12])
    residual, broken = residual_kernel(
        y, none, multipliers, rows, least, most, 1, 0.1, 0, 0.0, True, np.zeros(2)
    )
    assert broken == pytest.approx(0.3, abs=1e-8)
    assert residual >= 0.3 / 0.9
