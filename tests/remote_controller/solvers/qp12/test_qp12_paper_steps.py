"""The steps of the QP12 paper, equation by equation, on our own answers."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray

from hoap3.remote_controller.solvers import qp12
from hoap3.remote_controller.solvers.lyapunov_qp.reference import lp_norm

Array = NDArray[np.float64]
GAMMAS = [0.0, 0.1, 0.5, 0.9]
ROUNDING = 1 + 1e-12


def problems(seed: int = 7) -> list[tuple[Array, float]]:
    """Gradients, some with zeros and ties, and decreases ρΨ > 0."""
    rng = np.random.default_rng(seed)
    found = []
    for _ in range(60):
        gradient = rng.normal(size=int(rng.integers(1, 25)))
        gradient[rng.random(gradient.size) < 0.1] = 0.0
        gradient[0] = gradient[-1] if gradient[-1] else 1.0
        found.append((gradient, float(10.0 ** rng.uniform(-3, 2))))
    return found


def objective(u: Array, gamma: float) -> float:
    """Φ, (26)."""
    return float(gamma * np.abs(u).sum() + (1 - gamma) / 2 * (u @ u))


@pytest.mark.parametrize("p", [1.05, 1.5, 2.0, 4.0, 50.0])
def test_the_lp_answer_of_example_2_is_the_shortest(p):
    """(9), and the norms of (8) as its limit: any other x with a·x = b is longer."""
    rng = np.random.default_rng(3)
    for _ in range(20):
        a, b = rng.normal(size=6), 0.7
        x = lp_norm(a, -b, p)
        assert a @ x == pytest.approx(b)
        for _ in range(10):
            step = rng.normal(size=6) * 0.05
            other = x + step - a * (a @ step) / (a @ a)
            assert np.linalg.norm(x, p) <= np.linalg.norm(other, p) * ROUNDING


def test_the_lp_answer_of_example_2_is_qp12_at_both_ends():
    """(9): p = 2 is γ = 0, p → 1 is γ = 1, and p → ∞ moves all joints alike, which is (8)."""
    a, b = np.array([0.9, -0.5, 0.3, 0.1]), 0.2
    np.testing.assert_allclose(lp_norm(a, b, 2.0), qp12(a, b, 0.0), rtol=1e-14)
    np.testing.assert_allclose(lp_norm(a, b, 1.001), qp12(a, b, 1.0), atol=1e-12)
    even = np.abs(lp_norm(a, b, 1e9))
    np.testing.assert_allclose(even, b / np.abs(a).sum(), rtol=1e-6)
    assert np.linalg.norm(even, np.inf) == even.max()


@pytest.mark.parametrize("gamma", GAMMAS)
def test_the_steps_to_the_bound_on_the_speed(gamma):
    """(10) to (14); (10) holds because u* is optimal, not because Φ is nondecreasing."""
    for gradient, decrease in problems():
        n, norm = gradient.size, np.linalg.norm(gradient)
        u = qp12(gradient, decrease, gamma)
        feasible = -decrease / norm * gradient / norm  # (5)
        assert gradient @ feasible == pytest.approx(-decrease)
        speed = decrease / norm
        right_of_11 = (
            gamma * np.abs(gradient).sum() / norm**2 * decrease + (1 - gamma) / 2 * speed**2
        )
        assert right_of_11 == pytest.approx(objective(feasible, gamma))
        fastest = np.abs(u).max()
        left_of_12 = gamma * fastest + (1 - gamma) / 2 * fastest**2
        right_of_13 = gamma * np.sqrt(n) * speed + n * (1 - gamma) / 2 * speed**2
        chain = [left_of_12, objective(u, gamma), right_of_11, right_of_13]  # (12), (10), (13)
        assert all(x <= y * ROUNDING for x, y in pairwise(chain))
        F = [gamma * x + (1 - gamma) / 2 * x * x for x in (fastest, np.sqrt(n) * speed)]
        assert F[0] <= F[1] * ROUNDING  # (14)


@pytest.mark.parametrize("gamma", [*GAMMAS, 0.99, 1.0])
def test_the_bound_on_the_speed(gamma):
    """(15); √n too large where the gradient is even, and never too small."""
    for gradient, decrease in problems():
        bound = np.sqrt(gradient.size) * decrease / np.linalg.norm(gradient)
        assert np.abs(qp12(gradient, decrease, gamma)).max() <= bound * ROUNDING


@pytest.mark.parametrize("gamma", GAMMAS)
def test_proposition_6_holds(gamma):
    """(28) to (30) and the steps (33) to (38), with λ from the joints that move."""
    for gradient, decrease in problems():
        a, x = np.abs(gradient), np.abs(qp12(gradient, decrease, gamma))
        moves = x > 0.0
        lamda = ((1 - gamma) * decrease + gamma * a[moves].sum()) / (a[moves] ** 2).sum()  # (37)
        assert lamda >= 0.0
        expected = np.where(moves, (lamda * a - gamma) / (1 - gamma), 0.0)  # (28), (33)
        np.testing.assert_allclose(x, expected, rtol=0, atol=1e-11 * x.max())
        reach = lamda * a
        slack = 1e-12 * max(gamma, reach.max())
        assert (reach[moves] > gamma - slack).all()  # (34), left of (30)
        assert (np.abs(reach[~moves]) <= gamma + slack).all()  # (35), (36), (38), right of (30)
