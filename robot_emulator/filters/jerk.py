"""The filter of positions of a robot that has a limit of jerk besides."""

from __future__ import annotations

import math

import numpy as np

from hoap3.protocol.limits.jerk_limits import limits_with_jerk
from hoap3.protocol.messages import FloatArray
from hoap3.protocol.robot.description import RobotDescription
from hoap3.robot_emulator.filters.base import ACCELERATION, JERK, ROUNDING
from hoap3.robot_emulator.filters.position import PositionFilter


def limits_jerk(robot: RobotDescription) -> bool:
    """Whether some joint has a limit of jerk that its accelerations do not keep anyway."""
    return bool(np.isfinite(limits_with_jerk(robot)[4]).any())


def jerk_notes(robot: RobotDescription) -> list[str]:
    """What people should know of it: which joints may not use all of their acceleration."""
    if robot.command_kinds[0] != "position":
        return []
    asked, (_, _, _, kept, jerks) = robot.setpoint_acceleration_max, limits_with_jerk(robot)
    return [
        f"joint {name!r}: accelerates by {kept[i]:.6g} at most instead of {asked[i]:.6g}, because "
        f"its range and speed are too small to change more by a jerk of {jerk:.6g}"
        for i, (name, jerk) in enumerate(zip(robot.joint_names, jerks, strict=True))
        if kept[i] < asked[i]
    ]


class JerkFilter(PositionFilter):
    """The applied reference, kept inside all limits of the description, `setpoint_jerk_max` too.

    Every change goes through the kernels of `jerk_kernels`. A stop ends the acceleration that there
    is, and brakes all joints together in a straight line, with half of the jerk for either.
    """

    def __init__(self, description: RobotDescription, period_s: float) -> None:
        from hoap3.protocol.limits.jerk_takeover_kernels import WITHOUT
        from hoap3.robot_emulator.filters import jerk_kernels as kernels
        from hoap3.robot_emulator.filters.jerk_block_kernels import WORK

        super().__init__(description, period_s)
        n = description.n
        self._filter, self._steer, self._ends = (
            kernels.filter_jerk, kernels.steer, kernels.brake_ends
        )  # fmt: skip
        self._limits = limits_with_jerk(description)
        jerk = self._limits[4]
        self._lower, self._upper = self._limits[0], self._limits[1]
        some = np.where(np.isfinite(jerk), jerk, WITHOUT * self._limits[3] / period_s)
        self._curve = BrakingCurve(np.minimum(self._brake, self._limits[3]), some, period_s)
        self._motion, self._lowest, self._highest = np.zeros((3, n)), np.zeros(n), np.zeros(n)
        self.value, self.rate, self._acceleration = self._motion
        self.reference = self.value
        self._last_rate, self._last_acceleration = self._last = np.zeros((2, n))
        self._history, self._work = np.zeros((3, n)), np.zeros(WORK)
        self._before = self._history[0]

    def reset(self, q: FloatArray) -> None:
        """Be at rest at `q`, (n,)."""
        self._acceleration[:] = 0.0
        super().reset(q)

    def _begin_at_value(self) -> None:
        """Let the range of a joint end where it gets to at least, if that is beyond its usable."""
        self._ends(self._limits, self._dt, self._motion, self._lowest, self._highest)
        lower, upper = self._usable
        np.minimum(lower, self._lowest, out=self._lower)
        np.maximum(upper, self._highest, out=self._upper)
        self._outside = bool((self._lower < lower).any() or (self._upper > upper).any())

    def forget(self) -> None:
        """Forget earlier setpoints: there is nothing to hold or extrapolate but the place."""
        super().forget()
        self._history[:] = self.value

    def begin_stop(self) -> None:
        """Plan to brake to rest: all joints together, as soon as the slowest can."""
        self._curve.begin(self.rate, self._acceleration)
        self._stopped_for = 0

    def brake(self) -> bool:
        """One period of the planned stop; True once at rest, and no acceleration is left."""
        self._stopped_for += 1
        over = self._curve.at(self._stopped_for, self._target)
        self._count(self._steer(self._target, self._limits, self._dt, self._motion))
        return over and not self.rate.any() and not self._acceleration.any()

    def _limit_of_change(self, joint: int, change: float, most: float) -> int:
        jerk = self._limits[4, joint] * (1.0 + ROUNDING)
        if abs(change - self._last_acceleration[joint]) / self._dt > jerk:
            acts = abs(self._acceleration[joint]) >= most * (1.0 - ROUNDING)
            return ACCELERATION if acts else JERK
        return super()._limit_of_change(joint, change, most)

    def _rise(self, joint: int, acceleration: float) -> float:
        return float(acceleration**2 / (2.0 * self._limits[4, joint]))

    def _go_to(self, setpoint: FloatArray) -> int:
        np.copyto(self._last, self._motion[1:])
        return self._count(
            self._filter(setpoint, self._history, self._limits, self._dt, self._motion, self._work)
        )


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
