"""Compiled kernels beside strict IEEE arithmetic: the same source, an operation at a time.

A compiler that fuses a product and a sum (FMA), or keeps more digits in between, gives other bits.
Python rounds each result to a double, and knows nothing else.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .few_bits import FUNCTIONS, sources
from .transcribed import transcribed

BATCH = 1000
SEED = 20

Vector = NDArray[np.float64]


def random_states(rng: np.random.Generator, n: int) -> tuple[Vector, Vector, Vector, float]:
    """Joints of all magnitudes that the theorem is about, and what is asked of them.

    Returns:
        Limits, (4, n); places and velocities within them, (2, n); setpoints now and before, (2, n);
        the period.
    """
    T = 10.0 ** rng.uniform(-4, -1)
    speed = 10.0 ** rng.uniform(-3, 2, n)
    ratio = 2.0 ** rng.uniform(-10, 20, n)  # of speed and A·T
    acceleration = np.clip(speed / (ratio * T), 1e-2, 1e5)
    lower, upper = np.sort(rng.uniform(-1, 1, (2, n)) * 10.0 ** rng.uniform(-4, 2, n), axis=0)
    q = rng.uniform(lower, upper)
    lower[rng.random(n) < 0.05] = -np.inf
    upper[rng.random(n) < 0.05] = np.inf
    v = speed * rng.uniform(-1, 1, n) * rng.integers(0, 2, n)
    step = acceleration * T
    steps = v + step * rng.choice([-1.0, 0.0, 1.0, 0.3], n)
    setpoint = np.where(rng.random(n) < 0.5, q + steps * T, rng.uniform(-100, 100, n))
    before = np.where(rng.random(n) < 0.7, setpoint - steps * T, rng.uniform(-100, 100, n))
    odd = np.array([np.nan, np.inf, -np.inf, 5e-324, -2.5e-310, 0.0, -0.0, 1e308])
    for asked in (setpoint, before):
        some = rng.random(n) < 0.05
        asked[some] = rng.choice(odd, int(some.sum()))
    limits = np.ascontiguousarray([lower, upper, speed, acceleration])
    return limits, np.array([q, v]), np.array([setpoint, before]), T


def differing(states: int) -> tuple[int, int]:
    """Run states through the compiled filter and through the strict one.

    Returns:
        How many were run, and how many came out with other bits.
    """
    from hoap3.robot_emulator.filters.position_kernels import filter_setpoint

    names = transcribed(sources(), FUNCTIONS)
    follow, JointLimits = names["follow_one"], names["JointLimits"]
    rng, run, wrong = np.random.default_rng(SEED), 0, 0
    while run < states:
        limits, (q, v), (setpoint, before), T = random_states(rng, BATCH)
        strict = np.array(
            [
                follow(s, b, place, speed, JointLimits(*own), T)
                for s, b, place, speed, own in zip(
                    setpoint.tolist(), before.tolist(), q.tolist(), v.tolist(), limits.T.tolist(),
                    strict=True,
                )
            ]
        )  # fmt: skip
        value, velocity = q.copy(), v.copy()
        filter_setpoint(setpoint.copy(), before.copy(), limits, T, value, velocity)
        ours = np.array([value, velocity]).T
        wrong += int((ours.view(np.int64) != strict.view(np.int64)).any(axis=1).sum())
        run += BATCH
    return run, wrong
