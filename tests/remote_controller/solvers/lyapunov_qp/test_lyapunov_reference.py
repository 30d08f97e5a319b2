"""Problem (3), ρ, Ψ and least ℓp norms against their plain references."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from stable_problems import generic

from hoap3.remote_controller.solvers import lp_norm
from hoap3.remote_controller.solvers.base import status
from hoap3.remote_controller.solvers.lyapunov_qp import reference
from hoap3.remote_controller.solvers.lyapunov_qp.descent_rate import FORMS, DescentRate
from hoap3.remote_controller.solvers.lyapunov_qp.stable_qp import StableQp

LARGE = [60, pytest.param(3000, marks=pytest.mark.slow)]
SMALL = [100, pytest.param(2500, marks=pytest.mark.slow)]
MANY = [300, pytest.param(5000, marks=pytest.mark.slow)]
GAMMAS = (0.0, 0.1, 0.5, 0.9, 0.99)
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
        expected = reference.stable_qp(it.gradient, rate, it.gamma, *sides)
        np.testing.assert_allclose(solver.u, expected, rtol=0, atol=1e-10)


@pytest.mark.parametrize("count", SMALL)
def test_the_largest_rate_and_the_answer_with_it(count):
    """3 joints, 3 rows: ρ* by all vertices, to 1e-10; the answer for the ρ that is `INSIDE`.

    u is compared to 1e-8: what is left of the polyhedron there is `INSIDE`, over the angle between
    its sides, wide.
    """
    limited = 0
    solvers = {gamma: StableQp(3, 3, gamma=gamma) for gamma in GAMMAS}
    for place, given in enumerate(generic(12, count, n=3, m=3)):
        drift = 0.1 * given.psi * (place % 3 - 1)
        it = replace(given, psi=given.psi * (1.0 + place % 4), drift=drift)
        solver, sides = solvers[it.gamma], (it.A, it.b, it.lower, it.upper)
        best = reference.largest_rho(*it.arguments)
        found, rho = solver.rho_star(*it.arguments)
        assert found == status.OK
        assert rho == pytest.approx(best, rel=1e-10, abs=1e-10)
        assert solver.solve(*it.arguments) == status.OK
        fall = best + it.drift / it.psi
        assert -1e-10 <= best - solver.rho <= (1.0 + 1e-3) * INSIDE * fall
        rate = -solver.rho * it.psi - it.drift
        expected = reference.stable_qp(it.gradient, rate, it.gamma, *sides)
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
        expected = reference.lp_norm(gradient, decrease, p)
        found = lp_norm(gradient, decrease, p)
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-10 * np.abs(expected).max())


@pytest.mark.parametrize("count", MANY)
def test_rates(count):
    rng = np.random.default_rng(14)
    for place in range(count):
        form = FORMS[place % len(FORMS)]
        gradient = rng.normal(size=int(rng.integers(1, 22))) * 10.0 ** rng.uniform(-5, 5)
        V, error, u_max, beta, eta, kappa = rng.exponential(size=6)
        rate = DescentRate(form, u_max, beta, eta, kappa)
        scales = (eta, kappa) if form in ("tanh", "exponential") else (u_max, beta)
        expected = reference.descent_rate(form, V, gradient, error, *scales)
        assert rate(V, gradient, error) == pytest.approx(expected, rel=1e-12)
