"""QP12's answers are optimal: in exact fractions, by a foreign solver, where Algorithm 1 is not."""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction

import numpy as np
import pytest
import quadprog
from numpy.typing import NDArray
from qp12_exact import exact_kkt_residual, exact_qp12, relative_error

from hoap3.remote_controller.solvers import Qp12, qp12
from hoap3.remote_controller.solvers.qp12 import reference
from hoap3.remote_controller.solvers.qp12.qp12_kernels import qp12_kkt_residual

EPS = 2.0**-52
GAMMAS = (0, 1e-300, 1e-9, 0.1, 0.5, 0.9, 0.99, 1 - 1e-6, 1 - 1e-12, 1 - 1e-15, 1 - EPS / 2, 1)
SCALES = (1.0, 1.0, 1e-300, 1e300, 1e-160, 1e160, 1e-318)
Case = tuple[NDArray[np.float64], float, float]


def hard_cases(seed: int, count: int) -> Iterator[Case]:
    """Gradient, decrease and γ: ties, near ties, zeros, every scale of each, γ at both ends."""
    rng = np.random.default_rng(seed)
    while count:
        n = int(rng.choice([1, 2, 3, 7, 21, 40]))
        shape = (
            rng.normal(size=n),
            rng.integers(-3, 4, size=n).astype(float),
            rng.normal(size=n) * (rng.random(n) < 0.5),
            (1 + EPS * rng.integers(-4, 5, size=n)) * rng.choice([-1, 1], n),
            10 ** rng.uniform(-300, 0, n) * rng.choice([-1, 1], n),
            1 + rng.normal(size=n) * 10 ** rng.uniform(-16, -1),
        )[rng.integers(6)]
        gradient = shape * rng.choice(SCALES)
        gamma = float(rng.choice(GAMMAS) if rng.random() < 0.7 else rng.random())
        speed = 10.0 ** (rng.uniform(-3, 2) if rng.random() < 0.5 else rng.uniform(-290, 290))
        decrease = speed * float(np.max(np.abs(gradient))) * rng.choice([-1, 1])
        if 1e-320 < abs(decrease) < 1e308:
            yield gradient, float(decrease), gamma
            count -= 1


def test_conditions_31_and_32_hold_in_exact_arithmetic() -> None:
    for gradient, decrease, gamma in hard_cases(seed=1, count=2000):
        u = qp12(gradient, decrease, gamma)
        assert exact_kkt_residual(gradient, decrease, gamma, u) < 1e-14


@pytest.mark.parametrize("count", [200, pytest.param(5000, marks=pytest.mark.slow)])
def test_every_digit_agrees_with_algorithm_1_in_exact_arithmetic(count: int) -> None:
    """The error is a few ulp per joint, whatever γ: A − a and 1 − γ are exact where it counts."""
    for gradient, decrease, gamma in hard_cases(seed=2, count=count):
        u = qp12(gradient, decrease, gamma)
        exact = exact_qp12(gradient, decrease, gamma)
        assert relative_error(u, exact) < 4 * EPS * len(u)


@pytest.mark.parametrize("gamma", GAMMAS)
def test_a_thousand_joints_lose_no_digits(gamma: float) -> None:
    gradient = np.random.default_rng(3).normal(size=1000)
    u = qp12(gradient, 3.0, gamma)
    assert exact_kkt_residual(gradient, 3.0, gamma, u) < 1e-13
    assert relative_error(u, exact_qp12(gradient, 3.0, gamma)) < 1e-13


@pytest.mark.parametrize("gamma", [0.0, 0.1, 0.5, 0.9, 0.99, 0.999])
def test_agrees_with_quadprog(gamma: float) -> None:
    rng = np.random.default_rng(4)
    for n in (2, 7, 21):
        for _ in range(30):
            gradient, decrease = rng.normal(size=n), 10.0 ** rng.uniform(-2, 1)
            a = np.abs(gradient)
            x = quadprog.solve_qp(
                (1 - gamma) * np.eye(n),
                np.full(n, -gamma),
                np.column_stack([a, np.eye(n)]),
                np.concatenate([[decrease], np.zeros(n)]),
                meq=1,
            )[0]
            u = qp12(gradient, decrease, gamma)
            np.testing.assert_allclose(-u * np.sign(gradient), x, atol=1e-9 * max(x), rtol=0)


def test_algorithm_1_as_printed_throws_the_robot_near_convergence() -> None:
    """One ulp of γ, divided by 1 − γ, outgrows a small step; then it runs on to M = m."""
    gradient = np.random.default_rng(5).normal(size=21)
    decrease, gamma = 1e-17, 0.99
    printed = np.array(reference.qp12(gradient.tolist(), decrease, gamma))
    assert np.max(np.abs(printed)) > 10.0  # rad/s, where 1e-17 is asked for
    assert qp12_kkt_residual(gradient, decrease, gamma, printed) > 0.5

    u = qp12(gradient, decrease, gamma)
    exact = reference.qp12([Fraction(x) for x in gradient], Fraction(decrease), Fraction(gamma))
    assert relative_error(u, exact) < 4 * EPS
    assert np.count_nonzero(u) == 1
    assert np.max(np.abs(u)) < 1e-17


def test_algorithm_1_as_printed_squares_itself_out_of_range() -> None:
    with pytest.raises(ZeroDivisionError):
        reference.qp12([2e-200, -1e-200], 0.5e-200, 0.5)
    printed = np.array(reference.qp12([2e200, -1e200], 0.5e200, 0.5))
    assert exact_kkt_residual(np.array([2e200, -1e200]), 0.5e200, 0.5, printed) > 0.5
    for scale in (1e-200, 1e200):
        u = qp12([2 * scale, -scale], 0.5 * scale, 0.5)
        np.testing.assert_allclose(u, qp12([2.0, -1.0], 0.5, 0.5), rtol=1e-15)


