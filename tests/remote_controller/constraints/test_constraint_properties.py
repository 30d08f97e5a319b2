"""What every constraint must do, whoever wrote it.

The suite runs over all that are registered. To run it over your own, unedited:

    HOAP3_TEST_CONSTRAINTS="mypackage.mymodule:MyConstraint,other.yaml" \\
        python -m pytest tests/remote_controller/constraints/test_constraint_properties.py

A bare class is built with its default parameters, a file says `constraint` and `parameters`.
"""

from __future__ import annotations

import daqp
import numpy as np
import pytest
from registered_constraints import CASES, make
from support.constraint_bench import PERIOD

from hoap3.protocol.messages import State
from hoap3.remote_controller.constraints.registry import build_accelerations, find, registered
from hoap3.remote_controller.model.kinematics import Kinematics

SEEDS = range(3)
STEP = 1e-6  # rad
INSIDE = 1e-6  # of a margin: nearer to 0, or beyond, another law may hold
every_constraint = pytest.mark.parametrize("case", CASES)


class Seen:
    """A constraint, and what it gives at any posture."""

    def __init__(self, case: str) -> None:
        self.robot, self.kinematics, self.stack = make(case)
        (self.constraint,) = self.stack.constraints
        self.state = State(self.robot.n, 0)
        self.reset()

    def reset(self):
        self.stack.reset()
        self.state.tick = 0

    def at(self, q, dq=0.0):
        self.state.q[:] = self.state.reference[:] = q
        self.state.dq[:] = dq
        self.kinematics.update(q)
        self.stack.update(self.kinematics, self.state)
        self.state.tick += 1
        return self

    def posture(self, seed, share=0.2):
        """Near the initial posture."""
        start = np.array(self.robot.initial_position)
        rng = np.random.default_rng(seed)
        return start + share * (rng.uniform(self.robot.lower, self.robot.upper) - start)

    def walk(self, ticks=60):
        """What it says along a motion from the initial posture, as bytes."""
        start, end = np.array(self.robot.initial_position), self.posture(9)
        said = []
        for tick in range(ticks):
            self.at(start + tick / 2000.0 * (end - start), dq=(end - start) / 2.0)
            said.append(b"".join(array.tobytes() for array in self.arrays()))
        return said

    def arrays(self):
        stack = self.stack
        all_of_them = stack.A, stack.b, stack.C, stack.c, stack.lower, stack.upper
        return (*all_of_them, self.constraint.margins)

    def margins(self, q):
        return self.at(q).constraint.margins.copy()

    def slopes(self, q):
        """Of every margin over every joint, (margins, n); NaN where the margin has none."""
        columns = []
        for shift in STEP * np.eye(self.robot.n):
            ahead, behind = self.margins(q + shift), self.margins(q - shift)
            both = np.isfinite(ahead) & np.isfinite(behind)
            columns.append(np.where(both, np.where(both, ahead - behind, 0.0), np.nan))
        return np.array(columns).T / (2 * STEP)

    def depends_on_the_past(self, q):
        first = self.at(self.posture(7)).margins(q)
        return not np.array_equal(first, self.at(self.posture(8)).margins(q))

    def nearest(self, wanted):
        """The u nearest to a wanted one that every row and bound allows."""
        stack, n = self.stack, self.robot.n
        upper = np.minimum(np.concatenate((stack.upper, stack.b, stack.c)), 1e30)
        lower = np.concatenate((stack.lower, np.full(len(stack.b), -np.inf), stack.c))
        sense = np.array([0] * (n + len(stack.b)) + [5] * len(stack.c), np.int32)
        rows = np.ascontiguousarray(np.vstack((stack.A, stack.C)))
        u, _, flag, _ = daqp.solve(np.eye(n), -wanted, rows, upper, np.maximum(lower, -1e30), sense)
        assert flag > 0, "no u is allowed at all"
        return np.array(u)


def test_every_registered_constraint_is_tried(monkeypatch):
    monkeypatch.delenv("HOAP3_TEST_CONSTRAINTS", raising=False)
    from registered_constraints import _cases

    tried = {settings.constraint for _, settings, _ in _cases().values()}
    assert tried == {name for name in registered() if find(name).serves("velocity")}


