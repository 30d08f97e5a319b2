"""What stands between any setpoint and the motors: limits, loss policy, safe stop.

Not a safety function in the sense of any norm.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from hoap3.protocol.description import RobotDescription
from hoap3.protocol.messages import FloatArray


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
        self.value, self.rate, self._target, self._before = np.zeros((4, n))
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
        held = self._filter(setpoint, self._before, self._limits, self._dt, self.value, self.rate)
        self._before[:] = setpoint
        return self._count(held)

    def _count(self, held: int) -> int:
        """Note who was held back, or -1."""
        self.held_back = held
        self.interventions += held >= 0
        if self._outside:
            self._begin_at_value()  # what has come in may not go out again
        return held
