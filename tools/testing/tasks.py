"""What every task must do, whoever wrote it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any, ClassVar

import numpy as np
import pytest

from hoap3.protocol.messages import FloatArray
from hoap3.remote_controller.model.kinematics import Kinematics
from hoap3.remote_controller.tasks import status
from hoap3.remote_controller.tasks.lyapunov import LyapunovFunction
from hoap3.remote_controller.tasks.registry import TaskSettings, build
from hoap3.tools.testing.numerics import posture, quotient
from hoap3.tools.testing.plugin_case import PluginCase
from hoap3.tools.testing.suite import Suite, Value, over

SEEDS = range(4)
TIMES = (0.0, 0.37, 1.9, 60.0)
STEP = 1e-3  # s, a tick

TaskCase = PluginCase[TaskSettings]


class Seen:
    """A task that was reset at the initial posture, and what it says anywhere.

    Args:
        case: the task.
        begin_s: when it was reset [s].

    Attributes:
        robot, kinematics, function: description, kinematics of its own, and a new V.
    """

    def __init__(self, case: TaskCase, begin_s: float = 0.0) -> None:
        self.robot, self.kinematics = case.robot, Kinematics(case.robot)
        self.function: LyapunovFunction = build(
            case.settings, case.robot, self.kinematics, case.file
        )
        self.begin_s = begin_s
        self.reset(self.robot.initial_position, begin_s)

    def reset(self, q: FloatArray, time_s: float) -> None:
        """Begin anew at a posture."""
        self.kinematics.update(q)
        self.function.reset(self.kinematics, time_s)

    def at(self, q: FloatArray, time_s: float) -> tuple[float, FloatArray, float]:
        """V, ∇V and ∂V/∂t, `time_s` after the beginning."""
        self.kinematics.update(q)
        self.function.update(self.kinematics, self.begin_s + time_s)
        return self.function.value, self.function.gradient.copy(), self.function.rate

    def value(self, q: FloatArray, time_s: float) -> FloatArray:
        """V as an array of no dimension."""
        return np.array(self.at(q, time_s)[0])

    def path(self, ticks: int = 120) -> list[tuple[FloatArray, float]]:
        """A smooth motion through the middle of the joints' ranges, from the initial posture."""
        start = np.array(self.robot.initial_position)
        middle = sum(self.robot.sampling_range) / 2
        speed = np.clip(0.3 * (middle - start), -self.robot.velocity, self.robot.velocity)
        return [(start + tick * STEP * speed, tick * STEP) for tick in range(ticks)]

    def follow(self) -> list[tuple[float, bytes, float, int]]:
        """What it says along that motion, as bytes."""
        said = []
        for q, time_s in self.path():
            value, gradient, rate = self.at(q, time_s)
            said.append((value, gradient.tobytes(), rate, self.function.status))
        return said

    def arrays(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Those that it writes."""
        return self.function.gradient, self.function.error, self.function.jacobian


def every(suite: TaskProperties) -> list[Value]:
    """All cases."""
    return [Value((case,), case.label) for case in suite.known()]


class TaskProperties(Suite):
    """What every task must do that has a V.

    Attributes:
        cases: YAML files with `task` and `parameters`, `package.module:Class`, registered names, or
            `TaskCase`s. A bare class is built with its default parameters.
        robot: what they are built for, where it is not a `TaskCase`: a name or a path.
    """

    cases: ClassVar[Sequence[Any]] = ()
    robot: ClassVar[str] = "hoap3"

    def known(self) -> list[TaskCase]:
        """The cases, each with its robot."""
        return [
            case
            if isinstance(case, PluginCase)
            else TaskCase.named(str(case), self.robot, TaskSettings, "task")
            for case in self.cases
        ]

    @over("case", every)
    @over("seed", SEEDS)
    def test_its_gradient_and_rate_are_the_derivatives_of_v(
        self, case: TaskCase, seed: int
    ) -> None:
        seen = Seen(case)
        q, time_s = posture(seen.robot, seed), TIMES[seed]
        value, gradient, rate = seen.at(q, time_s)
        assert seen.function.status != status.AT_ANTIPODE  # V has a kink there
        slopes = quotient(lambda there: seen.value(there, time_s), q)
        scale = max(value, float(np.max(np.abs(slopes))), 1e-6)
        np.testing.assert_allclose(gradient, slopes, rtol=0, atol=1e-6 * scale)
        time_s = max(time_s, 0.1)  # a target may begin to move with a corner
        rate = seen.at(q, time_s)[2]
        slope = quotient(lambda there: seen.value(q, there[0]), np.array([time_s]))[0]
        assert rate == pytest.approx(slope, rel=1e-5, abs=1e-5 * max(value, abs(slope), 1e-6))

    @over("case", every)
    @over("seed", SEEDS)
    def test_v_is_never_negative_and_everything_is_finite(self, case: TaskCase, seed: int) -> None:
        seen, rng = Seen(case), np.random.default_rng(seed)
        n = seen.robot.n
        for time_s in (*TIMES, 1e4):
            ends = seen.robot.lower_hard, seen.robot.upper_hard
            low, high = np.where(np.isfinite(ends), ends, seen.robot.sampling_range)
            q = np.asarray(rng.uniform(low, high))
            value, gradient, rate = seen.at(q, time_s)
            assert value >= 0.0
            assert gradient.shape == (n,)
            assert gradient.dtype == np.float64
            assert np.isfinite([value, rate, *gradient]).all()
            assert seen.function.status in range(len(status.NAMES))

    @over("case", every)
    def test_an_error_that_it_gives_makes_up_v_and_its_gradient(self, case: TaskCase) -> None:
        seen = Seen(case)
        function = seen.function
        m = len(function.error)
        assert function.jacobian.shape == (m, seen.robot.n)
        for seed in SEEDS if m else ():
            value, gradient, _ = seen.at(posture(seen.robot, seed), TIMES[seed])
            assert np.isfinite(function.error).all()
            assert value == pytest.approx(0.5 * float(function.error @ function.error), rel=1e-12)
            scale = np.abs(function.jacobian).max() * np.abs(function.error).max()
            expected = function.jacobian.T @ function.error
            np.testing.assert_allclose(gradient, expected, rtol=0, atol=1e-12 * scale)

    @over("case", every)
    @over("seed", SEEDS)
    def test_its_jacobian_and_rate_are_the_derivatives_of_its_error(
        self, case: TaskCase, seed: int
    ) -> None:
        seen = Seen(case)
        function = seen.function
        q, time_s = posture(seen.robot, seed), max(TIMES[seed], 0.1)
        seen.at(q, time_s)
        jacobian, rate = function.jacobian.copy(), function.error_rate.copy()

        def error(at: FloatArray, when: float) -> FloatArray:
            seen.at(at, when)
            return function.error.copy()

        slopes = quotient(lambda there: error(there, time_s), q)
        scale = max(1e-6, float(np.max(np.abs(jacobian), initial=0.0)))
        np.testing.assert_allclose(jacobian, slopes, rtol=0, atol=1e-6 * scale)
        moves = quotient(lambda there: error(q, there[0]), np.array([time_s]))
        scale = max(1e-6, float(np.max(np.abs(moves), initial=0.0)))
        np.testing.assert_allclose(rate, moves[:, 0], rtol=0, atol=1e-5 * scale)

    @over("case", every)
    def test_its_arrays_are_laid_out_once(self, case: TaskCase) -> None:
        seen = Seen(case)
        arrays = seen.arrays()
        for q, time_s in seen.path(20):
            seen.at(q, time_s)
        for array, now in zip(arrays, seen.arrays(), strict=True):
            assert now is array
        other = Seen(case)
        kept = [array.copy() for array in arrays]
        other.at(posture(other.robot, 3), 1.0)
        for array, before in zip(arrays, kept, strict=True):
            np.testing.assert_array_equal(array, before)
            assert not any(np.shares_memory(array, theirs) for theirs in other.arrays())

    @over("case", every)
    def test_it_repeats_bit_by_bit(self, case: TaskCase) -> None:
        first, used = Seen(case), Seen(case)
        expected = first.follow()
        for seed in SEEDS:  # wherever it was, a reset forgets
            used.reset(posture(used.robot, seed), 7.0 + seed)
            used.at(posture(used.robot, seed + 1), 8.5 + seed)
        used.reset(used.robot.initial_position, 0.0)
        assert used.follow() == expected
        assert Seen(case).follow() == expected

    @over("case", every)
    def test_v_does_not_depend_on_where_it_looked_before(self, case: TaskCase) -> None:
        seen = Seen(case)
        q, elsewhere = posture(seen.robot, 0), posture(seen.robot, 1)
        value, gradient, rate = seen.at(q, 0.8)
        seen.at(elsewhere, 2.1)
        again = seen.at(q, 0.8)
        assert again[0] == value
        np.testing.assert_array_equal(again[1], gradient)
        assert again[2] == rate

    @over("case", every)
    @over("begin_s", [0.0, 12.5])
    def test_after_a_reset_nothing_jumps(self, case: TaskCase, begin_s: float) -> None:
        """From one tick to the next V changes by V̇·dt, from the very first one on."""
        seen = Seen(case, begin_s)
        path = seen.path()
        said = [seen.at(q, time_s) for q, time_s in path]
        moves = [after[0] - before[0] for before, after in pairwise(path)]
        largest = max(1e-9, *(value for value, *_ in said))
        for move, (before, after) in zip(moves, pairwise(said), strict=True):
            slopes = [float(each[1] @ move) + each[2] * STEP for each in (before, after)]
            changed = after[0] - before[0]
            room = abs(slopes[1] - slopes[0]) + 1e-6 * largest
            assert min(slopes) - room <= changed <= max(slopes) + room

    @over("case", every)
    def test_a_reset_on_the_way_does_not_raise_v_by_a_jump(self, case: TaskCase) -> None:
        """What a target that starts anew makes of V is continuous from there on as well."""
        seen = Seen(case)
        q, time_s = seen.path()[-1]
        seen.at(q, time_s)
        seen.reset(q, time_s)
        first = seen.at(q, time_s)
        second = seen.at(q, time_s + 1e-6)
        assert math.isclose(second[0], first[0], rel_tol=1e-4, abs_tol=1e-9 + 1e-6 * abs(first[2]))
