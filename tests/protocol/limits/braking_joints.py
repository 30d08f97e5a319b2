"""Joints with limits of jerk, near and far from their walls, and what is asked of them."""

from __future__ import annotations

import numpy as np

from hoap3.protocol.limits.jerk_limits import kept_acceleration
from hoap3.protocol.messages import FloatArray
from hoap3.robot_emulator.filters.jerk_block_kernels import WORK
from hoap3.robot_emulator.filters.jerk_kernels import filter_jerk

T = 1e-3
Motion = tuple[FloatArray, FloatArray, FloatArray]


def braking_joints(rng: np.random.Generator, n: int) -> tuple[FloatArray, Motion, FloatArray]:
    """Limits (5, n), a motion q, v, a that some wild setpoints led to, and these, (3, n)."""
    middle, half = rng.uniform(-3, 3, n), 10.0 ** rng.uniform(-2, 0.5, n)
    speed, A = 10.0 ** rng.uniform(-1, 0.5, n), 10.0 ** rng.uniform(2, 3.5, n)
    J = A / (T * 10.0 ** rng.uniform(-0.5, 1.3, n))
    lower, upper = middle - half, middle + half
    A = kept_acceleration(lower, upper, speed, A, J, T)
    limits = np.ascontiguousarray([lower, upper, speed, A, J])
    q = rng.uniform(lower, upper)
    motion = np.array([q, np.zeros(n), np.zeros(n)])
    history, work, goal = np.tile(q, (3, 1)), np.full(WORK, np.nan), q
    for step in range(rng.integers(20, 300)):
        if step % 40 == 0:
            goal = np.where(
                rng.random(n) < 0.5, rng.uniform(lower, upper), rng.choice([-9.0, 9.0], n)
            )
        filter_jerk(goal, history, limits, T, motion, work)
    return limits, tuple(motion), history


def asked_of(
    rng: np.random.Generator, limits: FloatArray, at: Motion, history: FloatArray
) -> FloatArray:
    """Setpoints: half of them go on from a motion like the joint's own, some are far away.

    `history` becomes that of such motions.
    """
    (q, v, a), n, J = at, at[0].size, limits[4]
    own = a + J * T * rng.uniform(-1.1, 1.1, n)
    follows = rng.random(n) < 0.7
    for back, row in enumerate(history):
        row[follows] = (q - back * v * T + 0.5 * back * (back - 1) * a * T**2)[follows]
    near = q + (v + own * T) * T
    far = rng.uniform(limits[0] - 0.1, limits[1] + 0.1)
    return np.where(follows, near, far)


def rounding(limits: FloatArray, at: Motion) -> FloatArray:
    """How well an acceleration is known, (n,)."""
    lower, upper, speed, A, J = limits
    periods = 2.0 * speed / (A * T) + 2.0 * A / (J * T) + 4.0
    far = np.maximum(np.abs(lower), np.abs(upper)) + upper - lower
    return 1e-7 * J * T * periods + 2.0**-52 * far * (8.0 + periods) ** 2 / T**2
