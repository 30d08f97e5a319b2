"""What stands between any setpoint and the motors: limits, loss policy, safe stop.

Not a safety function in the sense of any norm.
"""

from __future__ import annotations

import math

import numpy as np

from protocol.description import RobotDescription
from protocol.messages import FloatArray


class Reference:
    """The reference that is applied to the motors, kept inside the limits of the description.

    Every change goes through one gate: usable position limits and joint velocity, whatever the
    setpoint was.

    Attributes:
        value: applied reference, (n,) [rad or m].
        rate: its velocity over the last period, (n,) [rad/s or m/s].
    """

    def __init__(self, description: RobotDescription, period_s: float) -> None:
        n = description.n
        self._dt = period_s
        self._lower, self._upper = description.lower, description.upper
        self._step = description.velocity * period_s
        self._brake = description.brake_acceleration
        self.value = np.zeros(n)
        self.rate = np.zeros(n)
        self._target = np.zeros(n)
        self._before = np.zeros(n)
        self._size = np.zeros(n)
        self._flags = np.zeros(n, np.bool_)
        self._setpoint = np.zeros(n)
        self._setpoint_tick = -1
        self._setpoint_rate = np.zeros(n)
        self._stop_rate = np.zeros(n)
        self._stop_ticks = self._stopped_for = 0

    def reset(self, q: FloatArray) -> None:
        """Be at rest at `q`, (n,)."""
        self.value[:] = q
        self.rate[:] = 0.0
        self.forget()

    def forget(self) -> None:
        """Forget earlier setpoints: there is nothing to hold or extrapolate but the place."""
        self._target[:] = self.value
        self._setpoint_rate[:] = 0.0
        self._setpoint_tick = -1

    def follow(self, setpoint: FloatArray, tick: int) -> int:
        """Take a setpoint, (n,), that answers `tick`.

        Returns:
            The number of a joint whose setpoint was outside the limits, or -1.
        """
        if self._setpoint_tick >= 0:
            np.subtract(setpoint, self._setpoint, out=self._setpoint_rate)
            self._setpoint_rate /= tick - self._setpoint_tick
        self._setpoint_tick = tick
        self._setpoint[:] = setpoint
        self._target[:] = setpoint
        return self._apply()

    def hold(self) -> int:
        """No setpoint: keep to the last one."""
        return self._apply()

    def extrapolate(self) -> int:
        """No setpoint: go on as the last two did."""
        self._target += self._setpoint_rate
        return self._apply()

    def begin_stop(self) -> None:
        """Plan to brake to rest: all joints together, in a straight line, at the limit of one."""
        self._stop_rate[:] = self.rate
        duration = float(np.max(np.abs(self.rate) / self._brake, initial=0.0))
        self._stop_ticks = max(1, math.ceil(duration / self._dt - 1e-9))
        self._stopped_for = 0

    def brake(self) -> bool:
        """One period of the planned stop; True once at rest."""
        self._stopped_for += 1
        share = max(0.0, 1.0 - self._stopped_for / self._stop_ticks)
        np.multiply(self._stop_rate, share * self._dt, out=self._target)
        self._target += self.value
        self._apply()
        return share == 0.0

    def _apply(self) -> int:
        """Move towards the target as far as the limits allow; the joint that was held back, or -1.

        A target that is within the limits is taken over bit by bit.
        """
        value, before, rate, size = self.value, self._before, self.rate, self._size
        before[:] = value
        np.maximum(self._target, self._lower, out=value)
        np.minimum(value, self._upper, out=value)
        np.subtract(value, before, out=rate)
        np.abs(rate, out=size)
        np.greater(size, self._step, out=self._flags)
        if np.count_nonzero(self._flags):
            np.clip(rate, -self._step, self._step, out=rate)
            np.add(before, rate, out=value)
        rate /= self._dt
        np.not_equal(value, self._target, out=self._flags)
        return int(np.argmax(self._flags)) if np.count_nonzero(self._flags) else -1
