"""How all joints come to rest together with a limit of jerk."""

from __future__ import annotations

import math

import numpy as np

from hoap3.protocol.messages import FloatArray


class BrakingCurve:
    """Velocities of a stop, in periods: what is released of the acceleration, and a common curve.

    The acceleration a₀ goes to 0 with half of the jerk. From the velocity v₁ that it leaves, each
    joint brakes along v₁·s(t), which is a straight line in the space of joints, and s goes from 1
    to 0 with |ṡ| ≤ b and |s̈| ≤ j as fast as can be:

        b = min brake / |v₁|,    j = min J / (2|v₁|)

    So the jerk of the sum is within J, and its acceleration within the greater of |a₀| and brake.

    Args:
        brake, jerk: greatest of each joint, (n,).
        T: period [s].
    """

    def __init__(self, brake: FloatArray, jerk: FloatArray, T: float) -> None:
        self._brake, self._half, self._T = brake, 0.5 * jerk, T
        self._start, self._released = np.zeros((2, len(brake)))
        self._sign = np.zeros(len(brake))
        self._ticks, self._ramp, self._rate = 1, 0.0, 0.0

    def begin(self, velocity: FloatArray, acceleration: FloatArray) -> None:
        """Plan a stop from a velocity and an acceleration, (n,) each."""
        self._released = np.abs(acceleration) / (self._half * self._T)
        self._sign = np.sign(acceleration) * self._half * self._T**2
        self._start = velocity + self._sign * _release(self._released)
        fast = np.maximum(np.abs(self._start), 1e-300)
        rate, jerk = float(np.min(self._brake / fast)), float(np.min(self._half / fast))
        ramp = rate / jerk
        if ramp * rate > 1.0:
            ramp = math.sqrt(1.0 / jerk)
            rate = jerk * ramp
        duration = 1.0 / rate + ramp
        least = float(np.max(self._released, initial=0.0)) * self._T
        self._ticks = max(1, math.ceil(max(duration, least) / self._T - 1e-9))
        slower = duration / (self._ticks * self._T)
        self._ramp, self._rate = ramp / slower, rate * slower

    def at(self, tick: int, out: FloatArray) -> bool:
        """Write the velocities of a tick after the begin, (n,); True where they are 0."""
        np.multiply(self._start, self._share(tick), out=out)
        out -= self._sign * _release(np.maximum(self._released - tick, 0.0))
        return tick >= self._ticks

    def _share(self, tick: int) -> float:
        """S at a tick: it falls by a parabola, a line, and a parabola."""
        left, ramp = (self._ticks - tick) * self._T, self._ramp
        if left <= 0.0:
            return 0.0
        if left <= ramp:
            return 0.5 * self._rate / ramp * left * left
        gone = tick * self._T
        if gone <= ramp:
            return 1.0 - 0.5 * self._rate / ramp * gone * gone
        return 1.0 - self._rate * (gone - 0.5 * ramp)


def _release(x: FloatArray) -> FloatArray:
    """(x − 1) + (x − 2) + …, as long as it is positive."""
    m = np.maximum(np.ceil(x) - 1.0, 0.0)
    return np.asarray(m * x - 0.5 * m * (m + 1.0))
