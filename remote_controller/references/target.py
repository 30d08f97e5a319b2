"""What every target gives to a task, a point, and the approach to what moves."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod

import numpy as np

from hoap3.protocol.messages import FloatArray


class Target(ABC):
    """A position x_d(t) and its velocity dx_d/dt.

    Time is the robot's tick × its period [s], never a wall clock. A target moves from the moment
    of its `start`; the velocity is exactly the derivative of the position, and continuous, but for
    a trajectory that is `linear`, and where it is told to `stay`.

    Args:
        dimension: m, of the position.

    Attributes:
        rests_after_s: time since the start from which on it does not move any more [s].
    """

    rests_after_s = math.inf

    def __init__(self, dimension: int) -> None:
        self.dimension = dimension
        self._begin = 0.0
        self._stays: FloatArray | None = None

    def start(self, present: FloatArray | None, time_s: float) -> None:
        """Begin to move.

        Args:
            present: where the robot is, (m,); None where nobody knows.
            time_s: now [s].
        """
        del present
        self._begin, self._stays = time_s, None

    def stay(self, position: FloatArray) -> None:
        """Give up: be there, (m,), until the next `start`."""
        self._stays = position.copy()

    def elapsed(self, time_s: float) -> float:
        """Time since the start [s]."""
        return max(0.0, time_s - self._begin)

    def at(self, time_s: float, position_out: FloatArray, velocity_out: FloatArray) -> None:
        """Write x_d and dx_d/dt at a time [s], both (m,), contiguous; before the start as at it."""
        if self._stays is not None:
            position_out[:] = self._stays
            velocity_out[:] = 0.0
            return
        self.follow(max(0.0, time_s - self._begin), position_out, velocity_out)

    @abstractmethod
    def follow(self, elapsed_s: float, position_out: FloatArray, velocity_out: FloatArray) -> None:
        """Write x_d and dx_d/dt of a time after the start [s], both (m,), contiguous."""


class Point(Target):
    """x_d = const."""

    rests_after_s = 0.0

    def __init__(self, position: FloatArray) -> None:
        super().__init__(len(position))
        self._position = np.array(position, float)

    def follow(self, elapsed_s: float, position_out: FloatArray, velocity_out: FloatArray) -> None:
        """Write the point, and no velocity."""
        del elapsed_s
        position_out[:] = self._position
        velocity_out[:] = 0.0


class Hold(Target):
    """x_d is where the robot is at the start; 0 where nobody knows.

    Args:
        dimension: m.
    """

    rests_after_s = 0.0

    def __init__(self, dimension: int) -> None:
        super().__init__(dimension)
        self._position = np.zeros(dimension)

    def start(self, present: FloatArray | None, time_s: float) -> None:
        """Take where the robot is."""
        super().start(present, time_s)
        self._position[:] = 0.0 if present is None else present

    def follow(self, elapsed_s: float, position_out: FloatArray, velocity_out: FloatArray) -> None:
        """Write the place, and no velocity."""
        del elapsed_s
        position_out[:] = self._position
        velocity_out[:] = 0.0


class Approach(Target):
    """Another target c(t), reached smoothly from where the robot is.

    x_d = x_0 + s·(c − x_0), with s from 0 to 1 within the approach (`smooth_step`): x_d starts at
    x_0 at rest, moves along with c all the while, and is c from then on, without a jump in
    velocity or acceleration.

    Args:
        target: c.
        duration_s: of the approach [s]; 0 is none.
    """

    def __init__(self, target: Target, duration_s: float) -> None:
        from hoap3.remote_controller.references.approach_kernels import blend

        super().__init__(target.dimension)
        self._blend, self._target, self._duration = blend, target, duration_s
        self._from = np.zeros(target.dimension)
        self._blends = False
        self.rests_after_s = max(duration_s, target.rests_after_s)

    def start(self, present: FloatArray | None, time_s: float) -> None:
        """Begin at `present`."""
        super().start(present, time_s)
        self._target.start(present, time_s)
        self._blends = present is not None and self._duration > 0.0
        if present is not None:
            self._from[:] = present

    def follow(self, elapsed_s: float, position_out: FloatArray, velocity_out: FloatArray) -> None:
        """Write x_d and its velocity."""
        self._target.follow(elapsed_s, position_out, velocity_out)
        if not self._blends or elapsed_s >= self._duration:
            return
        s, slope = smooth_step(elapsed_s / self._duration)
        self._blend(self._from, s, slope / self._duration, position_out, velocity_out)


class Joined(Target):
    """Two targets one below the other, such as a position and a rotation vector: a pose."""

    def __init__(self, first: Target, second: Target) -> None:
        super().__init__(first.dimension + second.dimension)
        self._first, self._second = first, second
        self.rests_after_s = max(first.rests_after_s, second.rests_after_s)

    def start(self, present: FloatArray | None, time_s: float) -> None:
        """Begin both."""
        super().start(present, time_s)
        m = self._first.dimension
        self._first.start(None if present is None else present[:m], time_s)
        self._second.start(None if present is None else present[m:], time_s)

    def follow(self, elapsed_s: float, position_out: FloatArray, velocity_out: FloatArray) -> None:
        """Write both positions, and both velocities."""
        m = self._first.dimension
        self._first.follow(elapsed_s, position_out[:m], velocity_out[:m])
        self._second.follow(elapsed_s, position_out[m:], velocity_out[m:])


def smooth_step(x: float) -> tuple[float, float]:
    """Give s = 10x³ − 15x⁴ + 6x⁵ and ds/dx: from 0 to 1, with ds = d²s = 0 at both ends.

    Outside 0 … 1 it stays. The steepest slope is 15/8, at x = ½.
    """
    if not 0.0 < x < 1.0:
        return (1.0, 0.0) if x >= 1.0 else (0.0, 0.0)
    rest = 1.0 - x
    return x * x * x * (10.0 + x * (6.0 * x - 15.0)), 30.0 * x * x * rest * rest
