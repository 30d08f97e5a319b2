"""Least ℓp norm: Example 2 and (9), near p = 1 and for numbers of any size."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray
from scipy.optimize import minimize

from hoap3.protocol.errors import BadProblemError, InfeasibleError
from hoap3.remote_controller.solvers import qp12
from hoap3.remote_controller.solvers.lyapunov_qp.lp_norm import LpNorm, lp_norm
from hoap3.remote_controller.solvers.lyapunov_qp.lp_norm_kernels import lp_norm_kernel

Array = NDArray[np.float64]
numbers = st.one_of(st.floats(1e-9, 100), st.floats(-100, -1e-9), st.just(0.0))
gradients = arrays(np.float64, st.integers(1, 21), elements=numbers).filter(lambda g: g.any())
powers = st.one_of(st.floats(0.1, 1.0), st.floats(1.0, 3.0), st.floats(1, 100), st.just(math.inf))


@given(gradients, st.one_of(st.just(0.0), st.floats(1e-100, 5), st.floats(-5, -1e-100)), powers)
def test_decreases_as_asked_and_is_certified(gradient: Array, decrease: float, p: float) -> None:
    solver, u = LpNorm(gradient.size), np.full(gradient.size, np.nan)
    solver.solve(gradient, decrease, p, u)
    assert np.all(np.isfinite(u))
    assert gradient @ u == pytest.approx(-decrease, rel=1e-12, abs=1e-300)
    assert np.all(u * gradient * np.sign(decrease) <= 0.0)
    assert solver.kkt_residual <= 1e-11


@pytest.mark.parametrize("p", [1.5, 2.0, 3.0, 7.0])
def test_agrees_with_a_general_minimiser(p: float) -> None:
    gradient, decrease = np.array([1.0, -0.6, 0.3]), 0.7
    u = lp_norm(gradient, decrease, p)

    def norm(free: Array) -> float:
        first = (-decrease - gradient[1:] @ free) / gradient[0]
        return float(np.sum(np.abs([first, *free]) ** p))

    found = minimize(
        norm, u[1:] * 0.5, method="Nelder-Mead", options={"xatol": 1e-9, "fatol": 1e-14}
    )
    np.testing.assert_allclose(u[1:], found.x, atol=1e-5)


def test_is_9_in_exact_arithmetic_where_powers_are_whole() -> None:
    gradient = [Fraction(3), Fraction(-2), Fraction(1, 3)]
    for inverse in (1, 2, 5, 40):  # 1/(p − 1)
        total = sum(abs(a) ** (inverse + 1) for a in gradient)
        exact = [-a / abs(a) * abs(a) ** inverse / total for a in gradient]
        u = lp_norm([float(a) for a in gradient], 1.0, 1 + 1 / inverse)
        np.testing.assert_allclose(u, [float(x) for x in exact], rtol=1e-12)


def test_two_is_qp12_without_sparsity_and_infinity_is_democratic() -> None:
    gradient = np.array([1.0, -0.5, 0.0, 2.0])
    np.testing.assert_allclose(lp_norm(gradient, 0.3, 2.0), qp12(gradient, 0.3, 0.0), rtol=1e-14)
    u = lp_norm(gradient, 0.7, math.inf)
    np.testing.assert_allclose(u, [-0.2, 0.2, 0.0, -0.2], rtol=1e-15)
    np.testing.assert_allclose(lp_norm(gradient, 0.7, 1e12), u, rtol=1e-9)


@pytest.mark.parametrize("p", [1 + 2.0**-52, 1 + 1e-12, 1.0001, 1.01])
@pytest.mark.parametrize("scale", [1e-300, 1.0, 1e300])
def test_next_to_1_the_printed_powers_leave_the_range_and_ours_do_not(
    p: float, scale: float
) -> None:
    gradient = np.array([0.5, -3.0, 2.0]) * scale
    with np.errstate(all="ignore"):
        size = np.abs(gradient)
        printed = np.sign(gradient) * size ** (1 / (p - 1)) / np.sum(size ** (p / (p - 1)))
    assert p == 1.01 or not np.all(np.isfinite(printed)) or not np.any(printed)
    u = lp_norm(gradient, 3.0 * scale, p)
    np.testing.assert_allclose(u, [0.0, 1.0, 0.0], atol=1e-9)


@pytest.mark.parametrize("p", [0.1, 0.5, 1.0])
def test_up_to_1_one_joint_moves_the_first_of_the_steepest(p: float) -> None:
    u = lp_norm([1.0, -2.0, 2.0], 3.0, p)
    np.testing.assert_array_equal(u, [0.0, 1.5, 0.0])


def test_ties_above_1_share_evenly() -> None:
    np.testing.assert_allclose(lp_norm([2.0, -2.0, 1.0], 1.0, 1 + 1e-9), [-0.25, 0.25, 0.0])


@pytest.mark.parametrize("p", [0.5, 1.0, 1.5, 2.0, math.inf])
def test_the_certificate_sees_a_wrong_answer(p: float) -> None:
    gradient = np.array([1.0, -0.9, 0.4])
    status, residual = lp_norm_kernel(3, gradient, 0.5, p, np.zeros(3))
    assert status == 0
    assert residual < 1e-14
    from hoap3.remote_controller.solvers.lyapunov_qp import lp_norm_kernels

    u = lp_norm(gradient, 0.5, p)
    judged = lp_norm_kernels.lp_norm_residual
    for wrong in (u * 1.01, -u, u * 0.0, np.array([0.0, 0.0, -1.25])):
        assert judged(gradient, 0.5, p, wrong) > 1e-3


def test_stands_still_where_nothing_is_asked() -> None:
    u = lp_norm([1.0, 2.0], -0.0, 1.5)
    np.testing.assert_array_equal(u, 0.0)
    np.testing.assert_array_equal(lp_norm([0.0, 0.0], 0.0, 1.5), 0.0)


@pytest.mark.parametrize(
    ("gradient", "decrease", "p"),
    [
        ([1.0, math.nan], 1.0, 2.0),
        ([1.0], math.inf, 2.0),
        ([1.0], 1.0, 0.0),
        ([1.0], 1.0, -1.0),
        ([1.0], 1.0, math.nan),
        ([1e-300], 1e300, 2.0),
    ],
)
def test_refuses_by_name(gradient: list[float], decrease: float, p: float) -> None:
    with pytest.raises(BadProblemError):
        lp_norm(gradient, decrease, p)


def test_refuses_what_a_flat_v_cannot_give() -> None:
    with pytest.raises(InfeasibleError):
        lp_norm([0.0, 0.0], 1.0, 2.0)
    with pytest.raises(BadProblemError):
        LpNorm(2).solve(np.ones(3), 1.0, 2.0, np.zeros(3))


def test_wrong_shapes_and_types_are_refused() -> None:
    with pytest.raises(BadProblemError):
        LpNorm(2).solve([1.0, 2.0], 1.0, 2.0, np.zeros(2))  # type: ignore[arg-type]
