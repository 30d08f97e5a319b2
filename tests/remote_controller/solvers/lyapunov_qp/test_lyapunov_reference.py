"""Problem (3), V, ρ, Ψ and least ℓp norms against their plain references."""

from __future__ import annotations

import math
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from stable_problems import generic
from support.oracles import lyapunov_qp_oracle as oracle
from support.oracles import qp12_oracle as qp12_reference
from support.solvers.one_shot import descent_rate, lp_norm

from hoap3.remote_controller.controllers.qp12 import osqp_kernels
from hoap3.remote_controller.controllers.qp12.lyapunov_descent_kernels import (
    pinv_descent,
    qp12_descent,
)
from hoap3.remote_controller.solvers.base import status
from hoap3.remote_controller.solvers.lyapunov_qp import reference
from hoap3.remote_controller.solvers.lyapunov_qp.descent_rate import FORMS
from hoap3.remote_controller.solvers.lyapunov_qp.max_descent_lp import MaxDescentLp
from hoap3.remote_controller.solvers.lyapunov_qp.stable_qp import StableQp
from hoap3.remote_controller.solvers.qp12.pinv_kernels import work_shape
from hoap3.remote_controller.tasks.lyapunov_kernels import quadratic

LARGE = [60, pytest.param(3000, marks=pytest.mark.slow)]
SMALL = [100, pytest.param(2500, marks=pytest.mark.slow)]
MANY = [300, pytest.param(5000, marks=pytest.mark.slow)]
GAMMAS = (0.0, 0.1, 0.5, 0.9, 0.99)
NONE = np.zeros((0, 3)), np.zeros(0)  # rows of C
INSIDE = 1e-9  # of the largest fall: so far below it `StableQp` stays, as there is but a point


@pytest.mark.parametrize("count", LARGE)
def test_the_answer_with_the_whole_rate(count):
    """21 joints, 5 rows, ρ = 1: u to 1e-10 of the largest bound, which is 1."""
    solvers = {gamma: StableQp(21, 5, gamma=gamma) for gamma in GAMMAS}
    for it in generic(11, count):
        solver = solvers[it.gamma]
        assert solver.solve(*it.arguments) == status.OK
        sides = it.A, it.b, it.lower, it.upper
        rate = -solver.rho * it.psi
        expected = oracle.stable_qp(it.gradient, rate, it.gamma, *sides)
        np.testing.assert_allclose(solver.u, expected, rtol=0, atol=1e-10)


@pytest.mark.parametrize("count", SMALL)
def test_the_largest_rate_and_the_answer_with_it(count):
    """3 joints, 3 rows: ρ* by all vertices, to 1e-10; the answer for the ρ that is `INSIDE`.

    u is compared to 1e-8: what is left of the polyhedron there is `INSIDE`, over the angle between
    its sides, wide.
    """
    limited, steepest = 0, MaxDescentLp(3, 3, 0)
    solvers = {gamma: StableQp(3, 3, gamma=gamma) for gamma in GAMMAS}
    for place, given in enumerate(generic(12, count, n=3, m=3)):
        drift = 0.1 * given.psi * (place % 3 - 1)
        it = replace(given, psi=given.psi * (1.0 + place % 4), drift=drift)
        solver, sides = solvers[it.gamma], (it.A, it.b, it.lower, it.upper)
        best = oracle.largest_rho(*it.arguments)
        steepest.fill(it.gradient, it.A, it.b, *NONE, it.lower, it.upper)
        found, fall = steepest.fall(1.0, (it.psi + it.drift) / steepest.top)
        assert found == status.OK
        rho = (fall * steepest.top - it.drift) / it.psi
        assert rho == pytest.approx(best, rel=1e-10, abs=1e-10)
        assert solver.solve(*it.arguments) == status.OK
        fall = best + it.drift / it.psi
        assert -1e-10 <= best - solver.rho <= (1.0 + 1e-3) * INSIDE * fall
        rate = -solver.rho * it.psi - it.drift
        expected = oracle.stable_qp(it.gradient, rate, it.gamma, *sides)
        np.testing.assert_allclose(solver.u, expected, rtol=0, atol=1e-10 if best == 1.0 else 1e-8)
        limited += best < 1.0
    assert limited > count // 6


@pytest.mark.parametrize("count", MANY)
def test_least_norms(count):
    """1e-10 of the largest speed where p ≥ 1.001: powers have the exponent 1/(p − 1)."""
    rng = np.random.default_rng(13)
    for _ in range(count):
        gradient = rng.normal(size=int(rng.integers(1, 22))) * 10.0 ** rng.uniform(-5, 5)
        decrease = float(rng.normal())
        p = float(rng.choice([1.001 + rng.exponential(), 2.0, 1.0 + 10 * rng.random(), math.inf]))
        p = max(p, 1.001)
        expected = oracle.lp_norm(gradient, decrease, p)
        found = lp_norm(gradient, decrease, p)
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-10 * np.abs(expected).max())


