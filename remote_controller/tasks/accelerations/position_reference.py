"""Targets of positions, seen from the root."""

from __future__ import annotations

import math

import numpy as np

from hoap3.protocol.messages import FloatArray
from hoap3.remote_controller.references.target import Target


class PositionReference:
    """A target x_d in the root's axes, with its velocity and its acceleration.

    What the velocity gains in the coming period is the acceleration: held for so long it leads to
    where the target is then.

    Args:
        target: where.
        origin, axes: of the frame in which it is given, (3,) [m] and (3, 3).
        period_s: [s].
        out: x_d, v_d and a_d, (3, 3), to be written to.
    """

    def __init__(
        self,
        target: Target,
        origin: FloatArray,
        axes: FloatArray,
        period_s: float,
        out: FloatArray,
    ) -> None:
        from hoap3.remote_controller.tasks.accelerations import task_acceleration_kernels as kernels

        self._place_in_root = kernels.place_in_root
        self._target, self._origin, self._axes, self._period = target, origin, axes, period_s
        self._out = out
        self._now = np.zeros(3), np.zeros(3)  # position and velocity
        self._next = np.zeros(3), np.zeros(3)
        self._known_s = math.nan  # time of the next ones
        self._rested, self._rests_at = False, 0.0

    def start(self, present: FloatArray, time_s: float, next_s: float) -> None:
        """Begin where the frame is, (3,) [m] in the root's axes."""
        self._target.start(self._axes.T @ (present - self._origin), time_s)
        self._rested, self._rests_at = False, time_s + self._target.rests_after_s
        self._known_s = math.nan
        self.update(time_s, next_s)

    def update(self, time_s: float, next_s: float) -> None:
        """Write where it is at a time [s], and how it moves until the next one."""
        if self._rested:
            return
        if time_s == self._known_s:
            self._now, self._next = self._next, self._now
        else:
            self._target.at(time_s, *self._now)
        self._target.at(next_s, *self._next)
        self._known_s = next_s
        position, velocity = self._now
        self._place_in_root(
            position, velocity, self._next[1], self._period, self._origin, self._axes, self._out
        )
        self._rested = time_s > self._rests_at
