"""The pseudo-inverse with its task, and OSQP on the program of QP12."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from support.oracles import qp12_oracle as reference
from support.solvers.one_shot import pinv, pinv_plain, qp12

from hoap3.protocol.errors import BadProblemError, InfeasibleError
from hoap3.remote_controller.solvers import Pinv
from hoap3.remote_controller.solvers.qp12.osqp_qp12 import OsqpQp12
from hoap3.remote_controller.solvers.qp12.qp12_kernels import qp12_kkt_residual

rng = np.random.default_rng(0)


def with_singular_values(m: int, n: int, sigma: list[float]) -> NDArray[np.float64]:
    """A random matrix with these singular values and zeros after them."""
    k = len(sigma)
    U = np.linalg.qr(rng.normal(size=(m, m)))[0][:, :k]
    V = np.linalg.qr(rng.normal(size=(n, n)))[0][:, :k]
    return np.ascontiguousarray(U * sigma @ V.T)


def direction(J: NDArray[np.float64], e: NDArray[np.float64]) -> NDArray[np.float64]:
    return reference.pinv_plain(J, e, -1.0)


def assert_close(u: NDArray[np.float64], expected: NDArray[np.float64], tolerance: float) -> None:
    np.testing.assert_allclose(u, expected, rtol=0, atol=tolerance * np.max(np.abs(expected)))


@pytest.mark.parametrize("rank", [1, 2, 3, 4, 5, 6])
def test_rank_deficiency_is_seen_and_left_out(rank: int) -> None:
    solver, u = Pinv(6, 21), np.empty(21)
    for _ in range(50):
        J, e = with_singular_values(6, 21, [1.0 + i for i in range(rank)]), rng.normal(size=6)
        solver.solve_plain(J, e, 1.0, u)
        assert solver.rank == rank
        assert_close(u, -direction(J, e), 2e-13)


@pytest.mark.parametrize("row", [np.zeros(7), np.ones(7), np.arange(7.0)])
def test_zero_equal_and_proportional_rows(row: NDArray[np.float64]) -> None:
    J, e = np.array([np.ones(7), row, -3 * row]), np.array([1.0, 2.0, 3.0])
    assert_close(pinv_plain(J, e, 1.0), -direction(J, e), 1e-13)


@pytest.mark.parametrize("exponent", range(-11, 1))
def test_small_singular_values_above_the_tolerance_count(exponent: int) -> None:
    """Without squaring J: in the normal equations 1e-11 would drown in the rounding of 1."""
    solver, u = Pinv(3, 21), np.empty(21)
    J = with_singular_values(3, 21, [1.0, 0.5, 10.0**exponent])
    e = rng.normal(size=3)
    solver.solve_plain(J, e, 1.0, u)
    assert solver.rank == 3
    assert_close(u, -direction(J, e), 1e-15 * 10.0**-exponent + 1e-13)


def test_singular_values_below_the_tolerance_do_not() -> None:
    solver, u = Pinv(3, 21), np.empty(21)
    J, e = with_singular_values(3, 21, [1.0, 0.5, 1e-13]), rng.normal(size=3)
    solver.solve_plain(J, e, 1.0, u)
    assert solver.rank == 2
    assert_close(u, -direction(J, e), 1e-13)
    assert np.max(np.abs(u)) < 10 * np.linalg.norm(e)


def test_rows_of_unlike_units_keep_full_accuracy() -> None:
    """Row scaling is no ill-conditioning: millimetres beside radians."""
    solver, u = Pinv(3, 21), np.empty(21)
    even = with_singular_values(3, 21, [1.0, 0.8, 0.6])
    for scale in (1e-3, 1e-5, 1e-8, 1e-11):
        units = np.array([1.0, scale, 1.0])
        solver.solve_plain(even * units[:, None], units, 1.0, u)
        assert solver.rank == 3
        assert_close(u, -direction(even, np.ones(3)), 1e-14)


@pytest.mark.parametrize("scale_e", [1e-300, 1e-160, 1.0, 1e160, 1e300])
@pytest.mark.parametrize("scale_j", [1e-160, 1e-5, 1.0, 1e5, 1e160])
@pytest.mark.parametrize("rank", [2, 3])
def test_every_scale(scale_j: float, scale_e: float, rank: int) -> None:
    J, e = with_singular_values(3, 7, [1.0, 0.7, 0.4][:rank]), rng.normal(size=3)
    w = direction(J, e)
    gain = 1e-200 if scale_e / scale_j > 1e200 else 1.0
    if scale_j / scale_e > 1e200:
        gain = 1e200
    expected = -w * (scale_e * (gain / scale_j))
    assert_close(pinv_plain(J * scale_j, e * scale_e, gain), expected, 1e-13)
    decrease = 0.3 * scale_e
    expected = -w * (0.3 / scale_j) / (e @ J @ w)
    assert_close(pinv(J * scale_j, e * scale_e, decrease), expected, 1e-13)


def test_subnormal_jacobian_loses_only_the_digits_it_has_lost() -> None:
    J = np.array([[3.0, 4.0], [0.0, 0.0]]) * 5e-324
    np.testing.assert_allclose(pinv(J, [1.0, 0.0], 5e-324), [-3 / 25, -4 / 25], rtol=1e-15)


def test_both_ways_agree_where_they_meet() -> None:
    """Rows at an angle around the limit of the Cholesky factorisation."""
    for angle in np.geomspace(0.02, 0.05, 40):
        J = np.zeros((2, 5))
        J[0, 0], J[1, 0], J[1, 1] = 1.0, np.cos(angle), np.sin(angle)
        e = np.array([1.0, -1.0])
        assert_close(pinv_plain(J, e, 1.0), -direction(J, e), 1e-12)


@pytest.mark.parametrize(
    ("J", "e"),
    [
        (np.eye(3, 5), np.zeros(3)),
        (np.zeros((3, 5)), np.ones(3)),
        (np.diag([1.0, 0.0]), np.array([0.0, 1.0])),
        (np.ones((2, 4)), np.array([1.0, -1.0])),
        (with_singular_values(6, 21, [3.0, 2.0]), None),
        (np.zeros((0, 3)), np.zeros(0)),
    ],
)
def test_no_effect_on_the_error_is_infeasible_unless_nothing_is_asked(
    J: NDArray[np.float64], e: NDArray[np.float64] | None
) -> None:
    if e is None:  # orthogonal to the range of J but for rounding
        e = np.linalg.svd(J)[0][:, -1]
    with pytest.raises(InfeasibleError):
        pinv(J, e, 0.1)
    np.testing.assert_array_equal(pinv(J, e, 0.0), np.zeros(J.shape[1]))
    assert np.max(np.abs(pinv_plain(J, e, 1.0))) < 1e-12


def test_zeros_are_positive() -> None:
    for u in (pinv(np.eye(2, 3), [1.0, 0.0], 0.0), pinv_plain(np.eye(2, 3), [1.0, 0.0], -0.0)):
        assert not np.any(u)
        assert not np.any(np.signbit(u))


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_values_that_are_not_finite_are_refused_and_leave_zeros(bad: float) -> None:
    J, e = np.eye(2, 3), np.ones(2)
    spoilt_j, spoilt_e = J.copy(), e.copy()
    spoilt_j[1, 2], spoilt_e[1] = bad, bad
    solver = Pinv(2, 3)
    for solve in (solver.solve, solver.solve_plain):
        for jacobian, error, factor in ((spoilt_j, e, 1.0), (J, spoilt_e, 0.0), (J, e, bad)):
            out = np.full(3, 7.0)
            with pytest.raises(BadProblemError):
                solve(jacobian, error, factor, out)
            np.testing.assert_array_equal(out, np.zeros(3))


def test_an_answer_beyond_the_range_is_an_error_not_infinity() -> None:
    solver = Pinv(2, 3)
    for solve in (solver.solve, solver.solve_plain):
        out = np.full(3, 7.0)
        with pytest.raises(BadProblemError):
            solve(np.eye(2, 3) * 1e-200, np.ones(2), 1e200, out)
        np.testing.assert_array_equal(out, np.zeros(3))


def test_wrong_shapes_and_types_are_refused() -> None:
    J, e, u = np.eye(2, 3), np.ones(2), np.full(3, 7.0)
    solver = Pinv(2, 3)
    for solve in (solver.solve, solver.solve_plain):
        for jacobian, error, out in (
            (np.eye(3, 3), e, u),
            (np.eye(2, 4), e, u),
            (J, np.ones(3), u),
            (J, e, np.full(2, 7.0)),
        ):
            with pytest.raises(BadProblemError, match=r"\(2, 3\), \(2,\) and \(3,\)"):
                solve(jacobian, error, 1.0, out)
            assert np.all(out == 7.0)
        with pytest.raises(BadProblemError):
            solve(np.asfortranarray(J), e, 1.0, u)


def test_the_work_array_remembers_nothing() -> None:
    solver, first, again = Pinv(3, 21), np.empty(21), np.empty(21)
    problems = [
        (with_singular_values(3, 21, [1.0, 0.5, 0.2][:rank]), rng.normal(size=3))
        for rank in (3, 2, 1, 3, 2)
    ]
    alone = []
    for J, e in problems:
        Pinv(3, 21).solve(J, e, 0.1, first)
        alone.append(first.copy())
    for (J, e), expected in zip(problems, alone, strict=True):
        solver.solve(J, e, 0.1, again)
        np.testing.assert_array_equal(again, expected)


def test_a_row_too_short_to_matter_is_left_out() -> None:
    """However well it stands apart from the others."""
    solver, u = Pinv(2, 3), np.empty(3)
    for length, rank in ((1e-11, 2), (1e-13, 1)):
        solver.solve_plain(np.array([[1.0, 0.0, 0.0], [0.0, length, 0.0]]), np.ones(2), 1.0, u)
        assert solver.rank == rank
        np.testing.assert_allclose(u, [-1.0, -1 / length if rank == 2 else 0.0, 0.0], rtol=1e-15)


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
    with pytest.raises(BadProblemError):
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
