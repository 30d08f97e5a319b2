"""A reference under random limits, and those who want to drive it beyond them."""

from __future__ import annotations

import numpy as np

from hoap3.protocol.messages import FloatArray
from hoap3.robot_emulator.filters.position_kernels import filter_setpoint

N, T = 7, 1e-3


def random_limits(rng: np.random.Generator) -> FloatArray:
    """(4, N) limits from a robot's to odd ones: ranges of one step, brakes of minutes."""
    middle, half = rng.uniform(-3, 3, N), 10.0 ** rng.uniform(-2, 0.5, N)
    speed, acceleration = 10.0 ** rng.uniform(-1, 1, N), 10.0 ** rng.uniform(0, 3.5, N)
    odd = rng.integers(N)
    half[odd], speed[odd] = 10.0 ** rng.uniform(-6, 2), 10.0 ** rng.uniform(-3, 2)
    acceleration[odd] = 10.0 ** rng.uniform(-1, 6)
    middle[odd] *= rng.integers(2)
    return np.ascontiguousarray([middle - half, middle + half, speed, acceleration])


class Attacked:
    """A reference at rest somewhere within its limits, and all that became of it."""

    def __init__(
        self, seed: int, limits: FloatArray | None = None, start: FloatArray | None = None
    ) -> None:
        self.rng = rng = np.random.default_rng(seed)
        self.limits = random_limits(rng) if limits is None else np.ascontiguousarray(limits)
        self.value = rng.uniform(*self.limits[:2]) if start is None else start.copy()
        self.velocity = np.zeros(N)
        self.before = self.value.copy()
        self.direction = np.ones(N, bool)
        self.forget()

    def forget(self) -> None:
        """Keep only what the next check needs."""
        self.places = [self.value.copy()]
        self.velocities = [self.velocity.copy()]
        self.held = 0

    def ask(self, setpoint: FloatArray) -> int:
        """One period."""
        asked = np.ascontiguousarray(setpoint, float)
        held = int(filter_setpoint(asked, self.before, self.limits, T, self.value, self.velocity))
        self.before = asked
        self.places.append(self.value.copy())
        self.velocities.append(self.velocity.copy())
        self.held += held >= 0
        return held

    def check(self) -> None:
        """All limits hold: those of the reference's own motion strictly, and to 4 ulp as seen."""
        places, own = np.array(self.places), np.array(self.velocities)
        lower, upper, speed, acceleration = self.limits
        assert np.all(lower <= places)  # NaN is not; between ticks it goes in a straight line
        assert np.all(places <= upper)
        assert np.all(np.abs(own) <= speed)
        assert np.all(np.abs(np.diff(own, axis=0)) <= acceleration * T)
        ulp = np.spacing(np.abs(places) + 3 * speed * T)  # of q, near zero that of some steps
        seen = np.diff(places, axis=0)
        assert np.all(np.abs(seen) <= speed * T + 4 * np.maximum(ulp[1:], ulp[:-1]))
        change = np.abs(np.diff(seen, axis=0))
        around = np.maximum(np.maximum(ulp[2:], ulp[:-2]), ulp[1:-1])
        assert np.all(change <= acceleration * T**2 + 4 * around)


def noise(robot: Attacked, _: int) -> FloatArray:
    """Anything, near and far."""
    return robot.value + robot.rng.normal(size=N) * 10.0 ** robot.rng.uniform(-9, 3)


def greedy(robot: Attacked, _: int) -> FloatArray:
    """As fast as can be to one side, then as fast as can be to the other."""
    robot.direction ^= robot.rng.random(N) < 0.01
    return np.where(robot.direction, 1e300, -1e300)


def silence(robot: Attacked, _: int) -> FloatArray:
    """No numbers, or too large ones, or nothing new at all."""
    odd = [np.nan, np.inf, -np.inf, 1.7e308, -1.7e308]
    asked = robot.rng.uniform(*np.clip(robot.limits[:2], -9.0, 9.0))
    asked = np.where(robot.rng.random(N) < 0.5, robot.rng.choice(odd, N), asked)
    return np.where(robot.rng.random(N) < 0.5, asked, robot.before)


def jitter(robot: Attacked, step: int) -> FloatArray:
    """A tremble of all sizes about a wall."""
    wall = robot.limits[1 if step % 4000 < 2000 else 0]
    return wall + robot.rng.normal(size=N) * 10.0 ** robot.rng.uniform(-16, -3)


def jumps(robot: Attacked, step: int) -> FloatArray:
    """To a place, and after a while to another one, before the first is reached or after it."""
    if step % 137 == 0 or robot.rng.random() < 0.005:
        robot.goal = robot.rng.uniform(robot.limits[0], robot.limits[1])
    return robot.goal


def at_the_limit(robot: Attacked, _: int) -> FloatArray:
    """What is just allowed, give or take the last bits; ever faster, then ever slower."""
    robot.direction ^= robot.rng.random(N) < 0.01
    sign = np.where(robot.direction, 1.0, -1.0)
    _, _, speed, acceleration = robot.limits
    w = np.clip(robot.velocity + sign * acceleration * T, -speed, speed)
    goal = robot.value + w * T
    return goal + robot.rng.integers(-6, 7, N) * np.spacing(goal)


def mixture(robot: Attacked, step: int) -> FloatArray:
    """All of them, in turns of some length."""
    if step == 0 or robot.rng.random() < 0.05:
        robot.jump_at = step
        robot.other = robot.rng.choice([noise, greedy, silence, jitter, jumps, at_the_limit])
    return robot.other(robot, step - robot.jump_at)


ATTACKS = {
    attack.__name__: attack
    for attack in (noise, greedy, silence, jitter, jumps, at_the_limit, mixture)
}
