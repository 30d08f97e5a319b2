"""What QP12 promises for every problem."""

from __future__ import annotations

import numpy as np
from hypothesis import assume, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from hoap3.remote_controller.solvers import qp12

EPS = 2.0**-52
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


@given(gradients, decreases, st.sampled_from([0.0, 1.0]), st.integers(-200, 200))
def test_homogeneous_in_the_decrease_at_both_ends_of_gamma(
    gradient: NDArray[np.float64], decrease: float, gamma: float, exponent: int
) -> None:
    assume(1e-280 < decrease * 2.0**exponent / norm(gradient) < 1e280)
    u = qp12(gradient, decrease, gamma)
    scaled = qp12(gradient, decrease * 2.0**exponent, gamma)
    np.testing.assert_array_equal(scaled, u * 2.0**exponent)


@given(gradients, decreases, gammas)
def test_odd_in_the_decrease(gradient: NDArray[np.float64], decrease: float, gamma: float) -> None:
    np.testing.assert_array_equal(
        qp12(gradient, -decrease, gamma), -qp12(gradient, decrease, gamma)
    )


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


@given(gradients, decreases, gammas)
def test_fastest_joint_stays_below_decrease_over_largest_gradient(
    gradient: NDArray[np.float64], decrease: float, gamma: float
) -> None:
    """Every term of a·x = b is non-negative, so a_1 x_1 ≤ b; Ψ bounds the speed."""
    bound = decrease / norm(gradient)
    assert norm(qp12(gradient, decrease, gamma)) <= bound * (1 + 4 * EPS)


@given(gradients, decreases, gammas)
def test_v_decreases_as_demanded(
    gradient: NDArray[np.float64], decrease: float, gamma: float
) -> None:
    scale = norm(gradient)
    u = qp12(gradient, decrease, gamma)
    assert abs((gradient / scale) @ u / (decrease / scale) + 1) <= 8 * EPS * (len(u) + 4)


@given(gradients, decreases)
def test_gamma_0_is_the_pseudo_inverse(gradient: NDArray[np.float64], decrease: float) -> None:
    g = gradient / norm(gradient)
    expected = -g * (decrease / norm(gradient)) / (g @ g)
    u = qp12(gradient, decrease, 0.0)
    np.testing.assert_allclose(u, expected, rtol=0, atol=1e-14 * norm(u))


def moving(u: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Joints that move by more than rounding."""
    return np.abs(u) > 1e-13 * norm(u)


@given(gradients, decreases, st.tuples(gammas, gammas).map(sorted))
def test_more_gamma_never_moves_a_further_joint(
    gradient: NDArray[np.float64], decrease: float, pair: list[float]
) -> None:
    """Whether joint i moves depends on b/(Aκ) alone, and grows with it."""
    even, sparse = (qp12(gradient, decrease, gamma) for gamma in pair)
    assert not np.any(moving(sparse) & (even == 0))


@given(gradients, st.tuples(decreases, decreases).map(sorted), gammas)
def test_a_larger_decrease_never_stops_a_joint(
    gradient: NDArray[np.float64], pair: list[float], gamma: float
) -> None:
    less, more = (qp12(gradient, decrease, gamma) for decrease in pair)
    assert not np.any(moving(less) & (more == 0))
    assert np.all(np.abs(less) <= np.abs(more) * (1 + 1e-13) + 1e-13 * norm(less))


@given(gradients, gammas)
def test_no_decrease_no_motion(gradient: NDArray[np.float64], gamma: float) -> None:
    for decrease in (0.0, -0.0):
        u = qp12(gradient, decrease, gamma)
        assert not np.any(u)
        assert not np.any(np.signbit(u))
