"""The general problem by one call, with errors instead of statuses, and what it always promises."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray
from stable_problems import generic, most_descent

from hoap3.protocol.errors import BadProblemError, InfeasibleError
from hoap3.remote_controller.solvers.base import status
from hoap3.remote_controller.solvers.lyapunov_qp.functions import feasible_rate, lyapunov_qp
from hoap3.remote_controller.solvers.lyapunov_qp.stable_qp import StableQp
from hoap3.remote_controller.solvers.qp12.bounded_qp12 import qp12_bounded

Array = NDArray[np.float64]
FAR = 1e3


class TestFunctions:
    """The convenient face."""

    def test_feasible_rate_agrees_with_highs(self) -> None:
        for each in generic(seed=9, count=40):
            most = most_descent(each)
            rest = (each.A, each.b, each.lower, each.upper)
            rho = feasible_rate(each.gradient, 2 * most, *rest)
            assert rho == pytest.approx(0.5, rel=1e-9)
            assert feasible_rate(each.gradient, most / 2, *rest) == 1.0

    @pytest.mark.parametrize("tilt", [1e-7, 5e-7, 1e-6])
    def test_feasible_rate_finds_what_a_row_leaves_that_is_nearly_parallel(
        self, tilt: float
    ) -> None:
        row, ends = [[-1.0, -1.0 - tilt]], [1.0, 0.6]
        rho = feasible_rate([1.0, 1.0], 1.0, row, [1e-5], [-1.0, -0.6], ends)

        assert rho == pytest.approx(1e-5 + 0.6 * tilt, rel=1e-8)

    def test_feasible_rate_at_its_ends(self) -> None:
        assert feasible_rate([1.0, 2.0], 5.0) == 1.0  # unbounded but for ρ ≤ 1
        assert feasible_rate([1.0, 2.0], 0.0, lower=[0, 0], upper=[0, 0]) == 1.0
        assert feasible_rate([1.0, 2.0], 1.0, lower=[0, 0], upper=[0, 0]) == 0.0
        assert feasible_rate([0.0, 0.0], 0.0) == 1.0
        assert feasible_rate([1.0], 1.0, lower=[-1], upper=[1], drift=3.0) == pytest.approx(-2.0)
        assert feasible_rate([1.0], 0.0, lower=[-1], upper=[1], drift=3.0) == -1e9
        with pytest.raises(InfeasibleError, match="contradict"):
            feasible_rate([1.0], 1.0, A=[[1.0], [-1.0]], b=[-1.0, 0.0])
        with pytest.raises(InfeasibleError, match="drift"):
            feasible_rate([0.0], 0.0, drift=1.0)
        with pytest.raises(BadProblemError):
            feasible_rate([1.0], -1.0)

    def test_lyapunov_qp(self) -> None:
        for each in generic(seed=10, count=20):
            rest = (each.A, each.b, each.lower, each.upper)
            u = lyapunov_qp(each.gradient, each.psi, 0.5, *rest)
            assert each.gradient @ u == pytest.approx(-each.psi, rel=1e-8)
            free = lyapunov_qp(each.gradient, each.psi, 0.5, lower=each.lower, upper=each.upper)
            bounded = qp12_bounded(each.gradient, each.psi, 0.5, each.lower, each.upper)
            np.testing.assert_allclose(free, bounded, atol=1e-14)
            with pytest.raises(InfeasibleError):
                lyapunov_qp(each.gradient, most_descent(each) * 1.01, 0.5, *rest)

    @pytest.mark.parametrize("share", [0.0, 1e-12, 1e-9, 1e-6])
    def test_a_decrease_of_zero_or_nearly_so_is_met(self, share: float) -> None:
        for seed in range(60):
            gradient = np.random.default_rng(seed).normal(size=3)
            wanted = share * float(np.linalg.norm(gradient))
            u = lyapunov_qp(gradient, wanted, 0.5, A=[[0.0, 0.0, -1.0]], b=[-0.1])
            assert u[2] >= 0.1 - 1e-12
            assert abs(gradient @ u + wanted) <= 1e-13 + 1e-8 * wanted
        along = lyapunov_qp([1.0, 0.0], share, 0.5, lower=[-1.0, 0.1], upper=[1.0, 1.0])
        np.testing.assert_allclose(along, [-share, 0.1], atol=1e-13)

    @pytest.mark.parametrize("share", [0.0, 1e-9, 1e-6, 1e-3])
    def test_the_one_point_with_the_largest_decrease_is_met_and_no_more(self, share: float) -> None:
        for seed in range(40):
            gradient = np.abs(np.random.default_rng(seed).normal(size=3))
            lower = (np.array([-0.1, 0.1, 0.0]) - share * np.array([1.0, 0.0, 0.0])) / gradient
            upper = lower + 1.0
            u = lyapunov_qp(gradient, share, 0.5, lower=lower, upper=upper)
            np.testing.assert_allclose(u, lower, atol=1e-9)
            with pytest.raises(InfeasibleError, match=r"at most"):
                lyapunov_qp(gradient, share + 1e-7, 0.5, lower=lower, upper=upper)

    def test_infeasible_errors_name_the_range_that_the_constraints_permit(self) -> None:
        with pytest.raises(InfeasibleError, match=r"at most 0\.5 .*found 0\.75"):
            lyapunov_qp([1.0], 0.75, 0.5, lower=[-0.5], upper=[0.5])
        with pytest.raises(InfeasibleError, match=r"at least 0\.25 .*found 0\)"):
            lyapunov_qp([1.0], 0.0, 0.5, lower=[-0.5], upper=[-0.25])
        with pytest.raises(InfeasibleError, match="gradient is 0"):
            lyapunov_qp([0.0, 0.0], 1.0, 0.5)
        with pytest.raises(InfeasibleError, match="contradict"):
            lyapunov_qp([1.0], 0.0, 0.5, A=[[1.0], [-1.0]], b=[-1.0, 0.0])

    def test_feasible_rate_is_1_where_nothing_is_asked_for_and_u_must_move(self) -> None:
        for seed in range(200):
            gradient = np.random.default_rng(seed).normal(size=3)
            for psi in (0.0, 1e-12, 1e-9):
                rho = feasible_rate(gradient, psi, A=[[0.0, 0.0, -1.0]], b=[-0.1])
                assert rho == pytest.approx(1.0, abs=1e-6)

    def test_refusals(self) -> None:
        with pytest.raises(InfeasibleError):
            lyapunov_qp([0.0, 0.0], 1.0, 0.5)
        with pytest.raises(BadProblemError):
            lyapunov_qp([1.0, 0.0], 1.0, 0.5, A=[[1.0]], b=[1.0])
        with pytest.raises(BadProblemError):
            lyapunov_qp([1.0, math.nan], 1.0, 0.5)


limits = st.one_of(st.floats(1e-6, 2), st.just(0.0))
values = st.floats(-3, 3).map(lambda x: 0.0 if abs(x) < 1e-3 else x)


@settings(max_examples=100)
@given(
    st.data(),
    st.integers(1, 5),
    st.integers(0, 4),
    st.floats(0, 5),
    st.floats(-3, 3),
    st.sampled_from(["qp12", 1, 2, math.inf]),
)
def test_promises(
    data: st.DataObject, n: int, m: int, psi: float, drift: float, objective: str | float
) -> None:
    """Whatever is asked: finite answers within the bounds, a true certificate, a named status."""
    gradient = data.draw(arrays(np.float64, n, elements=values))
    A = data.draw(arrays(np.float64, (m, n), elements=values))
    b = data.draw(arrays(np.float64, m, elements=st.floats(-0.5, 2)))
    upper = data.draw(arrays(np.float64, n, elements=limits))
    lower = -data.draw(arrays(np.float64, n, elements=limits))
    s = StableQp(n, m, objective=objective)
    found = s.solve(gradient, psi, drift, A, b, lower, upper)
    assert found in range(len(status.NAMES))
    assert np.all((lower <= s.u) & (s.u <= upper))
    assert s.rate == pytest.approx(gradient @ s.u + drift, abs=1e-12)
    slack = np.concatenate([b - A @ s.u, upper - s.u, s.u - lower])
    assert s.margin == pytest.approx(slack.min(), abs=1e-12)
    assert not math.isnan(s.rho)
    assert not math.isnan(s.kkt_residual)
    if found in (status.OK, status.CANNOT_DESCEND, status.DESCENDS_FASTER, status.STATIONARY):
        assert s.margin >= -1e-7
        assert s.rate <= 1e-6 or found == status.CANNOT_DESCEND
        if psi > 1e-3:
            assert s.rate == pytest.approx(-s.rho * psi, abs=1e-9)
    else:
        assert found in (status.ZERO_GRADIENT, status.INFEASIBLE_CONSTRAINTS)


def tiny_problem(seed: int) -> tuple[StableQp, int, Array, Array]:
    """The answer to a problem whose bounds are partly 1e-7 to 1e-4, its A and its b."""
    rng = np.random.default_rng(seed)
    n, m = int(rng.integers(1, 6)), int(rng.integers(0, 5))
    objective: str | float = ["qp12", 1, 2, math.inf][seed % 4]
    psi = float(rng.choice([0.0, rng.uniform(0, 5)]))
    drift = float(rng.choice([rng.uniform(-3, 3), 1.0]))
    gradient, A = rng.uniform(-3, 3, n).round(2), rng.uniform(-3, 3, (m, n)).round(1)
    b = rng.choice([0.0, 1.0], m) * rng.uniform(-0.5, 2, m)

    def magnitude() -> Array:
        is_tiny, tiny = rng.random(n) < 0.5, 10.0 ** rng.uniform(-7, -4, n)
        return np.where(is_tiny, tiny, rng.uniform(0, 2, n)) * (rng.random(n) < 0.85)

    lower, upper = -magnitude(), magnitude()
    solver = StableQp(n, m, objective=objective)
    return solver, solver.solve(gradient, psi, drift, A, b, lower, upper), A, b


@pytest.mark.parametrize("seed", [7, 1659, 2307, 2431])
def test_an_answer_keeps_its_rows_also_where_bounds_are_tiny(seed: int) -> None:
    """These were answered with a status of success, and a row exceeded by up to 1.4e-6."""
    solver, found, A, b = tiny_problem(seed)
    assert found in (status.CANNOT_DESCEND, status.DESCENDS_FASTER)
    assert (b - A @ solver.u).min() >= -1e-7
    assert solver.margin >= -1e-7


@pytest.mark.parametrize("first", [0, 100, 200, 300])
def test_so_do_others_and_none_is_given_up(first: int) -> None:
    for seed in range(first, first + 100):
        solver, found, _, _ = tiny_problem(seed)
        assert found != status.UNSOLVED, seed
        if found in (status.OK, status.CANNOT_DESCEND, status.DESCENDS_FASTER, status.STATIONARY):
            assert solver.margin >= -1e-7, seed


@pytest.mark.long
def test_so_do_thousands() -> None:
    for first in range(400, 12_000, 100):
        test_so_do_others_and_none_is_given_up(first)
