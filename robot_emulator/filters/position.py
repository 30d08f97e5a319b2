"""What stands between any setpoint and the motors: limits, loss policy, safe stop.

Not a safety function in the sense of any norm.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from hoap3.protocol.messages import FloatArray
from hoap3.protocol.robot.description import RobotDescription
from hoap3.robot_emulator.filters.base import ACCELERATION, POSITION, ROUNDING, SPEED


class PositionFilter:
    """The reference that is applied to the motors, kept inside the limits of the description.

    Every change goes through one kernel: usable position limits, joint velocity
    and `setpoint_acceleration_max`, whatever the setpoint was (`position_kernels`). A joint that
    starts outside its usable range may not go further out.

    Attributes:
        value, reference: applied reference, (n,) [rad or m].
        rate: its velocity over the last period, (n,) [rad/s or m/s].
        interventions: periods in which some joint was held back.
        held_back: the first joint held back in the last period, or -1.
        overloaded, torque_limited: see `SetpointFilter`; no torque is commanded here.
    """

    def __init__(self, description: RobotDescription, period_s: float) -> None:
        from hoap3.robot_emulator.filters.position_kernels import filter_setpoint

        n = description.n
        self._filter: Callable[..., int] = filter_setpoint
        self._dt = period_s
        self._usable = description.lower, description.upper
        acceleration = description.setpoint_acceleration_max
        self._limits = np.array([*self._usable, description.velocity, acceleration])
        self._lower, self._upper = self._limits[0], self._limits[1]
        self._outside = False  # some joint may be beyond its usable range
        passing = acceleration * (1.0 - 1e-9)  # the filter's limit, whatever rounding does
        self._brake = np.minimum(description.brake_acceleration, passing)
        self.value, self.rate, self._target, self._before, self._last_rate = np.zeros((5, n))
        self.reference = self.value
        self.interventions = self.torque_limited = 0
        self.held_back = self.overloaded = -1
        self._newest, self._earlier = np.zeros((2, n))  # setpoints
        self._stop_change = np.zeros(n)
        self._newest_tick = -1
        self._ticks_between = 0
        self._stop_ticks = self._stopped_for = 0

    def reset(self, q: FloatArray) -> None:
        """Be at rest at `q`, (n,)."""
        self.value[:] = q
        self.rate[:] = 0.0
        self._begin_at_value()
        self.forget()

    def _begin_at_value(self) -> None:
        """Let the range of a joint end where it is, if that is beyond its usable range."""
        lower, upper = self._usable
        np.minimum(lower, self.value, out=self._lower)
        np.maximum(upper, self.value, out=self._upper)
        self._outside = bool((self._lower < lower).any() or (self._upper > upper).any())

    def forget(self) -> None:
        """Forget earlier setpoints: there is nothing to hold or extrapolate but the place."""
        self._before[:] = self.value
        self._newest_tick = -1
        self._ticks_between = 0

    def follow(self, setpoint: FloatArray, tick: int) -> int:
        """Take a setpoint, (n,), that answers `tick`, which is later than the one before.

        Returns:
            The number of a joint whose setpoint was outside the limits, or -1.
        """
        self._ticks_between = tick - self._newest_tick if self._newest_tick >= 0 else 0
        self._newest_tick = tick
        self._newest, self._earlier = self._earlier, self._newest
        self._newest[...] = setpoint
        return self._go_to(self._newest)

    def hold(self) -> int:
        """No setpoint: keep to the last one."""
        return self._go_to(self._before)

    def extrapolate(self) -> int:
        """No setpoint: go on as the last two did, as far as they were within the limits."""
        if self._ticks_between:
            newest = np.clip(self._newest, self._lower, self._upper)
            earlier = np.clip(self._earlier, self._lower, self._upper)
            ahead = (newest - earlier) / self._ticks_between
            return self._go_to(np.add(self._before, ahead, out=self._target))
        return self._go_to(self._before)

    def begin_stop(self) -> None:
        """Plan to brake to rest: all joints together, in a straight line, at the limit of one."""
        self._stop_change[:] = self.rate * self._dt
        duration = float(np.max(np.abs(self.rate) / self._brake, initial=0.0))
        self._stop_ticks = max(1, math.ceil(duration / self._dt - 1e-9))
        self._stopped_for = 0

    def brake(self) -> bool:
        """One period of the planned stop; True once at rest."""
        self._stopped_for += 1
        share = max(0.0, 1.0 - self._stopped_for / self._stop_ticks)
        np.multiply(self._stop_change, share, out=self._target)
        self._target += self.value
        self._before[:] = self.value
        self._go_to(self._target)
        return share == 0.0 and not self.rate.any()

    def _go_to(self, setpoint: FloatArray) -> int:
        """Move towards it as far as the limits allow, and have it be the last; as of `follow`."""
        np.copyto(self._last_rate, self.rate)
        held = self._filter(setpoint, self._before, self._limits, self._dt, self.value, self.rate)
        self._before[:] = setpoint
        return self._count(held)

    def limit_of(self, joint: int) -> int:
        """Return the limit, `Event.LIMIT_*`, that clipped a joint in the last period."""
        lower, upper, speed, most = self._limits[:4, joint].tolist()
        setpoint, rate = self._before[joint], self.rate[joint]
        if not lower <= setpoint <= upper:
            return POSITION
        if abs(rate) >= speed * (1.0 - ROUNDING):
            return SPEED
        wanted = (setpoint - self.value[joint]) / self._dt + rate  # speed to be there in time
        change = (wanted - self._last_rate[joint]) / self._dt
        if acts := self._limit_of_change(joint, change, most):
            return acts
        return SPEED if abs(wanted) + self._rise(joint, change) > speed else POSITION

    def _limit_of_change(self, joint: int, change: float, most: float) -> int:
        """Return the limit that keeps a joint from a change of speed [rad/s² or m/s²], or 0."""
        del joint
        return ACCELERATION if abs(change) > most * (1.0 + ROUNDING) else 0

    def _rise(self, joint: int, acceleration: float) -> float:
        """Return by how much a joint gets faster while it ends its acceleration [rad/s or m/s]."""
        del joint, acceleration
        return 0.0

    def _count(self, held: int) -> int:
        """Note who was held back, or -1."""
        self.held_back = held
        self.interventions += held >= 0
        if self._outside:
            self._begin_at_value()  # what has come in may not go out again
        return held
