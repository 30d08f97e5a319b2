"""What is fed forward and certified with constant gains, damped or not, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sdp_problems import Problem, random, ur5

from benchmarks.conic_gains import ConicGains
from benchmarks.sdp_backends import installed
from hoap3.protocol.errors import BadProblemError
from hoap3.remote_controller.solvers.base import status
from hoap3.remote_controller.solvers.clik.clik_reference import certified, prioritised
from hoap3.remote_controller.solvers.clik.constant_gains import ConstantGains
from hoap3.remote_controller.solvers.clik.constant_gains_reference import SINGULAR, pivots
from hoap3.remote_controller.solvers.sdp.sdp_gains import SdpGains

SEEDS = st.integers(0, 10**6)


def law(it: Problem, damping: float) -> tuple[np.ndarray, np.ndarray]:
    """B and L = D J B D⁻¹ by (7)."""
    weights = np.ones(it.e.size) if it.weights is None else it.weights
    return prioritised(it.sizes, it.J, weights, damping)


def regular(L: np.ndarray) -> bool:
    """Whether no pivot of L is a thousandth or less."""
    return bool(np.abs(pivots(L)).min() > SINGULAR)


def steady(it: Problem, wanted: np.ndarray, damping: float = 0.0) -> ConstantGains:
    """Solved."""
    found = ConstantGains(it.sizes, it.J.shape[1], wanted)
    found.damping = damping
    if it.weights is not None:
        found.weights[:] = it.weights
    found.lower[:], found.upper[:] = it.lower, it.upper
    return found


@pytest.mark.parametrize("kind", ["", "dependent"])
@pytest.mark.parametrize("damping", [0.0, 0.1])
def test_what_is_fed_forward_moves_the_tasks_as_their_targets_move(kind, damping):
    for seed in range(50):
        it, rng = random(seed, kind), np.random.default_rng(seed)
        it.weights = 10.0 ** rng.uniform(-4, 2, it.e.size)
        it.lower[:], it.upper[:] = -np.inf, np.inf
        for solver in (steady(it, np.ones(it.e.size), damping), it.solver(damping=damping)):
            solver.rates[:] = rng.normal(size=it.e.size)
            more = () if isinstance(solver, ConstantGains) else (it.desired,)
            solver.solve(it.J, it.e, it.dt, *more)
            B, L = law(it, damping)
            plain = damping > 0.0 or not regular(L)
            wanted = B @ solver.rates if plain else solver.rates
            moved = solver.fed if plain else it.J @ solver.fed
            np.testing.assert_allclose(moved, wanted, atol=1e-6 * (1.0 + np.abs(solver.fed).max()))


@pytest.mark.parametrize(("e", "certified"), [(-0.1, False), (0.1, False), (-0.3, True)])
def test_gains_that_do_not_undo_what_breaks_the_limits_certify_nothing(e, certified):
    """What is fed is 1.5, the limit 1: β is that of gains only where dq is fed + Λ e."""
    solver = ConstantGains((1,), 1, [2.0])
    solver.lower[:], solver.upper[:], solver.rates[:] = -1.0, 1.0, 1.5
    solver.solve(np.ones((1, 1)), np.array([e]), 0.01)
    assert solver.fed[0] == 1.5
    if certified:
        assert solver.beta > 0.0
        assert solver.dq[0] == pytest.approx(1.5 + solver.gains[0] * e)
    else:
        assert solver.dq[0] == 1.0
        assert solver.gains[0] == 0.0
        assert solver.beta == pytest.approx(0.0, abs=1e-200)


@pytest.mark.parametrize("backend", [None, *installed()])
@pytest.mark.parametrize(("e", "cut"), [(-0.1, True), (0.1, True), (-0.3, False)])
def test_best_gains_say_whether_dq_is_theirs(backend, e, cut):
    """What is fed is 1.5, the limit 1: dq is fed + Λ e only where the gains take off 0.5."""
    solver = ConicGains((1,), 1, solver=backend) if backend else SdpGains((1,), 1)
    solver.lower[:], solver.upper[:], solver.rates[:] = -1.0, 1.0, 1.5
    for _ in range(2):  # from nothing, and from there on
        solver.solve(np.ones((1, 1)), np.array([e]), 0.01, 4.0)
        assert solver.cut == cut
        assert (solver.dq[0] == pytest.approx(1.5 + solver.gains[0] * e, abs=1e-7)) != cut
    solver.rates[:] = 0.0
    solver.solve(np.ones((1, 1)), np.array([e]), 0.01, 4.0)
    assert not solver.cut
    assert solver.dq[0] == pytest.approx(solver.gains[0] * e, abs=1e-7)


@settings(max_examples=60)
@given(SEEDS)
def test_v_falls_as_beta_of_constant_gains_says_in_the_linear_model(seed):
    it = random(seed)
    it.lower[:], it.upper[:] = -np.inf, np.inf
    solver = steady(it, np.full(it.e.size, 3.0))
    solver.solve(it.J, it.e, it.dt)
    _, L = law(it, 0.0)
    for e in np.random.default_rng(seed).normal(size=(10, it.e.size)):
        after = e - it.dt * L @ (solver.gains * e)
        limit = (1 - solver.beta * it.dt) * (e @ e)
        assert after @ after <= limit * (1 + 1e-9) + 1e-12


@settings(max_examples=60)
@given(SEEDS, st.sampled_from([1e-3, 0.1, 3.0]), st.booleans())
def test_the_certificate_of_damped_gains_is_that_of_the_damped_law(seed, damping, weigh):
    it = random(seed)
    if weigh:
        it.weights = 10.0 ** np.random.default_rng(seed).uniform(-4, 0, it.e.size)
    solver = it.solved(damping=damping)
    B, L = law(it, damping)
    size = 1 + np.abs(L).max() * np.abs(solver.gains).max()
    expected = certified(L, solver.gains, it.dt)
    assert solver.beta == pytest.approx(expected, abs=1e-8 * size * it.desired)
    assert solver.beta >= 0.0
    speed = B @ (solver.gains * it.e)
    np.testing.assert_allclose(solver.dq, speed, atol=2e-8 * (1 + np.abs(speed).max()))
    assert (solver.dq <= it.upper).all()
    assert (solver.dq >= it.lower).all()


def test_damping_tames_a_singular_task_and_costs_beta():
    it = ur5(1)
    it.J[2] = 0.5 * (it.J[0] + it.J[1]) + 1e-5 * it.J[2]
    it.sizes, it.J, it.e = (3,), it.J[:3].copy(), it.e[:3].copy()
    it.lower[:], it.upper[:] = -np.inf, np.inf
    plain, damped = (steady(it, np.full(3, 2.0), damping) for damping in (0.0, 0.05))
    for solver in (plain, damped):
        solver.solve(it.J, it.e, it.dt)
    assert np.abs(damped.dq).max() < 1e-2 * np.abs(plain.dq).max()
    assert plain.beta == pytest.approx(4.0 - 4.0 * it.dt, rel=1e-6)
    assert 0.0 < damped.beta < 1e-3


class TestBadInput:
    @pytest.mark.parametrize("change", [{"sizes": ()}, {"sizes": (3, 0)}, {"joints": 0}])
    def test_is_refused(self, change):
        with pytest.raises(BadProblemError):
            ConstantGains(**({"sizes": (3, 1), "joints": 6, "wanted": np.ones(4)} | change))

    @pytest.mark.parametrize("place", ["J", "e", "lower", "rates", "dt", "damping", "weights"])
    def test_leaves_the_robot_where_it_is(self, place):
        it = ur5(0)
        solver, dt = steady(it, np.ones(4)), it.dt
        assert solver.solve(it.J, it.e, dt) == status.OK
        if place == "dt":
            dt = 0.0
        elif place == "damping":
            solver.damping = -1.0
        elif place == "weights":
            solver.weights[3] = -1.0
        elif place == "lower":
            solver.lower[0] = 0.1  # does not allow to stand still
        else:
            (solver.rates if place == "rates" else getattr(it, place)).flat[1] = np.nan
        assert solver.solve(it.J, it.e, dt) == status.BAD_INPUT
        assert not solver.dq.any()
        assert not solver.gains.any()
        assert solver.beta == 0.0

    def test_so_large_that_the_answer_overflows(self):
        solver = ConstantGains((1,), 2, [1.0])
        solver.rates[:] = 1e308
        assert solver.solve(np.array([[0.01, 0.0]]), np.ones(1), 0.01) == status.OUT_OF_RANGE
        assert not solver.dq.any()

    def test_of_the_wrong_shape_or_type(self):
        solver = ConstantGains((3, 1), 6, np.ones(4))
        assert solver.solve(np.ones((3, 6)), np.ones(4), 0.01) == status.BAD_SHAPE
        with pytest.raises(BadProblemError, match="float64"):
            solver.solve([[1.0]], np.ones(4), 0.01)

    def test_joints_that_may_not_move_stop_all_of_it(self):
        it = ur5(0)
        solver = steady(it, np.ones(4))
        solver.lower[0] = solver.upper[0] = 0.0
        assert solver.solve(it.J, it.e, it.dt) == status.OK
        assert not solver.dq.any()
        assert not solver.gains.any()
        assert solver.beta == pytest.approx(0.0, abs=1e-200)