@every_constraint
@pytest.mark.parametrize("seed", SEEDS)
def test_what_its_rows_allow_keeps_equation_25(case, seed):
    """dm/dt ≥ −η·m of every margin, by differences, whichever way one pushes; η·T ≤ 1."""
    seen = Seen(case)
    q = seen.posture(seed)
    if seen.depends_on_the_past(q):
        return  # a margin of what was, not of q
    margins, slopes = seen.margins(q), seen.slopes(q)
    seen.at(q)
    eta = getattr(seen.constraint.parameters, "eta_per_s", 1.0 / PERIOD)
    judged = np.isfinite(margins) & (margins > INSIDE) & np.isfinite(slopes).all(axis=1)
    rng = np.random.default_rng(seed)
    pushes = [-10.0 * slopes[each] for each in np.flatnonzero(judged)[:8]]
    pushes += [rng.normal(size=seen.robot.n) for _ in range(4)]
    for push in pushes:
        u = seen.nearest(push)
        room = 1e-6 * (1.0 + np.abs(slopes[judged]).sum(axis=1) * np.abs(u).max())
        assert (slopes[judged] @ u >= -eta * margins[judged] - room).all()


@every_constraint
@pytest.mark.parametrize("seed", SEEDS)
def test_a_step_of_one_period_keeps_what_was_inside(case, seed):
    """But for the curvature that an Euler step does not see, which is of second order in T."""
    seen = Seen(case)
    q = seen.posture(seed)
    if seen.depends_on_the_past(q):
        return
    before = seen.margins(q)
    rng = np.random.default_rng(seed)
    for _ in range(4):
        seen.at(q)
        u = seen.nearest(3.0 * rng.normal(size=seen.robot.n))
        after = seen.margins(q + PERIOD * u)
        lost = (float(np.abs(u).sum()) * PERIOD) ** 2
        assert (after[before >= 0.0] >= -1e-9 - lost).all()


@every_constraint
@pytest.mark.parametrize("seed", SEEDS)
def test_what_its_rows_allow_of_accelerations_keeps_the_barrier(case, seed):
    """m̈ ≥ −2ηṁ − η²m of every margin of the posture, by differences, whichever way one pushes."""
    robot, settings, file = CASES[case]
    if not find(settings.constraint).serves("acceleration"):
        return
    stack = build_accelerations([settings], robot, Kinematics(robot), PERIOD, file)
    (constraint,) = stack.constraints
    if constraint.guarantee != "conditional":
        return
    rng, state, n = np.random.default_rng(seed), State(robot.n, 0), robot.n
    start = np.array(robot.initial_position)
    q = start + 0.2 * (rng.uniform(robot.lower, robot.upper) - start)
    dq, t = rng.normal(0.0, 0.3, n), 1e-4
    state.q[:], state.dq[:] = q, dq
    stack.update(q, dq, state)
    brake = np.minimum(robot.brake_acceleration, robot.setpoint_acceleration_max)
    eta = constraint.fit_rate(constraint.parameters, robot.velocity, brake)
    rows = np.ascontiguousarray(np.vstack((np.eye(n), stack.rows)))
    upper = np.concatenate((np.full(n, 1e3), np.minimum(stack.rows_upper, 1e30)))
    lower = np.concatenate((np.full(n, -1e3), np.maximum(stack.rows_lower, -1e30)))
    aside = Kinematics(robot)
    for frame in robot.frames:
        aside.frame_id(frame)

    def at(time, ddq):
        margins = np.zeros(constraint.margins.size)
        aside.update(q + time * dq + 0.5 * time * time * ddq)
        constraint.margins_at(aside, margins)
        return margins

    here = at(0.0, np.zeros(n))
    known = np.isfinite(here) & (here > INSIDE)
    for push in [-40.0 * stack.rows[row] for row in range(min(8, len(stack.rows)))] + [
        rng.normal(0.0, 10.0, n) for _ in range(4)
    ]:
        sense = np.zeros(len(upper), np.int32)
        ddq, _, flag, _ = daqp.solve(np.eye(n), -push, rows, upper, lower, sense)
        if flag <= 0:
            continue
        m, ahead, behind = here[known], at(t, ddq)[known], at(-t, ddq)[known]
        rate, second = (ahead - behind) / (2 * t), (ahead - 2 * m + behind) / t**2
        smooth = np.abs(second) < 100.0  # else another point has become the nearest one
        room = 1e-3 * (1.0 + np.abs(second))
        assert (second >= -2.0 * eta * rate - eta**2 * m - room)[smooth].all()


