"""Functions of the general problem: rate, norms and damping."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray
from stable_problems import M, N, by_quadprog, degenerate, generic, most_descent
from support.solvers.one_shot import descent_rate, lp_norm, qp12, stable_qp

from hoap3.protocol.errors import BadProblemError, InfeasibleError
from hoap3.remote_controller.controllers.qp12.lyapunov_descent_kernels import qp12_descent
from hoap3.remote_controller.solvers.base import status
from hoap3.remote_controller.solvers.lyapunov_qp import descent_rate_kernels
from hoap3.remote_controller.solvers.lyapunov_qp.descent_rate import FORMS
from hoap3.remote_controller.solvers.lyapunov_qp.lp_norm import LpNorm
from hoap3.remote_controller.solvers.lyapunov_qp.lp_norm_kernels import lp_norm_kernel
from hoap3.remote_controller.solvers.lyapunov_qp.stable_qp import QP, StableQp

Array = NDArray[np.float64]


class TestRates:
    """The largest share of Ψ, and answers with a given decrease."""

    def test_half_the_rate_that_highs_finds_is_reached(self) -> None:
        for each in generic(seed=9, count=40):
            most = most_descent(each)
            rest = {"A": each.A, "b": each.b, "lower": each.lower, "upper": each.upper}
            assert stable_qp(each.gradient, 2 * most, **rest).rho == pytest.approx(0.5, rel=1e-8)
            assert stable_qp(each.gradient, most / 2, **rest).rho == 1.0

    @pytest.mark.parametrize("tilt", [1e-7, 5e-7, 1e-6])
    def test_what_a_row_leaves_that_is_nearly_parallel_to_the_gradient(self, tilt: float) -> None:
        row, ends = [[-1.0, -1.0 - tilt]], [1.0, 0.6]
        found = stable_qp([1.0, 1.0], 1.0, A=row, b=[1e-5], lower=[-1.0, -0.6], upper=ends)
        assert found.rho == pytest.approx(1e-5 + 0.6 * tilt, rel=1e-7)

    def test_rho_at_its_ends(self) -> None:
        still = {"lower": [0.0, 0.0], "upper": [0.0, 0.0]}
        assert stable_qp([1.0, 2.0], 5.0).rho == 1.0  # unbounded but for ρ ≤ 1
        assert stable_qp([1.0, 2.0], 0.0, **still).rho == 1.0
        assert stable_qp([1.0, 2.0], 1.0, **still).status == status.STATIONARY
        assert stable_qp([0.0, 0.0], 0.0).rho == 1.0
        one = {"lower": [-1.0], "upper": [1.0]}
        assert stable_qp([1.0], 1.0, 3.0, **one).rho == pytest.approx(-2.0)
        assert stable_qp([1.0], 0.0, 3.0, **one).rho == -1e9
        apart = stable_qp([1.0], 1.0, A=[[1.0], [-1.0]], b=[-1.0, 0.0])
        assert apart.status == status.INFEASIBLE_CONSTRAINTS
        assert stable_qp([0.0], 0.0, 1.0).status == status.ZERO_GRADIENT
        assert stable_qp([1.0], -1.0).status == status.BAD_INPUT

    @pytest.mark.parametrize("share", [0.0, 1e-12, 1e-9, 1e-6])
    def test_a_decrease_of_zero_or_nearly_so_is_met(self, share: float) -> None:
        for seed in range(60):
            gradient = np.random.default_rng(seed).normal(size=3)
            wanted = share * float(np.linalg.norm(gradient))
            found = stable_qp(gradient, wanted, A=[[0.0, 0.0, -1.0]], b=[-0.1])
            assert found.u[2] >= 0.1 - 1e-12
            assert abs(gradient @ found.u + wanted) <= 1e-13 + 1e-8 * wanted
            assert found.rho == pytest.approx(1.0, abs=1e-6)
        along = stable_qp([1.0, 0.0], share, lower=[-1.0, 0.1], upper=[1.0, 1.0])
        np.testing.assert_allclose(along.u, [-share, 0.1], atol=1e-13)

    @pytest.mark.parametrize("share", [0.0, 1e-9, 1e-6, 1e-3])
    def test_the_one_point_with_the_largest_decrease_is_met_and_no_more(self, share: float) -> None:
        for seed in range(40):
            gradient = np.abs(np.random.default_rng(seed).normal(size=3))
            lower = (np.array([-0.1, 0.1, 0.0]) - share * np.array([1.0, 0.0, 0.0])) / gradient
            sides = {"lower": lower, "upper": lower + 1.0}
            np.testing.assert_allclose(stable_qp(gradient, share, **sides).u, lower, atol=1e-9)
            assert -stable_qp(gradient, share + 1e-7, **sides).rate < share + 0.5e-7

    def test_bad_input(self) -> None:
        assert stable_qp([1.0, 0.0], 1.0, A=[[1.0]], b=[1.0]).status == status.BAD_SHAPE
        assert stable_qp([1.0, math.nan], 1.0).status == status.BAD_INPUT


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


COUNT = 150


def solved(problem, ratio: float) -> StableQp:
    solver = StableQp(N, len(problem.b), gamma=problem.gamma, max_speed_ratio=ratio)
    solver.solve(*problem.arguments)
    return solver


@pytest.mark.parametrize("ratio", [0.5, 10.0])
@pytest.mark.slow
def test_it_is_the_optimum_for_the_fall_that_it_has(ratio):
    seen = 0
    for _, problem in degenerate(3, COUNT):
        damped = solved(problem, ratio)
        if damped.path != QP or damped.status != status.OK:
            continue
        seen += 1
        assert damped.kkt_residual <= 1e-8
        assert damped.margin >= -1e-9
        if not 1e-6 * problem.psi < -damped.rate:
            continue
        largest = solved(replace(problem, psi=-damped.rate), 0.0)
        np.testing.assert_allclose(damped.u, largest.u, rtol=0, atol=1e-6)
    assert seen > COUNT / 3


def test_it_never_asks_for_more_than_the_largest_and_for_as_much_where_it_is_cheap():
    equal = 0
    for _, problem in degenerate(4, COUNT):
        damped, largest = solved(problem, 10.0), solved(problem, 0.0)
        assert damped.status in (status.OK, status.STATIONARY), status.NAMES[damped.status]
        assert -1e-12 <= damped.rho <= largest.rho + 1e-7
        equal += damped.rho >= largest.rho - 1e-7
    assert equal > COUNT / 4
    for problem in generic(5, 30):
        assert solved(problem, 1e6).rho == pytest.approx(1.0, abs=1e-7)


def test_more_speed_never_means_less_fall():
    for _, problem in degenerate(6, 60):
        shares = [solved(problem, ratio).rho for ratio in (0.1, 1.0, 10.0, 100.0)]
        assert (np.diff(shares) >= -1e-9).all()


def test_it_is_continuous_where_the_largest_jumps():
    """A row that turns from beside −∇V on to it: the last bit of ρ is worth no speed."""
    gradient, bounds = np.array([1.0, 0.0]), np.array([1.0, 1.0])

    def answer(tilt: float, ratio: float) -> np.ndarray:
        A = np.array([[-math.cos(tilt), math.sin(tilt)]])
        solver = StableQp(2, 1, gamma=0.0, max_speed_ratio=ratio)
        solver.solve(gradient, 0.5, 0.0, A, np.array([0.0]), -bounds, bounds)
        return solver.u.copy()

    tilts = np.linspace(-0.02, 0.02, 41)
    damped = np.array([answer(tilt, 10.0) for tilt in tilts])
    largest = np.array([answer(tilt, 0.0) for tilt in tilts])
    assert np.abs(np.diff(damped[:, 1])).max() < 0.01
    assert np.abs(np.diff(largest[:, 1])).max() > 0.9


@pytest.mark.parametrize("objective", [1, 2, math.inf])
def test_other_norms_are_proved_too(objective):
    for _, problem in degenerate(7, 60):
        solver = StableQp(N, M, objective=objective, max_speed_ratio=10.0)
        if solver.solve(*problem.arguments) == status.OK:
            assert solver.kkt_residual <= 1e-8
            assert solver.margin >= -1e-9


@pytest.mark.parametrize("ratio", [0.0, 10.0])
def test_bounds_that_exclude_rest_give_the_optimum(ratio):
    """Bounds around a velocity, as acceleration limits give a moving robot, and no rows."""
    rng, answered = np.random.default_rng(8), 0
    for made in generic(9, COUNT):
        velocity = made.lower + (made.upper - made.lower) * rng.random(N)
        lower = np.maximum(velocity - 0.05, made.lower)
        upper = np.minimum(velocity + 0.05, made.upper)
        gradient = made.gradient * -np.sign(made.gradient @ velocity)
        problem = replace(
            made,
            gradient=gradient,
            psi=-float(gradient @ velocity) * rng.uniform(0.8, 1.2),
            A=np.zeros((0, N)),
            b=np.zeros(0),
            lower=lower,
            upper=upper,
        )
        solver = solved(problem, ratio)
        if solver.status not in (status.OK, status.DESCENDS_FASTER):
            continue
        assert solver.path == QP
        assert solver.kkt_residual <= 1e-8
        u = by_quadprog(problem, solver.rate)
        if u is not None:
            answered += 1
            np.testing.assert_allclose(solver.u, u, rtol=0, atol=1e-7)
    assert answered > COUNT / 2


gradients = arrays(
    np.float64, st.integers(1, 21), elements=st.floats(-10, 10).filter(lambda x: abs(x) > 1e-6)
)


@given(gradients, st.floats(1e-3, 10), st.floats(0, 1), st.sampled_from([0, 1, 2]))
def test_speeds_of_qp12_stay_below_u_max(
    gradient: Array, error: float, gamma: float, form: int
) -> None:
    u = qp12(gradient, descent_rate(FORMS[form], 0.0, gradient, error), gamma)
    reach = 2 / math.pi * math.atan(46.0 * error)
    loose = math.sqrt(gradient.size) if form == 1 else 1.0
    assert np.abs(u).max() <= 0.6 * reach * loose * (1 + 1e-12)


@given(gradients)
def test_order_of_the_three_scalings(gradient: Array) -> None:
    slow, none, sharp = (descent_rate(form, 0.0, gradient, 0.1) for form in FORMS[:3])
    assert slow <= sharp * (1 + 1e-12)
    assert sharp <= none * (1 + 1e-12)
    assert none == pytest.approx(slow * math.sqrt(gradient.size))


@pytest.mark.parametrize("form", [0, 1, 2])
def test_is_what_the_controllers_have(form: int) -> None:
    rng = np.random.default_rng(1)
    for _ in range(20):
        error, jacobian = rng.normal(size=3) * 0.02, rng.normal(size=(3, 21))
        gradient, u, certificate = np.zeros(21), np.zeros(21), np.zeros(6)
        qp12_descent(error, jacobian, 0.6, 46.0, form, 0.5, 0.0, gradient, u, certificate)
        psi = descent_rate(FORMS[form], certificate[0], gradient, float(np.linalg.norm(error)))
        assert psi == pytest.approx(-certificate[1], rel=1e-13)


@pytest.mark.parametrize("form", [form for form in FORMS if form != "exponential"])
def test_vanishes_with_the_gradient_and_no_slower(form: str) -> None:
    """Condition (4): Ψ/|∇V| stays bounded where V does not vanish."""
    ratios = []
    for size in (1e-3, 1e-150, 1e-300):
        gradient = np.array([1.0, -1.0]) * size
        ratios.append(descent_rate(form, 1.0, gradient, 1.0) / size)
    assert np.allclose(ratios, ratios[0], rtol=1e-3)
    assert descent_rate(form, 1.0, np.zeros(2), 1.0) == 0.0


def test_tanh_is_slower_than_any_exponential_near_the_target() -> None:
    """V' = −Ψ with ∇V = e: V falls like 1/t², the exponential form like exp(−t)."""
    left = {}
    for form in ("tanh", "exponential"):
        V = 0.5
        for _ in range(2000):
            V -= 2e-2 * descent_rate(form, V, np.array([math.sqrt(2 * V)]), 0.0)
        left[form] = V
    assert left["exponential"] < 1e-15
    assert left["tanh"] > 1e-7


def test_forms_of_kernel_and_class_agree() -> None:
    assert [getattr(descent_rate_kernels, form.upper()) for form in FORMS] == [0, 1, 2, 3, 4]


def test_bad_input_gives_no_number() -> None:
    one = np.ones(2)
    for V, gradient, error in (
        (-1.0, one, 0.0),
        (math.nan, one, 0.0),
        (0.0, one * math.inf, 0.0),
        (0.0, one, -0.1),
        (0.0, one, math.nan),
    ):
        assert math.isnan(descent_rate("inverse_sqrt_n", V, gradient, error))
    assert math.isnan(descent_rate("exponential", 1e300, one, 0.0, eta=1e300))


numbers = st.one_of(st.floats(1e-9, 100), st.floats(-100, -1e-9), st.just(0.0))


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
    assert LpNorm(2, 2.0).solve(np.ones(2), math.nan, 0.0) == status.BAD_INPUT
