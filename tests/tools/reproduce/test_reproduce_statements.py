"""Section III of QP12: what it states without an experiment has rows that another run fails."""

from __future__ import annotations

import numpy as np
import pytest

from hoap3.tools.reproduce.papers.qp12 import experiments, oracle, statements
from hoap3.tools.reproduce.rows import CONFIRMED

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def rows():
    return statements.rows(seconds=1.0)


def test_every_statement_is_confirmed(rows):
    assert [row.item for row in rows if row.passed is not True] == []
    assert {row.kind for row in rows} == {CONFIRMED}
    words = ("(18)", "ZMP", "Pfaffian", "tanh", "Remark 1", "ρ kept")
    assert all(any(word in row.item for row in rows) for word in words)
    assert len(rows) == len({row.item for row in rows})


def test_another_rate_is_not_the_tanh(monkeypatch):
    monkeypatch.setattr(oracle, "tanh_rate", lambda q, eta, kappa: eta * kappa)
    assert statements.tanh(0.2)[0].passed is False


def test_a_falling_mass_has_its_zero_moment_point_below_it():
    ticks = np.arange(50)[:, None] * experiments.PERIOD_S
    still = np.tile([0.01, 0.02, 0.3], (50, 1))
    np.testing.assert_allclose(oracle.zero_moment_points(still), still[1:-1, :2], atol=1e-12)
    pushed = still + 0.5 * 2.0 * ticks**2 * np.array([1.0, 0.0, 0.0])
    expected = pushed[1:-1, 0] - 0.3 / 9.81 * 2.0
    np.testing.assert_allclose(oracle.zero_moment_points(pushed)[:, 0], expected, atol=1e-9)


def test_proposition_6_is_stationary_and_feasible():
    rng = np.random.default_rng(6)
    for gamma in (0.0, 0.1, 0.9, 0.99):
        gradient, b = rng.normal(size=21), 0.3
        u = oracle.proposition_6(gradient, b, gamma)
        assert gradient @ u == pytest.approx(-b)
        moving = u != 0.0
        slope = gamma * np.sign(u) + (1.0 - gamma) * u
        multiplier = slope[moving] / gradient[moving]
        np.testing.assert_allclose(multiplier, multiplier[0], rtol=1e-9)
        assert (np.abs(multiplier[0] * gradient[~moving]) <= gamma + 1e-12).all()
