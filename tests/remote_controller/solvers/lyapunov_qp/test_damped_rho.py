"""The damped share of Ψ: an optimum of (3) for its own ρ, at most the largest, and continuous."""

from __future__ import annotations

import math

import numpy as np
import pytest
from stable_problems import M, N, degenerate, generic

from hoap3.remote_controller.solvers.base import status
from hoap3.remote_controller.solvers.lyapunov_qp.functions import lyapunov_qp
from hoap3.remote_controller.solvers.lyapunov_qp.stable_qp import QP, StableQp

COUNT = 150


def solved(problem, ratio: float) -> StableQp:
    solver = StableQp(N, len(problem.b), gamma=problem.gamma, max_speed_ratio=ratio)
    solver.solve(*problem.arguments)
    return solver


@pytest.mark.parametrize("ratio", [0.5, 10.0])
@pytest.mark.slow
def test_it_is_the_optimum_for_the_fall_that_it_has(ratio):
    seen = 0
    for _, problem in degenerate(3, COUNT):
        damped = solved(problem, ratio)
        if damped.path != QP or damped.status != status.OK:
            continue
        seen += 1
        assert damped.kkt_residual <= 1e-8
        assert damped.margin >= -1e-9
        if not 1e-6 * problem.psi < -damped.rate:
            continue
        u = lyapunov_qp(
            problem.gradient,
            -damped.rate,
            problem.gamma,
            problem.A,
            problem.b,
            problem.lower,
            problem.upper,
        )
        np.testing.assert_allclose(damped.u, u, rtol=0, atol=1e-6)
    assert seen > COUNT / 3


def test_it_never_asks_for_more_than_the_largest_and_for_as_much_where_it_is_cheap():
    equal = 0
    for _, problem in degenerate(4, COUNT):
        damped, largest = solved(problem, 10.0), solved(problem, 0.0)
        assert damped.status in (status.OK, status.STATIONARY), status.NAMES[damped.status]
        assert -1e-12 <= damped.rho <= largest.rho + 1e-7
        equal += damped.rho >= largest.rho - 1e-7
    assert equal > COUNT / 4
    for problem in generic(5, 30):
        assert solved(problem, 1e6).rho == pytest.approx(1.0, abs=1e-7)


def test_more_speed_never_means_less_fall():
    for _, problem in degenerate(6, 60):
        shares = [solved(problem, ratio).rho for ratio in (0.1, 1.0, 10.0, 100.0)]
        assert (np.diff(shares) >= -1e-9).all()


def test_it_is_continuous_where_the_largest_jumps():
    """A row that turns from beside −∇V on to it: the last bit of ρ is worth no speed."""
    gradient, bounds = np.array([1.0, 0.0]), np.array([1.0, 1.0])

    def answer(tilt: float, ratio: float) -> np.ndarray:
        A = np.array([[-math.cos(tilt), math.sin(tilt)]])
        solver = StableQp(2, 1, gamma=0.0, max_speed_ratio=ratio)
        solver.solve(gradient, 0.5, 0.0, A, np.array([0.0]), -bounds, bounds)
        return solver.u.copy()

    tilts = np.linspace(-0.02, 0.02, 41)
    damped = np.array([answer(tilt, 10.0) for tilt in tilts])
    largest = np.array([answer(tilt, 0.0) for tilt in tilts])
    assert np.abs(np.diff(damped[:, 1])).max() < 0.01
    assert np.abs(np.diff(largest[:, 1])).max() > 0.9


@pytest.mark.parametrize("objective", [1, 2, math.inf])
def test_other_norms_are_proved_too(objective):
    for _, problem in degenerate(7, 60):
        solver = StableQp(N, M, objective=objective, max_speed_ratio=10.0)
        if solver.solve(*problem.arguments) == status.OK:
            assert solver.kkt_residual <= 1e-8
            assert solver.margin >= -1e-9
