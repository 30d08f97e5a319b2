"""What every constraint must do, whoever wrote it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar

import daqp
import numpy as np

from hoap3.protocol.messages import FloatArray, State
from hoap3.remote_controller.constraints.constraint import Constraint
from hoap3.remote_controller.constraints.registry import (
    ConstraintSettings,
    build,
    build_accelerations,
    find,
)
from hoap3.remote_controller.constraints.stack import ConstraintStack
from hoap3.remote_controller.model.kinematics import Kinematics
from hoap3.tools.testing.plugin_case import PluginCase
from hoap3.tools.testing.suite import Suite, Value, over

SEEDS = range(3)
PERIOD = 1e-3  # s
STEP = 1e-6  # rad
INSIDE = 1e-6  # of a margin: nearer to 0, or beyond, another law may hold

ConstraintCase = PluginCase[ConstraintSettings]


class Seen:
    """A constraint, and what it gives at any posture.

    Args:
        case: the constraint.

    Attributes:
        robot, kinematics, stack: description, kinematics of its own, a stack of it alone.
        constraint, state: itself, and the State that it was last shown.
    """

    def __init__(self, case: ConstraintCase) -> None:
        self.robot, self.kinematics = case.robot, Kinematics(case.robot)
        self.stack: ConstraintStack = build(
            [case.settings], case.robot, self.kinematics, PERIOD, case.file
        )
        self.constraint: Constraint = self.stack.constraints[0]
        self.state = State(self.robot.n, 0)
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self.stack.reset()
        self.state.tick = 0

    def at(self, q: FloatArray, dq: FloatArray | float = 0.0) -> Seen:
        """Show it a posture, one tick later."""
        self.state.q[:] = self.state.reference[:] = q
        self.state.dq[:] = dq
        self.kinematics.update(q)
        self.stack.update(self.kinematics, self.state)
        self.state.tick += 1
        return self

    def posture(self, seed: int, share: float = 0.2) -> FloatArray:
        """Near the initial posture."""
        start = np.array(self.robot.initial_position)
        rng = np.random.default_rng(seed)
        return start + share * (rng.uniform(*self.robot.sampling_range) - start)

    def walk(self, ticks: int = 60) -> list[bytes]:
        """What it says along a motion from the initial posture, as bytes."""
        start, end = np.array(self.robot.initial_position), self.posture(9)
        said = []
        for tick in range(ticks):
            self.at(start + tick / 2000.0 * (end - start), dq=(end - start) / 2.0)
            said.append(b"".join(array.tobytes() for array in self.arrays()))
        return said

    def arrays(self) -> tuple[FloatArray, ...]:
        """Those that it writes."""
        stack = self.stack
        all_of_them = stack.A, stack.b, stack.C, stack.c, stack.lower, stack.upper
        return (*all_of_them, self.constraint.margins)

    def margins(self, q: FloatArray) -> FloatArray:
        """Of a posture."""
        return self.at(q).constraint.margins.copy()

    def slopes(self, q: FloatArray) -> FloatArray:
        """Of every margin over every joint, (margins, n); NaN where the margin has none."""
        columns = []
        for shift in STEP * np.eye(self.robot.n):
            ahead, behind = self.margins(q + shift), self.margins(q - shift)
            both = np.isfinite(ahead) & np.isfinite(behind)
            columns.append(np.where(both, np.where(both, ahead - behind, 0.0), np.nan))
        return np.array(columns).T / (2 * STEP)

    def depends_on_the_past(self, q: FloatArray) -> bool:
        """Whether a margin is of what was, not of q."""
        first = self.at(self.posture(7)).margins(q)
        return not np.array_equal(first, self.at(self.posture(8)).margins(q))

    def nearest(self, wanted: FloatArray) -> FloatArray:
        """The u nearest to a wanted one that every row and bound allows."""
        stack, n = self.stack, self.robot.n
        upper = np.minimum(np.concatenate((stack.upper, stack.b, stack.c)), 1e30)
        lower = np.concatenate((stack.lower, np.full(len(stack.b), -np.inf), stack.c))
        sense = np.array([0] * (n + len(stack.b)) + [5] * len(stack.c), np.int32)
        rows = np.ascontiguousarray(np.vstack((stack.A, stack.C)))
        u, _, flag, _ = daqp.solve(np.eye(n), -wanted, rows, upper, np.maximum(lower, -1e30), sense)
        assert flag > 0, "no u is allowed at all"
        return np.array(u)


def every(suite: ConstraintProperties) -> list[Value]:
    """All cases."""
    return [Value((case,), case.label) for case in suite.known()]


class ConstraintProperties(Suite):
    """What every constraint must do that serves velocities; and accelerations, if it does.

    Attributes:
        cases: YAML files with `constraint` and `parameters`, `package.module:Class`, registered
            names, or `ConstraintCase`s. A bare class is built with its default parameters.
        robot: what they are built for, where it is not a `ConstraintCase`: a name or a path.
    """

    cases: ClassVar[Sequence[Any]] = ()
    robot: ClassVar[str] = "hoap3"

    def known(self) -> list[ConstraintCase]:
        """The cases, each with its robot."""
        return [
            case
            if isinstance(case, PluginCase)
            else ConstraintCase.named(str(case), self.robot, ConstraintSettings, "constraint")
            for case in self.cases
        ]

    @over("case", every)
    @over("seed", SEEDS)
    def test_what_its_rows_allow_keeps_equation_25(self, case: ConstraintCase, seed: int) -> None:
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

    @over("case", every)
    @over("seed", SEEDS)
    def test_a_step_of_one_period_keeps_what_was_inside(
        self, case: ConstraintCase, seed: int
    ) -> None:
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

    @over("case", every)
    @over("seed", SEEDS)
    def test_what_its_rows_allow_of_accelerations_keeps_the_barrier(
        self, case: ConstraintCase, seed: int
    ) -> None:
        """m̈ ≥ −2ηṁ − η²m of every margin of the posture, by differences."""
        robot, settings, file = case.robot, case.settings, case.file
        if not find(settings.constraint).serves("acceleration"):
            return
        stack = build_accelerations([settings], robot, Kinematics(robot), PERIOD, file)
        (constraint,) = stack.constraints
        if constraint.guarantee != "conditional":
            return
        rng, state, n = np.random.default_rng(seed), State(robot.n, 0), robot.n
        start = np.array(robot.initial_position)
        q = start + 0.2 * (rng.uniform(*robot.sampling_range) - start)
        dq, t = rng.normal(0.0, 0.3, n), 1e-4
        state.q[:], state.dq[:] = q, dq
        stack.update(q, dq, state)
        brake = np.minimum(robot.brake_acceleration, robot.setpoint_acceleration_max)
        eta = constraint.rate_of(constraint.parameters, (robot.velocity, brake))
        rows = np.ascontiguousarray(np.vstack((np.eye(n), stack.rows)))
        upper = np.concatenate((np.full(n, 1e3), np.minimum(stack.rows_upper, 1e30)))
        lower = np.concatenate((np.full(n, -1e3), np.maximum(stack.rows_lower, -1e30)))
        aside = Kinematics(robot)
        for frame in robot.frames:
            aside.frame_id(frame)

        def at(time: float, ddq: FloatArray) -> FloatArray:
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

    @over("case", every)
    def test_rows_names_and_margins_agree_and_none_is_nan(self, case: ConstraintCase) -> None:
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

    @over("case", every)
    def test_rows_that_are_not_needed_forbid_nothing(self, case: ConstraintCase) -> None:
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

    @over("case", every)
    def test_it_writes_all_of_its_arrays_and_no_other(self, case: ConstraintCase) -> None:
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
        expected = (
            (seen.stack.C, seen.stack.c) if constraint.equality else (seen.stack.A, seen.stack.b)
        )
        np.testing.assert_array_equal(matrix[1:-1], expected[0])
        np.testing.assert_array_equal(vector[1:-1], expected[1])
        assert state.dump() == kept

    @over("case", every)
    def test_bounds_narrow_what_they_are_given_and_leave_something(
        self, case: ConstraintCase
    ) -> None:
        seen, rng = Seen(case), np.random.default_rng(0)
        for seed in range(6):
            seen.at(seen.posture(seed, share=1.0))
            given = np.sort(rng.normal(size=(2, seen.robot.n)), axis=0)
            lower, upper = given.copy()
            seen.constraint.bounds(seen.state, lower, upper)
            assert (given[0] <= lower).all()
            assert (lower <= upper).all()
            assert (upper <= given[1]).all()

    @over("case", every)
    def test_its_arrays_are_laid_out_once(self, case: ConstraintCase) -> None:
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

    @over("case", every)
    def test_it_repeats_bit_by_bit(self, case: ConstraintCase) -> None:
        first, used = Seen(case), Seen(case)
        expected = first.walk()
        used.walk(20)
        for seed in SEEDS:
            used.at(used.posture(seed))
        used.reset()  # forgets all of that
        assert used.walk() == expected
        assert Seen(case).walk() == expected

    @over("case", every)
    def test_it_judges_a_gradient_and_does_not_touch_it(self, case: ConstraintCase) -> None:
        seen = Seen(case)
        seen.at(seen.posture(1))
        for gradient in (
            np.zeros(seen.robot.n),
            np.random.default_rng(1).normal(size=seen.robot.n),
        ):
            kept = gradient.copy()
            assert bool(seen.constraint.accepts(gradient)) in {True, False}
            np.testing.assert_array_equal(gradient, kept)
        assert seen.constraint.accepts(np.zeros(seen.robot.n))  # nothing is to decrease
