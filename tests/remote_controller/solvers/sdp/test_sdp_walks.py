"""What a solver knows of the last three answers shortens the way to the next, and is not in it.

Nor is how much more than possible is asked for.
"""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from sdp_problems import random

from benchmarks.gains_problems import walk
from hoap3.remote_controller.solvers.base import status
from hoap3.remote_controller.solvers.sdp.sdp_gains import BUDGET, IPM, WARM

TICKS = 15


@settings(max_examples=40)
@given(st.integers(0, 10**6), st.sampled_from(["", "decoupled"]))
@example(24, "decoupled")  # one whose multiplier moves into another block
@example(991, "decoupled")  # one whose guess takes all iterations, if it may
def test_along_a_walk_with_jumps_each_answer_is_that_of_a_fresh_solver(seed, kind):
    it, rng = random(seed, kind), np.random.default_rng(seed + 1)
    some, solver = it.J != 0.0, it.solver()
    for _ in range(TICKS):
        it.J += 0.02 * some * rng.normal(size=it.J.shape)
        it.e += 0.02 * rng.normal(size=it.e.size)
        chance = rng.random()
        if chance < 0.1:
            it.e[:] = rng.normal(size=it.e.size)
        elif chance < 0.2:
            it.desired = float(rng.uniform(0.5, 10.0))
        elif chance < 0.3:
            it.lower[:], it.upper[:] = -rng.uniform(0.2, 5.0), rng.uniform(0.2, 5.0)
            solver.lower[:], solver.upper[:] = it.lower, it.upper
        elif chance < 0.35:
            solver.solve(np.nan * it.J, it.e, it.dt, it.desired, it.delta)
        fresh = it.solved()
        solver.solve(it.J, it.e, it.dt, it.desired, it.delta)
        if fresh.status == status.OK:
            assert solver.gap <= 1e-6 * it.desired**2  # rarely above what counts as proved
            near = solver.status != status.OK
            assert solver.beta == pytest.approx(fresh.beta, abs=1e-4 if near else 1e-6)
            size = 1e-3 if near else 2e-5
            np.testing.assert_allclose(solver.gains, fresh.gains, rtol=size, atol=size)


@pytest.mark.parametrize("seed", range(4))
def test_along_a_smooth_motion_one_newton_step_is_enough_and_as_good_as_many(seed):
    it, rng = random(seed, ""), np.random.default_rng(seed)
    solver, J, e = it.solver(), it.J.copy(), it.e.copy()
    turn, fade = rng.normal(size=J.shape), rng.normal(size=e.size)
    steps, judged = [], 0
    for tick in range(200):
        it.J[:] = J + 0.05 * np.sin(1e-3 * tick) * turn
        it.e[:] = e + 0.05 * (np.exp(-2e-3 * tick) - 1.0) * fade
        fresh = it.solved()
        solver.solve(it.J, it.e, it.dt, it.desired, it.delta)
        steps.append(solver.newton)
        if fresh.status == status.OK:
            judged += 1
            assert solver.status == status.OK
            assert solver.beta == pytest.approx(fresh.beta, abs=1e-6)
            np.testing.assert_allclose(solver.gains, fresh.gains, rtol=1e-6, atol=1e-6)
    assert judged > 150
    assert np.median(steps) == 1
    assert np.mean(steps) < 1.5


def test_no_way_leads_across_a_jump():
    """Where the UR5 comes to a limit the method begins anew, once: the next ticks go on from it."""
    along = walk("ur5", 0.05)
    solver = along.solver()
    call = along.call(solver)
    paths = [call(*moment).path for moment in along.moments]
    jumps = [k for k, path in enumerate(paths) if path == IPM]
    assert jumps[0] == 0
    assert len(jumps) > 1
    assert all(paths[k + 1 : k + 4] == [WARM] * 3 for k in jumps)


@pytest.mark.parametrize("budget", [10, 16])
def test_what_takes_longer_than_a_budget_goes_on_at_the_next_tick(budget):
    """The humanoid needs more than 10 from nothing: begun anew each time they would never end."""
    along = walk("humanoid32", 0.08)
    solver, unhurried = along.solver(budget=budget), along.solver()
    paths = []
    for moment in along.moments:
        each, whole = along.call(solver)(*moment), along.call(unhurried)(*moment)
        paths.append(each.path)
        assert each.newton + each.inner <= budget
        if each.status == status.OK:
            assert each.beta == pytest.approx(whole.beta, abs=1e-6)
            np.testing.assert_allclose(each.gains, whole.gains, rtol=2e-5, atol=2e-5)
    assert paths[0] == (BUDGET if budget == 10 else IPM)
    assert WARM in paths[:12]
    assert np.count_nonzero(np.array(paths) == BUDGET) < 20


@pytest.mark.parametrize("times", [1e3, 1e6, 1e12])
def test_whatever_more_than_a_step_is_asked_for_a_step_is_what_it_gets(times):
    """From 100/Δt on it is one problem, near that of 10/Δt: not one of worse and worse numbers."""
    it = random(5, "")
    answers = []
    for each in (10.0, 100.0, times):
        it.desired = each / it.dt
        answers.append(it.solved())
        assert answers[-1].status == status.OK
    ten, hundred, most = answers
    assert most.beta == hundred.beta == pytest.approx(ten.beta, rel=1e-4)
    np.testing.assert_array_equal(most.gains, hundred.gains)
    assert most.beta * it.dt <= 1.0 + 1e-12
