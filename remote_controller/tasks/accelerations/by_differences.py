"""Tasks of any kind as accelerations: how their errors move, by differences along the motion."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from hoap3.protocol.messages import FloatArray
from hoap3.remote_controller.model.kinematics import Kinematics
from hoap3.remote_controller.tasks.lyapunov import LyapunovFunction

STEP_S = 1e-5  # along the motion: rounding and curvature are both below 1e-9 of a drift then


class TaskRows(NamedTuple):
    """Where the rows of a task are written to: k of them.

    Attributes:
        error: −e, (k,).
        motion: ė, (k,).
        rate: of the motion at q̈ = 0, so that ë = J q̈ + rate, (k,).
        slope: V̇ = slope·motion of V = ½|e|², (k,).
        jacobian: J, (k, n).
    """

    error: FloatArray
    motion: FloatArray
    rate: FloatArray
    slope: FloatArray
    jacobian: FloatArray


class _Task(NamedTuple):
    """A task, its arrays, and where its rows are written to."""

    function: LyapunovFunction
    error: FloatArray
    jacobian: FloatArray
    error_rate: FloatArray
    to: TaskRows
    other: FloatArray

    def look(self, kinematics: Kinematics, dq: FloatArray, time_s: float, out: FloatArray) -> None:
        """Write g, (k,)."""
        self.function.update(kinematics, time_s)
        np.matmul(self.jacobian, dq, out=out)
        np.add(out, self.error_rate, out=out)


class TasksByDifferences:
    """e, ė and ë − J q̈ of tasks that give e, J = ∂e/∂q and ∂e/∂t.

    Of g(q, t) = J q̇ + ∂e/∂t, which is ė, the rate is ∂g/∂q·q̇ + ∂g/∂t. The first is a central
    difference along q̇; the second that of one period ahead, so that a task whose acceleration is
    held for a period moves as its target does at the end of it.

    So `update` of a task is called four times a cycle, at postures to either side of the robot's
    and at the next time, and last at the robot's own. What it writes must follow from posture and
    time alone, smoothly: it may not count calls, filter, or keep what an earlier one found, unless
    to choose between what is as good, as the two directions of a tangent are.

    Args:
        functions: the tasks; their time is that of the robot's ticks.
        rows: of each.
        kinematics: that the tasks were built with.
        period_s: T [s].
    """

    def __init__(
        self,
        functions: Sequence[LyapunovFunction],
        rows: Sequence[TaskRows],
        kinematics: Kinematics,
        period_s: float,
    ) -> None:
        self._kinematics, self._period = kinematics, period_s
        self._tasks = [
            _Task(each, *each.followed, to, np.zeros(to.error.size))
            for each, to in zip(functions, rows, strict=True)
        ]
        self._q = np.zeros(kinematics.n)

    def begin(self, q: FloatArray, time_s: float) -> None:
        """Have all targets start from where the robot is, (n,), at a time [s]."""
        self._kinematics.update(q)
        for task in self._tasks:
            task.function.reset(self._kinematics, time_s)

    def update(self, q: FloatArray, dq: FloatArray, time_s: float, next_s: float) -> None:
        """Write all rows for joint positions and velocities, (n,), at a time and the next [s]."""
        kinematics, period = self._kinematics, self._period
        self._move(q, dq, STEP_S)
        for task in self._tasks:
            task.look(kinematics, dq, time_s, task.to.rate)
        self._move(q, dq, -STEP_S)
        for task in self._tasks:
            task.look(kinematics, dq, time_s, task.other)
            np.subtract(task.to.rate, task.other, out=task.to.rate)
            np.divide(task.to.rate, 2.0 * STEP_S, out=task.to.rate)
        kinematics.update(q)
        for task in self._tasks:
            to = task.to
            task.look(kinematics, dq, next_s, task.other)
            task.look(kinematics, dq, time_s, to.motion)
            np.subtract(task.other, to.motion, out=task.other)
            np.divide(task.other, period, out=task.other)
            np.add(to.rate, task.other, out=to.rate)
            to.jacobian[:], to.slope[:] = task.jacobian, task.error
            np.negative(task.error, out=to.error)

    def _move(self, q: FloatArray, dq: FloatArray, step_s: float) -> None:
        np.multiply(dq, step_s, out=self._q)
        np.add(q, self._q, out=self._q)
        self._kinematics.update(self._q)
