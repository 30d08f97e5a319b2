"""OSQP as a solver of a loop gives QP12's answers, at every scale, and refuses the same."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hoap3.protocol.errors import BadProblemError, InfeasibleError
from hoap3.remote_controller.solvers import qp12
from hoap3.remote_controller.solvers.qp12.osqp_qp12 import OsqpQp12
from hoap3.remote_controller.solvers.qp12.qp12_kernels import qp12_kkt_residual

SOLVER = OsqpQp12(9)
GAMMAS = [0.0, 0.1, 0.5, 0.9, 0.999, 1.0]


def solved(solver: OsqpQp12, gradient, decrease, gamma):
    out = np.full(solver.n, np.nan)
    solver.solve(gradient, decrease, gamma, out)
    return out


@given(
    seed=st.integers(0, 1000),
    gamma=st.sampled_from(GAMMAS),
    exponent=st.integers(-12, 12),
    steepness=st.integers(-8, 8),
    sign=st.sampled_from([-1.0, 1.0]),
)
def test_it_agrees_with_the_kernel(seed, gamma, exponent, steepness, sign):
    gradient = np.random.default_rng(seed).normal(size=9) * 10.0**steepness
    decrease = sign * 10.0**exponent
    out = solved(SOLVER, gradient, decrease, gamma)
    expected = qp12(gradient, decrease, gamma)
    assert gradient @ out == pytest.approx(-decrease, rel=1e-3)
    np.testing.assert_allclose(out, expected, rtol=0, atol=1e-3 * np.abs(expected).max())


def test_polished_it_is_as_exact_as_the_kernel_and_unpolished_only_to_its_tolerance():
    rng = np.random.default_rng(3)
    problems = [(rng.normal(size=9), 10.0 ** rng.uniform(-6, 2)) for _ in range(50)]
    worst = {}
    for polish in (True, False):
        solver = OsqpQp12(9, polish=polish)
        worst[polish] = max(
            qp12_kkt_residual(a, b, 0.5, solved(solver, a, b, 0.5)) for a, b in problems
        )
    assert worst[True] < 1e-12
    assert 1e-9 < worst[False] < 1e-2


def test_forgetful_it_gives_the_bits_of_a_new_one():
    rng = np.random.default_rng(4)
    used, problem = OsqpQp12(9, polish=False), (rng.normal(size=9), 0.3, 0.5)
    for _ in range(50):  # of many scales and weights, so that OSQP adapts its step
        solved(used, rng.normal(size=9), 10.0 ** rng.uniform(-9, 3), rng.uniform())
    warm = solved(used, *problem)
    new = solved(OsqpQp12(9, polish=False), *problem)
    assert (warm != new).any()
    used.forget()
    assert solved(used, *problem).tobytes() == new.tobytes()


def test_it_starts_from_the_last_answer():
    gradient = np.random.default_rng(5).normal(size=9)
    solver = OsqpQp12(9)
    solved(solver, gradient, 0.3, 0.5)
    first = solver.iterations
    solved(solver, 1.001 * gradient, 0.3, 0.5)
    assert solver.iterations < first


@pytest.mark.parametrize(
    ("gradient", "decrease", "gamma", "error"),
    [
        (np.zeros(9), 1.0, 0.5, InfeasibleError),
        (np.full(9, np.nan), 1.0, 0.5, BadProblemError),
        (np.ones(9), np.inf, 0.5, BadProblemError),
        (np.ones(9), 1.0, 1.5, BadProblemError),
        (np.full(9, 1e-10), 1e300, 0.5, BadProblemError),
    ],
    ids=["no gradient", "nan", "inf", "gamma", "beyond"],
)
def test_what_it_refuses_leaves_zeros(gradient, decrease, gamma, error):
    out = np.ones(9)
    with pytest.raises(error):
        SOLVER.solve(gradient, decrease, gamma, out)
    assert not out.any()


@pytest.mark.parametrize(
    ("gradient", "decrease"),
    [(np.ones(9), 0.0), (np.zeros(9), 0.0), (np.full(9, 1e200), 1e-200)],
    ids=["nothing asked", "nothing asked of nothing", "below the smallest number"],
)
def test_nothing_needs_nothing(gradient, decrease):
    assert not solved(SOLVER, gradient, decrease, 0.5).any()


def test_numbers_at_the_edge_of_doubles_are_no_trouble():
    for gradient, decrease, u in [(5e-324, 5e-324, -1 / 9), (1e308, -1e300, 1e-8 / 9)]:
        np.testing.assert_allclose(solved(SOLVER, np.full(9, gradient), decrease, 0.5), u)


def test_out_of_iterations_it_says_so_and_goes_on_from_there():
    gradient, out = np.random.default_rng(6).normal(size=9), np.ones(9)
    solver = OsqpQp12(9, max_iterations=10)
    with pytest.raises(BadProblemError, match="maximum iterations"):
        solver.solve(gradient, 0.3, 0.5, out)
    assert not out.any()
    assert solver.iterations == 10
    for _ in range(100):
        try:
            solver.solve(gradient, 0.3, 0.5, out)
            break
        except BadProblemError:
            pass
    np.testing.assert_allclose(out, qp12(gradient, 0.3, 0.5), atol=1e-6)