@every_constraint
def test_rows_names_and_margins_agree_and_none_is_nan(case):
    """All over the joints' ranges."""
    seen = Seen(case)
    constraint, stack, n = seen.constraint, seen.stack, seen.robot.n
    assert constraint.rows == len(constraint.names)
    matrix, vector = (stack.C, stack.c) if constraint.equality else (stack.A, stack.b)
    assert matrix.shape == (constraint.rows, n)
    assert vector.shape == (constraint.rows,)
    for seed in range(8):
        seen.at(seen.posture(seed, share=1.0))
        assert len(constraint.margins) == len(constraint.margin_names)
        assert np.isfinite(matrix).all()
        assert not np.isnan(vector).any()
        assert not np.isnan(constraint.margins).any()
        assert constraint.margin() == min(constraint.margins, default=np.inf)
        assert constraint.drift() >= 0.0
        assert (stack.lower <= stack.upper).all()
        counts = constraint.events
        assert min(counts.values()) >= 0
        assert counts["started_outside"] <= counts["outside"]


@every_constraint
def test_rows_that_are_not_needed_forbid_nothing(case):
    """A row of zeros is 0·u ≤ b with b ≥ 0, or 0·u = 0: no u can break it."""
    seen = Seen(case)
    constraint, rows, n = seen.constraint, seen.constraint.rows, seen.robot.n
    matrix, vector = np.zeros((rows, n)), np.zeros(rows)
    for seed in range(8):
        seen.at(seen.posture(seed, share=1.0))
        assert (seen.stack.b > -np.inf).all()
        seen.state.tick -= 1  # the same one again, and what nobody makes milder
        if rows:
            constraint.update(seen.kinematics, seen.state, matrix, vector)
        seen.state.tick += 1
        off = vector[~matrix.any(axis=1)]
        assert (off == 0.0).all() if constraint.equality else (off >= 0.0).all()


@every_constraint
def test_it_writes_all_of_its_arrays_and_no_other(case):
    seen, other = Seen(case), Seen(case)
    constraint, rows, n = seen.constraint, seen.constraint.rows, seen.robot.n
    q = seen.posture(1)
    seen.at(q)
    matrix, vector = np.full((rows + 2, n), np.nan), np.full(rows + 2, np.nan)
    other.at(q)
    other.state.tick -= 1  # the same one again
    state, kept = other.state, other.state.dump()
    if rows:
        other.constraint.update(other.kinematics, state, matrix[1:-1], vector[1:-1])
    assert np.isnan(matrix[[0, -1]]).all()
    assert np.isnan(vector[[0, -1]]).all()
    expected = (seen.stack.C, seen.stack.c) if constraint.equality else (seen.stack.A, seen.stack.b)
    np.testing.assert_array_equal(matrix[1:-1], expected[0])
    np.testing.assert_array_equal(vector[1:-1], expected[1])
    assert state.dump() == kept


@every_constraint
def test_bounds_narrow_what_they_are_given_and_leave_something(case):
    seen, rng = Seen(case), np.random.default_rng(0)
    for seed in range(6):
        seen.at(seen.posture(seed, share=1.0))
        given = np.sort(rng.normal(size=(2, seen.robot.n)), axis=0)
        lower, upper = given.copy()
        seen.constraint.bounds(seen.state, lower, upper)
        assert (given[0] <= lower).all()
        assert (lower <= upper).all()
        assert (upper <= given[1]).all()


@every_constraint
def test_its_arrays_are_laid_out_once(case):
    seen = Seen(case)
    seen.walk(3)
    arrays = seen.arrays()
    seen.walk(5)
    assert all(now is before for now, before in zip(seen.arrays(), arrays, strict=True))
    kept = [array.copy() for array in arrays]
    theirs = Seen(case)
    theirs.at(theirs.posture(2))
    for array, before in zip(arrays, kept, strict=True):
        np.testing.assert_array_equal(array, before)
        assert not any(np.shares_memory(array, each) for each in theirs.arrays())


@every_constraint
def test_it_repeats_bit_by_bit(case):
    first, used = Seen(case), Seen(case)
    expected = first.walk()
    used.walk(20)
    for seed in SEEDS:
        used.at(used.posture(seed))
    used.reset()  # forgets all of that
    assert used.walk() == expected
    assert Seen(case).walk() == expected


@every_constraint
def test_it_judges_a_gradient_and_does_not_touch_it(case):
    seen = Seen(case)
    seen.at(seen.posture(1))
    for gradient in (np.zeros(seen.robot.n), np.random.default_rng(1).normal(size=seen.robot.n)):
        kept = gradient.copy()
        assert bool(seen.constraint.accepts(gradient)) in {True, False}
        np.testing.assert_array_equal(gradient, kept)
    assert seen.constraint.accepts(np.zeros(seen.robot.n))  # nothing is to decrease
