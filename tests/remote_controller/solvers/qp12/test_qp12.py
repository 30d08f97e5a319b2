"""QP12: optimal, with the properties and the steps of the paper."""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray
from qp12_exact import exact_kkt_residual, exact_qp12, relative_error
from support.oracles import qp12_oracle as reference
from support.solvers.one_shot import qp12

from hoap3.remote_controller.solvers import Qp12
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


entries = st.one_of(
    st.floats(1e-30, 100), st.floats(-100, -1e-30), st.integers(-3, 3).map(float), st.just(0.0)
)
gradients = arrays(np.float64, st.integers(1, 25), elements=entries).filter(lambda g: g.any())
decreases = st.one_of(st.floats(1e-12, 1e6), st.floats(1e-250, 1e250))  # b/A within 1e±280
gammas = st.one_of(st.floats(0, 1), st.sampled_from([0.0, 0.5, 0.99, 1 - 1e-15, 1 - EPS / 2, 1.0]))


def norm(u: NDArray[np.float64]) -> float:
    return float(np.max(np.abs(u), initial=0.0))


@given(gradients, decreases, gammas, st.integers(-300, 300))
def test_units_of_v_do_not_matter(
    gradient: NDArray[np.float64], decrease: float, gamma: float, exponent: int
) -> None:
    """Gradient and decrease scaled by the same power of two: the same bits."""
    assume(1e-300 < decrease * 2.0**exponent < 1e300)
    scaled = qp12(gradient * 2.0**exponent, decrease * 2.0**exponent, gamma)
    np.testing.assert_array_equal(scaled, qp12(gradient, decrease, gamma))


@given(gradients, decreases, gammas, st.data())
def test_signs_of_the_gradient_pass_through(
    gradient: NDArray[np.float64], decrease: float, gamma: float, data: st.DataObject
) -> None:
    signs = data.draw(arrays(np.float64, len(gradient), elements=st.sampled_from([-1.0, 1.0])))
    np.testing.assert_array_equal(
        qp12(gradient * signs, decrease, gamma), qp12(gradient, decrease, gamma) * signs
    )


@given(gradients, decreases, gammas, st.randoms(use_true_random=False))
def test_order_of_the_joints_does_not_matter(
    gradient: NDArray[np.float64], decrease: float, gamma: float, random: object
) -> None:
    order = np.arange(len(gradient))
    random.shuffle(order)  # type: ignore[attr-defined]
    u = qp12(gradient, decrease, gamma)
    shuffled = qp12(gradient[order], decrease, gamma)
    np.testing.assert_allclose(shuffled, u[order], rtol=0, atol=4 * EPS * len(u) * norm(u))


@given(gradients, decreases, gammas)
def test_no_joint_moves_up_its_gradient(
    gradient: NDArray[np.float64], decrease: float, gamma: float
) -> None:
    """Lemma 4."""
    u = qp12(gradient, decrease, gamma)
    assert np.all(np.sign(gradient) * np.sign(u) <= 0)
    assert not np.any(u[gradient == 0])


@given(gradients, decreases, gammas)
def test_a_steeper_joint_moves_at_least_as_much(
    gradient: NDArray[np.float64], decrease: float, gamma: float
) -> None:
    """Lemma 5, and the speeds in the order of the gradient."""
    u = np.abs(qp12(gradient, decrease, gamma))[np.argsort(np.abs(gradient))]
    assert np.all(np.diff(u) >= 0)


@given(gradients, decreases)
def test_gamma_0_is_the_pseudo_inverse(gradient: NDArray[np.float64], decrease: float) -> None:
    g = gradient / norm(gradient)
    expected = -g * (decrease / norm(gradient)) / (g @ g)
    u = qp12(gradient, decrease, 0.0)
    np.testing.assert_allclose(u, expected, rtol=0, atol=1e-14 * norm(u))


@given(gradients, gammas)
def test_no_decrease_no_motion(gradient: NDArray[np.float64], gamma: float) -> None:
    for decrease in (0.0, -0.0):
        u = qp12(gradient, decrease, gamma)
        assert not np.any(u)
        assert not np.any(np.signbit(u))


Array = NDArray[np.float64]
STEP_GAMMAS = [0.0, 0.1, 0.5, 0.9]
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


@pytest.mark.parametrize("gamma", STEP_GAMMAS)
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


@pytest.mark.parametrize("gamma", [*STEP_GAMMAS, 0.99, 1.0])
def test_the_bound_on_the_speed(gamma):
    """(15); √n too large where the gradient is even, and never too small."""
    for gradient, decrease in problems():
        bound = np.sqrt(gradient.size) * decrease / np.linalg.norm(gradient)
        assert np.abs(qp12(gradient, decrease, gamma)).max() <= bound * ROUNDING


@pytest.mark.parametrize("gamma", STEP_GAMMAS)
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