def test_gamma_1_is_the_limit_and_shares_ties_evenly() -> None:
    gradient = np.array([1.0, -2.0, 2.0, 0.0, 2.0])
    u = qp12(gradient, 3.0, 1.0)
    np.testing.assert_array_equal(u, [0.0, 0.5, -0.5, 0.0, -0.5])
    np.testing.assert_allclose(u, qp12(gradient, 3.0, 1 - 1e-15), rtol=1e-15)


@pytest.mark.parametrize("gamma", [0.0, 0.5, 1.0])
def test_answers_next_to_the_smallest_double(gamma: float) -> None:
    """Gradual underflow keeps an absolute error of the smallest double, then zero."""
    for exponent in range(-1090, -1010, 3):
        gradient = np.array([1.0, -0.75, 1.0]) * 2.0**60
        decrease = 2.0 ** max(exponent + 60, -1074) * 0.75
        u = qp12(gradient, decrease, gamma)
        exact = exact_qp12(gradient, decrease, gamma)
        gap = max(abs(Fraction(a) - b) for a, b in zip(u, exact, strict=True))
        assert gap <= max(2.0**-1074, 4 * EPS * float(max(map(abs, exact))))
        assert qp12_kkt_residual(gradient, decrease, gamma, u) < 1e-14


@pytest.mark.slow
class TestCertificate:
    """The residual that goes with every answer."""

    def test_is_small_on_every_correct_answer(self) -> None:
        for gradient, decrease, gamma in hard_cases(seed=6, count=2000):
            solver, u = Qp12(len(gradient)), np.empty_like(gradient)
            solver.solve(gradient, decrease, gamma, u)
            assert solver.kkt_residual < 1e-14
            exact = np.array([float(x) for x in exact_qp12(gradient, decrease, gamma)])
            assert qp12_kkt_residual(gradient, decrease, gamma, exact) < 1e-14

    def test_bounds_the_error_of_any_answer(self) -> None:
        """As its docstring promises: error ≤ 4 n residual, checked on spoilt answers."""
        rng = np.random.default_rng(7)
        for gradient, decrease, gamma in hard_cases(seed=8, count=2000):
            if gamma == 1.0:  # not unique
                continue
            u = qp12(gradient, decrease, gamma)
            size = 10.0 ** rng.uniform(-12, -1) * np.max(np.abs(u))
            u[rng.integers(len(u))] += rng.choice([-1, 1]) * size
            residual = qp12_kkt_residual(gradient, decrease, gamma, u)
            error = relative_error(u, exact_qp12(gradient, decrease, gamma))
            assert error <= 4.4 * len(u) * (residual + 1e-15)

    @pytest.mark.parametrize("gamma", [0.0, 0.5, 0.99, 1 - 1e-15])
    def test_is_large_on_wrong_answers(self, gamma: float) -> None:
        gradient, decrease = np.array([1.0, -0.9, 0.5, 0.0]), 0.3
        u = qp12(gradient, decrease, gamma)
        wrong = {
            "still": u * 0,
            "uphill": -u,
            "too fast": u * 1.1,
            "the other γ": qp12(gradient, decrease, 0.5 if gamma == 0.0 else 0.0),
            "a joint without effect": u + np.array([0.0, 0.0, 0.0, 0.1]),
            "the wrong joint": np.array([0.0, 0.0, -0.6, 0.0]),
        }
        for name, answer in wrong.items():
            assert qp12_kkt_residual(gradient, decrease, gamma, answer) > 0.02, name

    def test_accepts_every_optimum_at_gamma_1(self) -> None:
        gradient = np.array([2.0, -2.0, 1.0])
        for share in (0.0, 0.3, 1.0):
            u = np.array([-share, 1 - share, 0.0])
            assert qp12_kkt_residual(gradient, 2.0, 1.0, u) < 1e-15
        assert qp12_kkt_residual(gradient, 2.0, 1.0, np.array([-2.0, -1.0, 0.0])) > 0.1
        assert qp12_kkt_residual(gradient, 2.0, 1.0, np.array([-0.5, 0.0, -1.0])) > 0.1

    def test_knows_what_can_only_stand_still(self) -> None:
        still, moving = np.zeros(2), np.array([0.0, 1e-300])
        slope = np.array([1.0, 2.0])
        assert qp12_kkt_residual(slope, 0.0, 0.5, still) == 0.0
        assert qp12_kkt_residual(slope, 0.0, 0.5, moving) == 1.0
        assert qp12_kkt_residual(still, 0.0, 0.5, still) == 0.0
        assert qp12_kkt_residual(still, 0.1, 0.5, still) == 1.0

    def test_is_infinite_where_nothing_can_be_judged(self) -> None:
        slope, u = np.array([1.0, 2.0]), np.array([0.0, -1.0])
        for gradient, decrease, gamma, answer in (
            (slope, np.nan, 0.5, u),
            (slope, 1.0, 1.5, u),
            (slope, 1.0, np.nan, u),
            (slope, 1.0, 0.5, np.array([np.nan, 0.0])),
            (slope, 1.0, 0.5, np.array([np.inf, 0.0])),
            (slope, 1.0, 0.5, np.array([1e308, 1e308])),
            (np.array([np.inf, 0.0]), 1.0, 0.5, u),
            (slope, 1.0, 0.5, np.zeros(3)),
        ):
            residual = qp12_kkt_residual(gradient, decrease, gamma, answer)
            assert residual == np.inf or residual > 0.5
