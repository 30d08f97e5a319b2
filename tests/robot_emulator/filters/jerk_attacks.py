"""A reference with limits of jerk, and those who want to drive it beyond them."""

from __future__ import annotations

import numpy as np
from setpoint_attacks import Attacked, N, T, greedy, jitter, jumps, noise, random_limits

from hoap3.protocol.limits.jerk_limits import kept_acceleration
from hoap3.protocol.messages import FloatArray
from hoap3.robot_emulator.filters.jerk_block_kernels import WORK
from hoap3.robot_emulator.filters.jerk_kernels import filter_jerk

ULPS = 12
"""Of the largest of four positions (and of the way at the greatest speed in three periods)."""


class JerkAttacked(Attacked):
    """A reference at rest somewhere within limits, of jerk too, and all that became of it."""

    def __init__(
        self,
        seed: int,
        limits: FloatArray | None = None,
        jerk: FloatArray | None = None,
        start: FloatArray | None = None,
    ) -> None:
        rng = np.random.default_rng(seed + 1)
        given = random_limits(rng) if limits is None else limits
        self.jerk = given[3] * 10.0 ** rng.uniform(-1, 3.5, N) if jerk is None else jerk
        self.acceleration = np.zeros(N)
        super().__init__(seed, given, start)
        self.motion = np.array([self.value, self.velocity, self.acceleration])
        self.value, self.velocity, self.acceleration = self.motion
        A = kept_acceleration(*self.limits, self.jerk, T)
        self.limits[3] = A
        self.all = np.ascontiguousarray([*self.limits, self.jerk])
        self.history, self.work = np.tile(self.value, (3, 1)), np.full(WORK, np.nan)

    def forget(self) -> None:
        super().forget()
        self.accelerations = [self.acceleration.copy()]

    def ask(self, setpoint: FloatArray) -> int:
        asked = np.ascontiguousarray(setpoint, float)
        held = int(filter_jerk(asked, self.history, self.all, T, self.motion, self.work))
        self.before = asked
        self.places.append(self.value.copy())
        self.velocities.append(self.velocity.copy())
        self.accelerations.append(self.acceleration.copy())
        self.held += held >= 0
        return held

    def excess(self) -> FloatArray:
        """By how many ulp third differences of places exceed the limit of jerk, (N,)."""
        places, speed = np.array(self.places), self.limits[2]
        third = np.abs(np.diff(places, 3, axis=0))
        far = np.abs(places).max(0) + 3 * np.minimum(speed * T, 1e300)
        return np.max((third - self.jerk * T**3) / np.spacing(far), axis=0, initial=0.0)

    def check(self) -> None:
        """All limits hold: of position strictly, and to some ulp as differences of it are seen."""
        places = np.array(self.places)
        lower, upper, speed, acceleration = self.limits
        assert np.all(lower <= places)  # between ticks it goes in a straight line
        assert np.all(places <= upper)
        far = np.spacing(np.abs(places).max(0) + 3 * np.minimum(speed * T, 1e300))
        seen = np.diff(places, axis=0)
        assert np.all(np.abs(seen) <= speed * T + ULPS * far)
        assert np.all(np.abs(np.diff(seen, axis=0)) <= acceleration * T**2 + ULPS * far)
        assert np.all(self.excess() <= ULPS)


def chirps(robot: JerkAttacked, step: int) -> FloatArray:
    """A wave as large as the range, ever faster, that starts anew every now and then."""
    lower, upper = np.clip(robot.limits[:2], -9.0, 9.0)
    t = T * (step % 3000) * (1.0 + np.arange(N))
    return 0.5 * (lower + upper) + 0.6 * (upper - lower) * np.sin(3.0 * t * (1.0 + t))


def near_the_stop(robot: JerkAttacked, step: int) -> FloatArray:
    """Just what can still be braked before a wall, a little more, or suddenly all the way back."""
    lower, upper, _, A = robot.limits
    robot.direction ^= robot.rng.random(N) < 0.003
    sign = np.where(robot.direction, 1.0, -1.0)
    wall = np.where(robot.direction, upper, lower)
    x = robot.rng.choice([1.0, 1.0, 0.5, -1.0, 0.0], N) * sign
    a = np.clip(robot.acceleration + x * robot.jerk * T, -A, A)
    goal = robot.value + (robot.velocity + a * T) * T
    goal += robot.rng.integers(-6, 7, N) * np.spacing(goal)
    return np.where(robot.rng.random(N) < 0.02, wall, goal)


def extremes(robot: JerkAttacked, _: int) -> FloatArray:
    """The largest and the smallest numbers, and the walls."""
    odd = [1.7e308, -1.7e308, 5e-324, 0.0, -0.0, 1e300, -1e-300]
    asked = robot.rng.choice(odd, N)
    wall = robot.limits[robot.rng.integers(2)]
    asked = np.where(robot.rng.random(N) < 0.3, np.nextafter(wall, asked), asked)
    return np.where(robot.rng.random(N) < 0.5, asked, robot.before)


JERK_ATTACKS = {
    attack.__name__: attack
    for attack in (noise, greedy, jitter, jumps, chirps, near_the_stop, extremes)
}