@pytest.mark.parametrize("count", MANY)
def test_rates(count):
    rng = np.random.default_rng(14)
    for place in range(count):
        form = FORMS[place % len(FORMS)]
        gradient = rng.normal(size=int(rng.integers(1, 22))) * 10.0 ** rng.uniform(-5, 5)
        V, error, u_max, beta, eta, kappa = rng.exponential(size=6)
        scales = (eta, kappa) if form in ("tanh", "exponential") else (u_max, beta)
        expected = reference.descent_rate(form, V, gradient, error, *scales)
        found = descent_rate(form, V, gradient, error, u_max, beta, eta, kappa)
        assert found == pytest.approx(expected, rel=1e-12)


def errors(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """e and J of a task."""
    m, n = int(rng.integers(1, 7)), int(rng.integers(6, 22))
    return rng.normal(size=m) * 10.0 ** rng.uniform(-6, 1), rng.normal(size=(m, n))


def near(found: np.ndarray, expected: np.ndarray, size: float) -> None:
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-10 * size)


@pytest.mark.parametrize("count", MANY)
def test_v_its_gradient_and_its_rate(count):
    """1e-10 of the sum of what is added up."""
    rng = np.random.default_rng(15)
    for _ in range(count):
        e, J = errors(rng)
        drift, weights = rng.normal(size=e.size), 10.0 ** rng.uniform(-4, 4, e.size)
        weighted, rows, gradient = np.empty(e.size), np.empty(J.shape), np.empty(J.shape[1])
        V, rate = quadratic(e, J, drift, np.sqrt(weights), weighted, rows, gradient)
        value, slope, change = oracle.lyapunov(e, J, drift, weights)
        near(V, value, value)
        near(rate, change, weights * np.abs(e) @ np.abs(drift))
        near(gradient, slope, (np.abs(J).T @ (weights * np.abs(e))).max())
        near(rows.T @ weighted, slope, (np.abs(J).T @ (weights * np.abs(e))).max())


@pytest.mark.parametrize("count", [300, pytest.param(5000, marks=pytest.mark.slow)])
def test_a_cycle_of_qp12_is_39_then_16_then_26(count):
    """u of the kernel's own gradient in fractions, to 1e-10 of the largest speed."""
    rng = np.random.default_rng(16)
    for place in range(count):
        e, J = errors(rng)
        n, (u_max, beta, far) = J.shape[1], rng.exponential(size=3)
        far, bend = far / (1.0 + far), (0.0, 100.0, 1e6)[place // 3 % 3]
        (gradient, u), certificate = np.empty((2, n)), np.empty(6)
        qp12_descent(e, J, u_max, beta, place % 3, far, bend, gradient, u, certificate)
        V, slope, _ = oracle.lyapunov(e, J, 0.0 * e, np.ones(e.size))
        near(gradient, slope, np.abs(J).T.max() * np.abs(e).sum())
        error = float(np.linalg.norm(e))
        psi = reference.descent_rate(FORMS[place % 3], V, gradient, error, u_max, beta)
        gamma = reference.adapted_gamma(gradient, far, bend) if bend else far
        fractions = [Fraction(slope) for slope in gradient]
        exact = qp12_reference.qp12(fractions, Fraction(psi), Fraction(gamma))
        expected = np.array([float(x) for x in exact])
        near(u, expected, np.abs(expected).max())
        figures = [V, -psi, -psi, 1.0, u_max - np.abs(expected).max()]
        near(certificate[:5], np.array(figures), max(figures[0], psi, u_max, np.abs(u).max()))
        told = np.zeros(6)
        problem = e, J, u_max, beta, place % 3, far, bend
        decrease, chosen = osqp_kernels.osqp_problem(*problem, gradient, told)
        near(np.array([decrease, chosen]), np.array([psi, gamma]), max(psi, 1.0))
        osqp_kernels.osqp_certificate(gradient, decrease, chosen, u_max, u, told)
        np.testing.assert_array_equal(told, certificate)


@pytest.mark.parametrize("count", [300, pytest.param(5000, marks=pytest.mark.slow)])
def test_a_cycle_of_the_pseudo_inverse(count):
    """1e-10 of the largest speed, times κ(J) where that is above 100."""
    rng = np.random.default_rng(17)
    for place in range(count):
        e, J = errors(rng)
        n, (u_max, beta, gain) = J.shape[1], rng.exponential(size=3)
        gain *= place % 2
        (gradient, u), certificate = np.empty((2, n)), np.empty(6)
        work = np.empty(work_shape(*J.shape))
        pinv_descent(e, J, u_max, beta, 0, gain, work, gradient, u, certificate)
        V, slope, _ = oracle.lyapunov(e, J, 0.0 * e, np.ones(e.size))
        error = float(np.linalg.norm(e))
        psi = reference.descent_rate(FORMS[0], V, slope, error, u_max, beta)
        expected = qp12_reference.pinv_plain(J, e, gain) if gain else qp12_reference.pinv(J, e, psi)
        near(u, expected, np.abs(expected).max() * max(1.0, np.linalg.cond(J) / 100.0))
