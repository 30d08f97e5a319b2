"""Joints near and far from the ends of their ranges, and what is asked of them."""

from __future__ import annotations

import numpy as np

from hoap3.protocol.messages import FloatArray

T = 1e-3


def limited_joints(rng: np.random.Generator, n: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Limits (4, n), places q and velocities v; half of them brake along an end's limit."""
    middle, half = rng.uniform(-3, 3, n), 10.0 ** rng.uniform(-2, 0.5, n)
    speed, A = 10.0 ** rng.uniform(-1, 1, n), 10.0 ** rng.uniform(1.5, 3.5, n)
    lower, upper = middle - half, middle + half
    v = rng.choice([-1.0, 1.0], n) * rng.random(n) * speed
    near = v * v / A * 10.0 ** rng.uniform(-1, 1, n)
    end = np.where(v > 0.0, upper - near, lower + near)
    q = np.where(rng.random(n) < 0.5, np.clip(end, lower, upper), rng.uniform(lower, upper))
    return np.ascontiguousarray([lower, upper, speed, A]), q, v


def asked(
    rng: np.random.Generator, limits: FloatArray, q: FloatArray, v: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Setpoints and those before: most in reach, some far away, some jumps."""
    n, change = q.size, limits[3] * T
    w = v + change * rng.uniform(-1.1, 1.1, n)
    own = w + change * rng.uniform(-1.1, 1.1, n)
    s = np.where(rng.random(n) < 0.7, q + w * T, rng.uniform(limits[0] - 0.1, limits[1] + 0.1))
    return s, s - own * T + (rng.random(n) < 0.1) * rng.normal(size=n)


def rounding(limits: FloatArray, q: FloatArray) -> FloatArray:
    """How well a speed is known: 1e-10 of the greatest, and the room kept for rounding over T.

    That room is 8 units in the last place of where it brakes to, and of the way, a step.
    """
    lower, upper, speed, A = limits
    steps, far = speed / (A * T) + 2.0, np.maximum(np.abs(lower), np.abs(upper))
    return 1e-10 * speed + 8.0 * 2.0**-52 * steps * (far + upper - lower) / T
