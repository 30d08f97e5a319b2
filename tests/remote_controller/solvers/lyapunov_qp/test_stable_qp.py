"""The general problem: single answers, and many random ones."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from stable_problems import (
    M,
    N,
    Problem,
    by_quadprog,
    degenerate,
    generic,
    kkt_residual,
    most_descent,
)

from hoap3.protocol.errors import BadProblemError
from hoap3.remote_controller.solvers.base import status
from hoap3.remote_controller.solvers.lyapunov_qp.stable_qp import (
    CLAMPED,
    FREE,
    QP,
    STILL,
    StableQp,
)

Array = NDArray[np.float64]


def problem(
    gradient: list[float], rows: list[list[float]], sides: list[float], limit: float = 1.0
) -> tuple[Array, Array, Array, Array, Array]:
    """∇V, A, b, lower, upper."""
    n = len(gradient)
    A = np.array(rows, dtype=float).reshape(len(sides), n)
    return np.array(gradient), A, np.array(sides), np.full(n, -limit), np.full(n, limit)


def solved(given: tuple[Array, ...], psi: float, drift: float = 0.0, **options: object) -> StableQp:
    gradient, A, *rest = given
    solver = StableQp(gradient.size, A.shape[0], **options)  # type: ignore[arg-type]
    solver.solve(gradient, psi, drift, A, *rest)
    assert np.all(np.isfinite(solver.u))
    assert not any(math.isnan(x) for x in (solver.rho, solver.rate, solver.kkt_residual))
    return solver


class TestPaths:
    """Cheapest first, and each is the optimum."""

    given_2 = ([2.0, -1.0], [[1.0, 1.0]], [0.5])

    def test_free(self) -> None:
        s = solved(problem(*self.given_2), 0.5, objective=2)
        assert (s.status, s.path, s.rho) == (status.OK, FREE, 1.0)
        np.testing.assert_allclose(s.u, [-0.2, 0.1], rtol=1e-14)
        assert s.rate == pytest.approx(-0.5)
        assert s.margin == pytest.approx(0.6)
        assert s.kkt_residual < 1e-15

    def test_clamped(self) -> None:
        s = solved(problem(*self.given_2, limit=0.15), 0.4, objective=2)
        assert (s.status, s.path, s.rho) == (status.OK, CLAMPED, 1.0)
        np.testing.assert_allclose(s.u, [-0.15, 0.1], rtol=1e-14)
        assert s.margin == 0.0

    def test_clamped_with_the_rho_that_the_bounds_allow(self) -> None:
        s = solved(problem(*self.given_2, limit=0.1), 0.6, objective=2)
        assert (s.status, s.path) == (status.OK, CLAMPED)
        assert s.rho == pytest.approx(0.5)
        np.testing.assert_allclose(s.u, [-0.1, 0.1])

    def test_a_row_that_matters(self) -> None:
        s = solved(problem([1.0, 1.0], [[-1.0, 0.0]], [0.1]), 0.5, objective=2)
        assert (s.status, s.path, s.rho) == (status.OK, QP, 1.0)
        np.testing.assert_allclose(s.u, [-0.1, -0.4], atol=1e-12)
        assert s.kkt_residual < 1e-10
        assert abs(s.margin) < 1e-12

    def test_rows_that_leave_less_than_psi(self) -> None:
        s = solved(problem([1.0, 1.0], [[-1.0, -1.0]], [0.25]), 0.5, objective=2)
        assert (s.status, s.path) == (status.OK, QP)
        assert s.rho == pytest.approx(0.5, rel=1e-6)
        assert s.rho <= 0.5
        np.testing.assert_allclose(s.u, [-0.125, -0.125], atol=1e-8)

    def test_a_row_is_switched_off_by_infinity_whatever_stands_in_it(self) -> None:
        gradient, A, b, lower, upper = problem([1.0, 1.0], [[-1.0, 0.0], [0.0, 0.0]], [0.1, 0.0])
        A[0], b[0] = math.nan, math.inf
        s = solved((gradient, A, b, lower, upper), 0.5, objective=2)
        assert (s.status, s.path) == (status.OK, FREE)
        forced = solved((gradient, A, b, lower + 1.1, upper), 0.5, objective=2)
        assert forced.path == QP  # u = 0 is not within the bounds
        assert forced.status == status.CANNOT_DESCEND

    def test_equations(self) -> None:
        gradient, A, b, lower, upper = problem([1.0, 1.0, 0.0], [], [])
        s = StableQp(3, 0, 1, objective=2)
        s.solve(gradient, 0.5, 0.0, A, b, lower, upper, np.array([[1.0, 0.0, -1.0]]), np.zeros(1))
        assert (s.status, s.path) == (status.OK, QP)
        assert s.u[0] == pytest.approx(s.u[2])
        np.testing.assert_allclose(s.u, np.array([-1, -2, -1]) / 6, atol=1e-12)


COST: dict[object, Callable[[Array], Array]] = {
    1: lambda u: np.abs(u).sum(-1) + 0.5e-6 * (u * u).sum(-1),
    2: lambda u: 0.5 * (u * u).sum(-1),
    math.inf: lambda u: np.abs(u).max(-1) + 0.5e-6 * (u * u).sum(-1),
    "qp12": lambda u: 0.5 * np.abs(u).sum(-1) + 0.25 * (u * u).sum(-1),
}


class TestObjectives:
    """Each is least among everything nearby that is feasible."""

    @pytest.mark.parametrize("objective", [1, 2, math.inf, "qp12"])
    def test_no_neighbour_is_better(self, objective: str | float) -> None:
        cost = COST[objective]
        rng = np.random.default_rng(1)
        compared = 0
        for each in generic(seed=2, count=30, n=4, m=2):
            s = StableQp(4, 2, objective=objective)
            assert s.solve(*each.arguments) == status.OK
            assert s.kkt_residual <= 1e-8
            assert s.margin >= -1e-9
            steps = rng.normal(size=(3000, 4)) * 10.0 ** rng.uniform(-4, 0, (3000, 1))
            steps -= np.outer(steps @ each.gradient, each.gradient) / (
                each.gradient @ each.gradient
            )
            others = s.u + steps
            fine = np.all(others @ each.A.T <= each.b, 1)
            fine &= np.all((others >= each.lower) & (others <= each.upper), 1)
            assert np.all(cost(others[fine]) >= cost(s.u) - 1e-10)
            compared += fine.sum()
        assert compared > 1000

    @pytest.mark.parametrize("objective", [1, 2, math.inf, "qp12"])
    def test_weights_are_a_change_of_units(self, objective: str | float) -> None:
        w = np.array([0.5, 2.0, 1.0, 3.0])
        for each in generic(seed=3, count=20, n=4, m=2):
            weighted = StableQp(4, 2, objective=objective, weights=w)
            plain = StableQp(4, 2, objective=objective)
            weighted.solve(*each.arguments)
            plain.solve(
                each.gradient / w, each.psi, 0.0, each.A / w, each.b, each.lower * w, each.upper * w
            )
            np.testing.assert_allclose(weighted.u * w, plain.u, atol=1e-8)
            assert weighted.kkt_residual <= 1e-8

    def test_least_squares(self) -> None:
        given = problem([1.0, 0.0], [[0.0, 1.0]], [0.3])
        s = StableQp(2, 1, objective="least_squares")
        s.solve(given[0], 0.2, 0.0, *given[1:], M=np.eye(2), y=np.array([0.5, 0.5]))
        assert (s.status, s.path) == (status.OK, QP)
        np.testing.assert_allclose(s.u, [-0.2, 0.3], atol=1e-9)
        assert s.kkt_residual < 1e-9

    def test_remark_1_follows_a_wish_that_lowers_v_and_refuses_one_that_does_not(self) -> None:
        given = problem([1.0, 0.0], [[0.0, 1.0]], [0.3])
        s = StableQp(2, 1, objective="least_squares", lyapunov="descent")
        s.solve(given[0], 0.0, 0.0, *given[1:], M=np.eye(2), y=np.array([-0.5, 0.1]))
        np.testing.assert_allclose(s.u, [-0.5, 0.1], atol=1e-6)
        s.solve(given[0], 0.0, 0.0, *given[1:], M=np.eye(2), y=np.array([0.5, 0.1]))
        np.testing.assert_allclose(s.u, [0.0, 0.1], atol=1e-6)
        assert s.status == status.OK
        assert s.kkt_residual < 1e-9
        s.solve(given[0], 0.0, 5.0, *given[1:], M=np.eye(2), y=np.array([0.5, 0.1]))
        assert s.status == status.CANNOT_DESCEND
        np.testing.assert_allclose(s.u, [-1.0, 0.1], atol=1e-6)

    def test_refusals(self) -> None:
        for wrong in (3, 1.5, 0.5, "l1", None):
            with pytest.raises(BadProblemError, match="1, 2 or inf"):
                StableQp(3, objective=wrong)  # type: ignore[arg-type]


class TestWhatCannotBeDone:
    """Statuses, and what u is then."""

    def test_stationary(self) -> None:
        s = solved(problem([1.0, 1.0], [[-1.0, -1.0]], [0.0]), 0.5)
        assert (s.status, s.path, s.rho) == (status.STATIONARY, STILL, 0.0)
        np.testing.assert_array_equal(s.u, 0.0)
        assert s.kkt_residual <= 1e-12  # proved by the dual of the LP
        locked = solved(problem([1.0, 1.0], [], [], limit=0.0), 0.5)
        assert (locked.status, locked.rho) == (status.STATIONARY, 0.0)

    def test_stationary_is_proved_and_not_believed(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """An LP solver that says that V cannot fall where it can is not taken at its word."""
        solver = StableQp(2, 1)
        gradient, *rest = problem([1.0, 0.5], [[-1.0, 0.0]], [0.1])
        solve = solver._steepest._solve

        def idle(*given: Any, **options: Any) -> Any:
            x, value, flag, info = solve(*given, **options)
            return 0.0 * x, value, flag, info | {"lam": 0.0 * info["lam"]}

        monkeypatch.setattr(solver._steepest, "_solve", idle)
        monkeypatch.setattr(solver._program, "run", lambda *_, **__: False)
        solver.solve(gradient, 9.0, 0.0, *rest)
        assert solver.status == status.STATIONARY
        assert solver.kkt_residual > 0.1

    def test_flat(self) -> None:
        given = problem([0.0, 0.0], [[1.0, 0.0]], [0.1])
        s = solved(given, 0.0, drift=0.3)
        assert (s.status, s.path, s.rate) == (status.ZERO_GRADIENT, STILL, 0.3)
        np.testing.assert_array_equal(s.u, 0.0)
        moved = solved(problem([0.0, 0.0], [[1.0, 0.0]], [-0.1]), 0.0, drift=0.3)
        assert moved.status == status.ZERO_GRADIENT
        np.testing.assert_allclose(moved.u, [-0.1, 0.0], atol=1e-9)
        at_rest = solved(given, 0.0)
        assert (at_rest.status, at_rest.rho) == (status.OK, 1.0)

    @pytest.mark.parametrize("gradient", [[1.0, 1.0], [0.0, 0.0]])
    def test_contradictory(self, gradient: list[float]) -> None:
        s = solved(problem(gradient, [[1.0, 0.0], [-1.0, 0.0]], [-0.5, 0.2]), 0.5)
        assert (s.status, s.path) == (status.INFEASIBLE_CONSTRAINTS, STILL)
        np.testing.assert_array_equal(s.u, 0.0)
        assert s.margin == pytest.approx(-0.5)
        assert s.kkt_residual == math.inf
        empty = solved(problem(gradient, [[0.0, 0.0]], [-1.0]), 0.5)
        assert empty.status == status.INFEASIBLE_CONSTRAINTS

    def test_behind_a_target_that_is_too_fast(self) -> None:
        s = solved(problem([1.0, -1.0], [[0.0, 1.0]], [0.5]), 1.0, drift=4.0)
        assert s.status == status.CANNOT_DESCEND
        assert s.rho == pytest.approx(-2.5, rel=1e-6)
        assert s.rate == pytest.approx(2.5, rel=1e-6)
        np.testing.assert_allclose(s.u, [-1.0, 0.5], atol=1e-6)

    def test_ahead_of_what_is_asked(self) -> None:
        s = solved(problem([1.0, -1.0], [[1.0, 0.0]], [0.5]), 1.0, drift=-4.0)
        assert s.status == status.DESCENDS_FASTER
        assert s.rho == pytest.approx(2.5, rel=1e-6)
        np.testing.assert_allclose(s.u, [0.5, -1.0], atol=1e-6)

    def test_unbounded(self) -> None:
        """More than any u of a sensible size, and nothing in its way but a row that looks away."""
        given = problem([1e-200, 0.0], [[0.0, 1.0]], [-1.0], limit=math.inf)
        s = solved(given, 1e80)
        assert (s.status, s.path) == (status.UNBOUNDED, STILL)
        np.testing.assert_array_equal(s.u, 0.0)

    def test_a_row_that_forces_v_to_rise(self) -> None:
        s = solved(problem([1.0, 0.0], [[-1.0, 0.0]], [-0.3]), 1.0)
        assert s.status == status.CANNOT_DESCEND
        assert s.rho == pytest.approx(-0.3, rel=1e-6)
        np.testing.assert_allclose(s.u, [0.3, 0.0], atol=1e-8)

    @pytest.mark.parametrize("where", ["gradient", "A", "b", "lower", "upper", "psi", "drift"])
    @pytest.mark.parametrize("value", [math.nan, -math.inf])
    def test_bad_numbers(self, where: str, value: float) -> None:
        if (where, value) == ("lower", -math.inf):
            return
        names = ("gradient", "A", "b", "lower", "upper")
        given = dict(zip(names, problem([1.0, -1.0], [[0.0, 1.0]], [0.5]), strict=True))
        numbers = {"psi": 1.0, "drift": 0.0}
        if where in numbers:
            numbers[where] = value
        else:
            given[where].flat[0] = value
        s = StableQp(2, 1)
        s.u[:] = 7.0
        rest = [given[name] for name in names[1:]]
        found = s.solve(given["gradient"], numbers["psi"], numbers["drift"], *rest)
        assert found == s.status == status.BAD_INPUT
        np.testing.assert_array_equal(s.u, 0.0)
        assert s.kkt_residual == math.inf
        assert (s.rate, s.margin) == (0.0, -math.inf)

    def test_wrong_shapes_and_types(self) -> None:
        gradient, A, b, lower, upper = problem([1.0, -1.0], [[0.0, 1.0]], [0.5])
        s = StableQp(2, 1)
        assert s.solve(gradient, 1.0, 0.0, A, b[:0], lower, upper) == status.BAD_SHAPE
        assert s.solve(gradient, 1.0, 0.0, A[:, :1].copy(), b, lower, upper) == status.BAD_SHAPE
        assert s.solve(np.ones(3), 1.0, 0.0, A, b, lower, upper) == status.BAD_SHAPE
        assert StableQp(2, 1, 1).solve(gradient, 1.0, 0.0, A, b, lower, upper) == status.BAD_SHAPE
        with pytest.raises(BadProblemError, match="float64"):
            s.solve(gradient, 1.0, 0.0, A.astype(int), b, lower, upper)
        fit = StableQp(2, 1, objective="least_squares")
        assert fit.solve(gradient, 1.0, 0.0, A, b, lower, upper) == status.BAD_INPUT


def test_the_first_limited_answer_and_the_next_have_the_same_bits() -> None:
    """After a limited problem the LP comes first: that saves a QP, and changes nothing else."""
    s = StableQp(N, M)
    for each in generic(seed=11, count=30):
        limited = (each.gradient, 4 * most_descent(each), *each.arguments[2:])
        s.solve(*limited)
        first = (s.u.copy(), s.rho, s.kkt_residual)
        s.solve(*limited)
        np.testing.assert_array_equal(s.u, first[0])
        assert (s.rho, s.kkt_residual) == first[1:]
        assert s.rho == pytest.approx(0.25, rel=1e-8)
        s.solve(*each.arguments)
        once = s.u.copy()
        s.solve(*each.arguments)
        np.testing.assert_array_equal(s.u, once)


def test_the_same_problem_gives_the_same_bits_whatever_came_before() -> None:
    s, fresh = StableQp(N, M), {}
    for seed in (1, 2):
        for index, each in enumerate(generic(seed=7, count=30)):
            s.solve(*each.arguments)
            assert np.array_equal(fresh.setdefault(index, s.u.copy()), s.u)
        for other in generic(seed=seed, count=10):
            s.solve(*other.arguments)


SOLVER = {gamma: StableQp(N, M, gamma=gamma) for gamma in (0.0, 0.1, 0.5, 0.9, 0.99)}


def fault(problem: Problem) -> str:
    """What is wrong with our answer, "" if nothing."""
    solver = SOLVER[problem.gamma]
    if solver.solve(*problem.arguments) != status.OK:
        return status.NAMES[solver.status]
    rate = float(problem.gradient @ solver.u)
    promised = -solver.rho * problem.psi
    violation = max(-solver.margin, abs(rate - promised) / problem.top)
    if not violation <= 1e-9:
        return f"violation {violation}"
    if not solver.kkt_residual <= 1e-8:
        return f"own residual {solver.kkt_residual}"
    reference = by_quadprog(problem, promised)
    if reference is not None and np.abs(reference - solver.u).max() <= 1e-6:
        return ""
    residual = kkt_residual(problem, solver.u, promised)
    return "" if residual <= 1e-8 else f"residual {residual}"


def faults_of_generic(seed: int, count: int) -> list[str]:
    found = []
    for problem in generic(seed, count):
        wrong = fault(problem)
        rho = SOLVER[problem.gamma].rho
        found += [wrong] * bool(wrong) + [f"ρ {rho}"] * (not wrong and rho < 1 - 1e-8)
    return found


def faults_of_degenerate(seed: int, count: int) -> list[str]:
    found = []
    for kind, problem in degenerate(seed, count):
        wrong = fault(problem)
        best = min(1.0, most_descent(problem) / problem.psi)
        if not wrong and not -1e-8 <= best - SOLVER[problem.gamma].rho <= 1e-6:
            wrong = f"ρ {SOLVER[problem.gamma].rho} of {best}"
        found += [f"{kind}: {wrong}"] * bool(wrong)
    return found


def test_a_few_hundred_random_problems() -> None:
    assert faults_of_generic(seed=1, count=300) == []


def test_a_few_hundred_degenerate_problems() -> None:
    assert faults_of_degenerate(seed=2, count=150) == []


@pytest.mark.long
def test_five_thousand_random_problems() -> None:
    assert faults_of_generic(seed=3, count=5000) == []


@pytest.mark.long
def test_three_thousand_degenerate_problems() -> None:
    assert faults_of_degenerate(seed=4, count=3000) == []


def test_both_judges_see_a_wrong_answer() -> None:
    wrong = {
        "scaled": lambda u: u * 1.001,
        "another joint": lambda u: u + 1e-4 * np.eye(N)[0],
        "still": lambda u: u * 0.0,
    }
    for problem in generic(seed=5, count=20):
        solver = SOLVER[problem.gamma]
        solver.solve(*problem.arguments)
        reference = by_quadprog(problem, -problem.psi)
        assert reference is not None
        for spoil in wrong.values():
            spoilt = spoil(solver.u)
            assert np.abs(reference - spoilt).max() > 1e-6
            assert kkt_residual(problem, spoilt, -problem.psi) > 1e-8


def test_cheap_and_general_way_agree() -> None:
    """A row that never matters forces nothing; an equation of zeros forces the QP."""
    general = StableQp(N, M, 1, gamma=0.5)
    compared = 0
    for problem in generic(seed=6, count=150):
        cheap = SOLVER[0.5]
        cheap.solve(*problem.arguments)
        if cheap.path == QP:
            continue
        general.solve(*problem.arguments, np.zeros((1, N)), np.zeros(1))
        assert general.path == QP
        assert general.rho == cheap.rho == 1.0
        np.testing.assert_allclose(general.u, cheap.u, atol=1e-10)
        compared += 1
        assert cheap.path >= FREE
    assert compared > 20
