"""QP12 with bounds: exact, odd, certified, and the limits of what it accepts."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray
from support.solvers.one_shot import BoundedQp12, qp12, qp12_bounded

from hoap3.protocol.errors import BadProblemError, InfeasibleError
from hoap3.remote_controller.solvers.qp12.bounded_qp12_kernels import (
    bounded_kkt_residual,
    work_shape,
)

Array = NDArray[np.float64]
GAMMAS = (0.0, 0.1, 0.5, 0.9, 0.99)


def most(gradient: Array, lower: Array, upper: Array, sign: float = 1.0) -> float:
    """Largest decrease within the bounds (largest rise for sign −1)."""
    return float(np.sum(np.abs(gradient) * np.where(gradient * sign > 0, -lower, upper)))


def random_problem(rng: np.random.Generator) -> tuple[Array, Array, Array, Array]:
    n = int(rng.choice([1, 2, 3, 7, 21]))
    gradient = rng.normal(size=n) * (rng.random(n) < 0.9)
    gradient[0] = 1.0
    lower = -rng.uniform(0.01, 1, n) * (rng.random(n) < 0.9)
    upper = rng.uniform(0.01, 1, n)
    lower[0] = -0.5
    return gradient, lower, upper, rng.uniform(0.3, 3, n)


def test_is_qp12_to_the_bit_where_no_bound_matters() -> None:
    rng = np.random.default_rng(2)
    for gamma in (*GAMMAS, 1.0):
        gradient = rng.normal(size=21)
        far = np.full(21, np.inf)
        u = qp12_bounded(gradient, 0.3, gamma, -far, far)
        np.testing.assert_array_equal(u, qp12(gradient, 0.3, gamma))


def test_the_most_that_the_bounds_allow_is_reached_and_no_more() -> None:
    rng = np.random.default_rng(4)
    for _ in range(200):
        gradient, lower, upper, w = random_problem(rng)
        limit = most(gradient, lower, upper)
        u = qp12_bounded(gradient, limit, 0.5, lower, upper, weights=w)
        corner = np.where(gradient > 0, lower, upper) * (gradient != 0)
        np.testing.assert_allclose(u, corner, atol=1e-12)
        with pytest.raises(InfeasibleError):
            qp12_bounded(gradient, limit * 1.001, 0.5, lower, upper)


@pytest.mark.parametrize("gamma", GAMMAS)
@pytest.mark.parametrize("noise", [1e-19, -1e-19])
def test_a_gradient_that_is_rounding_moves_no_joint(gamma: float, noise: float) -> None:
    gradient, bound = np.array([1.0, -1e-3, noise]), np.full(3, 0.3)
    u = qp12_bounded(gradient, most(gradient, -bound, bound), gamma, -bound, bound)
    np.testing.assert_allclose(u, [-0.3, 0.3, 0.0], atol=1e-12)


class TestCertificate:
    def residual(self, u: list[float], gamma: float = 0.5) -> float:
        gradient, limit = np.array([2.0, -1.0, 1.0]), np.full(3, 0.3)
        work = np.ones(work_shape(3))
        return bounded_kkt_residual(gradient, 0.8, gamma, -limit, limit, np.array(u), work)

    def test_tells_the_optimum_from_the_rest(self) -> None:
        assert self.residual([-0.3, 0.1, -0.1]) < 1e-15
        assert self.residual([-0.3, 0.2, 0.0]) > 0.01  # the same decrease, uneven
        assert self.residual([-0.2, 0.2, -0.2]) > 0.01  # the limit is not used
        assert self.residual([-0.4, 0.0, 0.0]) > 0.01  # beyond the limit
        assert self.residual([-0.3, 0.0, 0.0]) > 0.01  # too little
        assert self.residual([0.0, 0.0, 0.0]) == 1.0
        assert self.residual([math.nan, 0.0, 0.0]) == math.inf

    def test_accepts_any_share_of_tied_joints_at_gamma_1(self) -> None:
        assert self.residual([-0.3, 0.2, 0.0], gamma=1.0) < 1e-15
        assert self.residual([-0.2, 0.2, -0.2], gamma=1.0) > 0.01


limits = st.one_of(st.floats(1e-9, 10), st.just(0.0))
numbers = st.one_of(st.floats(1e-9, 100), st.floats(-100, -1e-9), st.just(0.0))


@given(st.data(), st.integers(1, 25), st.floats(0, 1), st.floats(0, 1.2), st.sampled_from([-1, 1]))
def test_promises(data: st.DataObject, n: int, gamma: float, share: float, sign: int) -> None:
    """Bounds to the last bit, the decrease, downhill only, a small residual; or a clear refusal."""
    gradient = data.draw(arrays(np.float64, n, elements=numbers))
    upper = data.draw(arrays(np.float64, n, elements=limits))
    lower = -data.draw(arrays(np.float64, n, elements=limits))
    possible = most(gradient, lower, upper, sign)
    decrease = sign * share * possible
    solver, u = BoundedQp12(n), np.full(n, np.nan)
    if share > 1 + 1e-9 and possible > 1e-300:
        with pytest.raises(InfeasibleError):
            solver.solve(gradient, decrease, gamma, lower, upper, u)
        np.testing.assert_array_equal(u, 0.0)
        return
    if share > 1 - 1e-9:
        return
    solver.solve(gradient, decrease, gamma, lower, upper, u)
    assert np.all((lower <= u) & (u <= upper))
    assert np.all(u * gradient * sign <= 0.0)
    assert abs(gradient @ u + decrease) <= 1e-13 * n * possible
    assert solver.kkt_residual <= 1e-9


@pytest.mark.parametrize(
    "change",
    [
        {"gradient": [1.0, math.nan]},
        {"decrease": math.inf},
        {"gamma": 1.5},
        {"gamma": math.nan},
        {"lower": [0.1, -1.0]},
        {"upper": [math.nan, 1.0]},
        {"lower": [-1.0]},
        {"weights": [1.0, 0.0]},
        {"weights": [1.0, -1.0]},
    ],
)
def test_refuses_what_is_no_problem(change: dict[str, object]) -> None:
    given = {
        "gradient": [1.0, 2.0],
        "decrease": 0.1,
        "gamma": 0.5,
        "lower": [-1.0, -1.0],
        "upper": [1.0, 1.0],
    }
    with pytest.raises(BadProblemError):
        qp12_bounded(**{**given, **change})  # type: ignore[arg-type]


def test_zero_gradient() -> None:
    one = np.ones(2)
    np.testing.assert_array_equal(qp12_bounded(0 * one, 0.0, 0.5, -one, one), 0.0)
    with pytest.raises(InfeasibleError):
        qp12_bounded(0 * one, 0.1, 0.5, -one, one)


@pytest.mark.parametrize("apart", [0.0, 1e-15, 1e-12, 1e-10, 1e-9, 5e-9, 1e-7])
@settings(max_examples=10)
@given(seed=st.integers(0, 2**32 - 1))
def test_limits_a_hair_from_where_joints_would_go_are_judged_rightly(apart, seed):
    """The guess that spares rounds must not clamp what stays just below its limit."""
    rng = np.random.default_rng(seed)
    gradient, gamma = rng.normal(size=21), float(rng.choice([0.0, 0.3, 0.9, 1 - 1e-6]))
    free, u = np.zeros(21), np.zeros(21)
    wide = np.full(21, np.inf)
    solver = BoundedQp12(21)
    solver.solve(gradient, 1.0, gamma, -wide, wide, free)
    near = np.abs(free) * (1.0 + apart * rng.choice([-1.0, 1.0], 21))
    limits = np.where(rng.random(21) < 0.5, near, np.inf)
    try:
        solver.solve(gradient, 1.0, gamma, -limits, limits, u)
    except InfeasibleError:
        return
    assert solver.kkt_residual <= 1e-13


@pytest.mark.parametrize("power", [-535, 535])
@given(seed=st.integers(0, 2**32 - 1))
def test_a_power_of_two_changes_no_bit(power: int, seed: int) -> None:
    """Where squares overflow the sets are found in rounds: an answer that knows nothing of guesses.

    With ties, with γ next to 1, and with limits a hair from where joints would go.
    """
    rng = np.random.default_rng(seed)
    n = int(rng.choice([1, 2, 5, 21]))
    gamma = float(rng.choice([0.0, 0.3, 0.99986, 1.0 - 1e-16]))
    gradient = rng.normal(size=n) if rng.random() < 0.6 else rng.choice([-1.0, 1.0], n)
    limits = rng.uniform(0.01, 1.0, n)
    if rng.random() < 0.5:
        try:
            free = np.abs(qp12(gradient, 0.3, gamma))
            limits = np.maximum(free * (1.0 + 1e-12 * rng.normal(size=n)), 1e-6)
        except BadProblemError:
            return
    decrease = 0.3 if rng.random() < 0.5 else 0.9 * most(gradient, -limits, limits)
    if decrease >= most(gradient, -limits, limits):
        return
    solver, near, far = BoundedQp12(n), np.zeros(n), np.zeros(n)
    solver.solve(gradient, decrease, gamma, -limits, limits, near)
    scale = 2.0**power
    solver.solve(scale * gradient, scale * decrease, gamma, -limits, limits, far)
    np.testing.assert_allclose(near, far, rtol=1e-12, atol=1e-13)
