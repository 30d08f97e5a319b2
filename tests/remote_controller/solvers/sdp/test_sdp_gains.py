"""The gains against a polished reference, their certificate recomputed, and what they must keep."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sdp_problems import Problem, humanoid, optimum, random, ur5
from support.solvers.one_shot import sdp_gains

from hoap3.protocol.errors import BadProblemError
from hoap3.remote_controller.solvers.base import status
from hoap3.remote_controller.solvers.clik.clik_reference import certified, prioritised
from hoap3.remote_controller.solvers.sdp.sdp_gains import BUDGET, IPM, NONE, WARM, SdpGains

SEEDS = st.integers(0, 10**6)
NO_STABILISING_GAINS = (
    [[[-2.0, 1, 1, -3]], [[1.0, 0, 3, -1], [-1.0, 1, 3, -3]]],
    [[1.0], [1.0, 1.0]],
)


def check(it: Problem, solver: SdpGains) -> None:
    """Everything that the solver says of its answer, recomputed from its gains."""
    L, S = it.matrices()
    size = 1 + np.abs(L).max() * np.abs(solver.gains).max()
    assert abs(solver.beta - certified(L, solver.gains, it.dt)) < 1e-9 * size * it.desired
    assert 0 <= solver.beta <= 1 / it.dt * (1 + 1e-9)
    assert np.all(solver.dq <= it.upper)
    assert np.all(solver.dq >= it.lower)
    np.testing.assert_allclose(S @ solver.gains, solver.dq, atol=2e-8 * (1 + abs(solver.dq).max()))
    reach = np.concatenate([it.upper - solver.dq, solver.dq - it.lower])
    assert solver.margin == pytest.approx(reach.min(), abs=1e-9)
    assert solver.status in (status.OK, status.STATIONARY, status.UNSOLVED, status.ITERATION_LIMIT)
    assert (solver.path == NONE) == (solver.status == status.STATIONARY)
    if solver.status == status.OK:
        assert solver.gap <= 1e-9 * it.desired**2
        assert solver.path in (WARM, IPM)
    if solver.path == NONE:
        assert solver.beta == 0
        assert not solver.gains.any()


def compare(problems, tolerance: float = 1e-6) -> tuple[int, int]:
    """How many agree with their reference, of how many that have one."""
    agree = known = 0
    for it in problems:
        gains, beta, proved = optimum(it)
        solver = it.solved()
        if not proved or beta < 1e-6 * it.desired:
            continue
        known += 1
        away = np.abs(gains - solver.gains).max() / (1 + np.abs(gains).max())
        agree += away <= tolerance and abs(beta - solver.beta) <= 1e-6
    return agree, known


@pytest.mark.slow
class TestOptimal:
    """β and λ within 1e-6 of the reference, λ relative to 1 + |λ|."""

    def test_ur5_states(self):
        assert compare(map(ur5, range(50))) == (50, 50)

    def test_humanoid_states(self):
        agree, known = compare(map(humanoid, range(20)))
        assert agree == known >= 18

    def test_random_ones_with_asymmetric_limits(self):
        agree, known = compare(map(random, range(120)))
        assert agree == known >= 100

    def test_tasks_that_do_not_touch_each_other(self):
        agree, known = compare(random(seed, "decoupled") for seed in range(30))
        assert agree == known >= 15

    def test_tasks_that_nearly_depend_on_each_other(self):
        agree, known = compare((random(seed, "dependent") for seed in range(100)), 2e-5)
        assert agree == known >= 20

    @pytest.mark.parametrize("weights", [(1.0, 0.09), (1.0, 1e-2)])
    def test_weighted(self, weights):
        problems = [ur5(seed) for seed in range(10)]
        for it in problems:
            it.weights = np.repeat(weights, it.sizes)
        assert compare(problems) == (10, 10)


def from_one_to_the_next(count: int, seeds: int) -> int:
    """Check random problems, each followed by one that is slightly displaced; how many."""
    checked = 0
    for seed in range(seeds):
        it = random(seed, ("", "", "decoupled", "dependent")[seed % 4])
        solver, rng = it.solver(), np.random.default_rng(seed)
        for _ in range(count):
            solver.solve(it.J, it.e, it.dt, it.desired, it.delta)
            check(it, solver)
            it.J = it.J * (1 + 1e-3 * rng.normal(size=it.J.shape))
            it.e = it.e * (1 + 1e-2 * rng.normal(size=it.e.size))
            checked += 1
    return checked


def test_every_answer_is_certified_or_says_that_it_is_not():
    assert from_one_to_the_next(3, 200) == 600


@pytest.mark.long
def test_every_answer_of_many_is_certified_or_says_that_it_is_not():
    assert from_one_to_the_next(4, 3000) == 12_000


class TestProperties:
    @given(st.integers(1, 5), st.floats(0.5, 20), st.floats(1e-4, 0.04))
    def test_one_task_has_a_closed_form(self, n, desired, dt):
        J = np.random.default_rng(n).normal(size=(n, n + 2))
        whole = np.full(n + 2, np.inf)
        solver = Problem((n,), J, np.ones(n), dt, desired, -whole, whole, 1e-9).solved()
        closed = (1 - np.sqrt(1 - solver.beta * dt)) / dt
        np.testing.assert_allclose(solver.gains, closed, rtol=1e-6)
        assert solver.beta == pytest.approx(desired, rel=1e-5)

    @given(SEEDS)
    def test_v_falls_as_certified_in_the_linear_model(self, seed):
        it = random(seed)
        solver = it.solved()
        L, _ = it.matrices()
        for e in np.random.default_rng(seed).normal(size=(20, it.e.size)):
            after = e - it.dt * L @ (solver.gains * e)
            assert after @ after <= (1 - solver.beta * it.dt) * (e @ e) * (1 + 1e-9) + 1e-12

    @given(SEEDS)
    def test_the_same_twice_gives_the_same_bits(self, seed):
        it = random(seed)
        solver = it.solver()
        first = (solver.solve(it.J, it.e, it.dt, it.desired), solver.beta, *solver.gains)
        solver.forget()
        assert first == (solver.solve(it.J, it.e, it.dt, it.desired), solver.beta, *solver.gains)


class TestSpecial:
    def test_no_gains_stabilise(self):
        jacobians, errors = NO_STABILISING_GAINS
        solver = SdpGains((1, 2), 4)
        assert solver.solve(np.vstack(jacobians), np.ones(3), 0.01, 8.0) == status.STATIONARY
        assert (solver.path, solver.beta, solver.task_rank) == (NONE, 0.0, 3)
        assert not solver.gains.any()
        assert not solver.dq.any()
        found = sdp_gains(jacobians, errors, 0.01, [-9] * 4, [9] * 4, 8.0)
        assert found.beta == 0
        assert not found.gains.any()

    def test_dependent_tasks_have_no_certificate(self):
        J = np.random.default_rng(0).normal(size=(3, 6))
        J[2] = J[0]
        solver = SdpGains((2, 1), 6)
        assert solver.solve(J, np.ones(3), 0.01, 4.0) == status.STATIONARY
        assert solver.task_rank == 2

    @pytest.mark.parametrize("asked", [1.0, 1.5, 100.0])
    def test_beta_does_not_exceed_one_over_the_period(self, asked):
        solver = SdpGains((2,), 4)
        solver.solve(np.random.default_rng(0).normal(size=(2, 4)), np.ones(2), 0.1, asked * 10)
        assert solver.beta <= 10
        assert solver.beta == pytest.approx(10, rel=1e-2)
        np.testing.assert_allclose(solver.gains, 10, rtol=0.1)

    def test_joints_that_may_not_move(self):
        it = random(3)
        it.lower[0] = it.upper[0] = 0.0
        it.lower[1] = 0.0
        solver = it.solved()
        check(it, solver)
        assert solver.dq[0] == 0
        assert solver.dq[1] >= 0
        it.lower[:], it.upper[:] = 0.0, 0.0
        solver = it.solved()
        assert solver.status == status.STATIONARY
        assert not solver.dq.any()

    def test_damping_is_within_the_certificate(self):
        it = ur5(1)
        solver = it.solved(damping=0.1)
        B, L = prioritised(it.sizes, it.J, np.ones(4), 0.1)
        assert solver.beta == pytest.approx(certified(L, solver.gains, it.dt), abs=1e-9)
        np.testing.assert_allclose(solver.dq, B @ (solver.gains * it.e), atol=1e-9)

    def test_moving_targets_are_fed_forward_within_the_limits(self):
        it = ur5(2)
        solver = it.solver()
        solver.rates[:] = 0.05, -0.02, 0.01, 0.0
        solver.solve(it.J, it.e, it.dt, it.desired)
        task_speeds = it.J @ solver.dq
        expected = solver.gains[:3] * it.e[:3] + solver.rates[:3]
        np.testing.assert_allclose(task_speeds[:3], expected, atol=1e-9)
        solver.rates[:] *= 1e4
        solver.solve(it.J, it.e, it.dt, it.desired)
        assert np.all(np.abs(solver.dq) <= it.upper)
        assert np.any(np.abs(solver.dq) == it.upper)

    def test_when_the_budget_is_spent_the_last_gains_remain(self):
        it = ur5(4)
        solver = it.solver()
        assert solver.solve(it.J, it.e, it.dt, it.desired) == status.OK
        before = solver.gains.copy()
        solver.budget, solver.upper[:], solver.lower[:] = 1, 0.5 * it.upper, 0.5 * it.lower
        assert solver.solve(it.J, it.e, it.dt, it.desired) == status.ITERATION_LIMIT
        assert solver.path == BUDGET
        assert solver.newton + solver.inner <= 1
        assert np.abs(solver.dq).max() <= 0.5 * it.upper[0]
        share = solver.gains / before
        np.testing.assert_allclose(share, share[0])
        assert 0 < share[0] <= 1
        L, _ = it.matrices()
        assert solver.beta == pytest.approx(certified(L, solver.gains, it.dt), abs=1e-9)

    def test_without_last_gains_the_best_point_that_was_found_is_taken(self):
        it = ur5(4)
        found = [it.solved(budget=budget) for budget in (1, 3, 60)]
        assert [solver.status for solver in found] == [
            status.ITERATION_LIMIT,
            status.ITERATION_LIMIT,
            status.OK,
        ]
        assert 0 < found[0].beta < found[1].beta < found[2].beta
        for solver in found:
            check(it, solver)

    @given(SEEDS)
    def test_iterations_are_bounded(self, seed):
        it = random(seed, ("", "decoupled", "dependent")[seed % 3])
        for budget in (5, 60):
            solver = it.solved(budget=budget)
            assert solver.newton + solver.inner <= budget
            check(it, solver)


class TestBadInput:
    GOOD: ClassVar = {
        "jacobians": [[[1.0, 1, 1, 1]], np.eye(2, 4)],
        "errors": [[1.0], [1.0, 1.0]],
        "dt": 0.01,
        "dq_lower": [-1.0] * 4,
        "dq_upper": [1.0] * 4,
        "beta_desired": 2.0,
    }

    @pytest.mark.parametrize(
        "change",
        [
            {"dt": 0.0},
            {"dt": float("nan")},
            {"beta_desired": -1.0},
            {"beta_desired": np.inf},
            {"delta": 0.0},
            {"dq_upper": [-1.0] * 4},
            {"dq_lower": [float("nan")] * 4},
            {"errors": [[1.0], [np.inf, 1.0]]},
            {"jacobians": [[[np.nan, 1, 1, 1]], np.eye(2, 4)]},
        ],
    )
    def test_is_refused(self, change):
        assert sdp_gains(**self.GOOD).status == status.OK
        assert sdp_gains(**(self.GOOD | change)).status == status.BAD_INPUT

    def test_weights_are_positive(self):
        assert sdp_gains(**self.GOOD, weights=[1.0, 1.0, -1.0]).status == status.BAD_INPUT

    @pytest.mark.parametrize("place", ["J", "e"])
    def test_leaves_the_robot_where_it_is(self, place):
        it = ur5(0)
        solver = it.solved()
        getattr(it, place).flat[1] = np.nan
        assert solver.solve(it.J, it.e, it.dt, it.desired) == status.BAD_INPUT
        assert not solver.dq.any()
        assert not solver.gains.any()
        assert solver.beta == 0

    def test_so_large_that_the_answer_overflows(self):
        solver = SdpGains((1,), 2)
        solver.rates[:] = 1e308
        assert solver.solve(np.array([[0.01, 0.0]]), np.ones(1), 0.01, 2.0) == status.OUT_OF_RANGE
        assert not solver.dq.any()

    def test_of_the_wrong_shape_or_type(self):
        solver = ur5(0).solved()
        assert solver.dq.any()
        assert solver.solve(np.ones((3, 6)), np.ones(4), 0.01, 2.0) == status.BAD_SHAPE
        assert not solver.dq.any()
        assert not solver.gains.any()
        with pytest.raises(BadProblemError, match="float64"):
            solver.solve([[1.0]], np.ones(4), 0.01, 2.0)
