"""OSQP as a solver of a loop gives QP12's answers, at every scale, and refuses the same."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from protocol.errors import BadProblemError, InfeasibleError
from remote_controller.solvers import qp12
from remote_controller.solvers.osqp_qp12 import OsqpQp12

SOLVER = OsqpQp12(9)


@given(
    seed=st.integers(0, 1000),
    gamma=st.sampled_from([0.0, 0.1, 0.5, 0.9]),
    exponent=st.integers(-6, 2),
    sign=st.sampled_from([-1.0, 1.0]),
)
def test_it_agrees_with_the_kernel(seed, gamma, exponent, sign):
    gradient = np.random.default_rng(seed).normal(size=9)
    decrease = sign * 10.0**exponent
    out = np.zeros(9)
    SOLVER.solve(gradient, decrease, gamma, out)
    expected = qp12(gradient, decrease, gamma)
    assert gradient @ out == pytest.approx(-decrease, rel=1e-4)
    np.testing.assert_allclose(out, expected, atol=1e-3 * np.abs(expected).max())


def test_edges():
    out = np.ones(9)
    SOLVER.solve(np.ones(9), 0.0, 0.5, out)
    assert not out.any()
    with pytest.raises(InfeasibleError):
        SOLVER.solve(np.zeros(9), 1.0, 0.5, out)
    with pytest.raises(BadProblemError):
        SOLVER.solve(np.full(9, np.nan), 1.0, 0.5, out)
