"""What it means that an acceleration can be held: by definition, not by formula."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hoap3.protocol.messages import FloatArray


@dataclass
class States:
    """Many joints at once, all of them in a state from which they can stop.

    `above` and `below` are the rooms D and d, exact: one of the two limits is 0.
    """

    q: FloatArray
    v: FloatArray
    above: FloatArray
    below: FloatArray
    lower: FloatArray
    upper: FloatArray
    speed: FloatArray
    up: FloatArray
    down: FloatArray
    T: float

    @property
    def limits(self) -> tuple[FloatArray, ...]:
        return self.lower, self.upper, self.speed, self.up


def random_states(rng: np.random.Generator, n: int, T: float, *, even: bool = True) -> States:
    """States from which a joint can stop; every fourth on the edge, every eighth at a wall."""
    span, speed = 10.0 ** rng.uniform(-1.5, 1.5, n), 10.0 ** rng.uniform(-1, 1, n)
    most = np.minimum(speed / T, span / T**2)
    tight = rng.random(n) < 0.1
    up = most * np.where(tight, 1.0, 10.0 ** rng.uniform(-4, 0, n))
    down = up.copy()
    if not even:
        down = up * rng.uniform(0.1, 1.0, n)
        up, down = np.where(rng.random(n) < 0.5, (up, down), (down, up))
        slow, fast = np.minimum(up, down), np.maximum(up, down)
        fits = span >= 0.5 * T**2 * fast * (1.0 + fast / slow)
        up, down = np.where(fits, up, slow), np.where(fits, down, slow)
    share = rng.random(n)
    share[::8] = rng.integers(0, 2, n)[::8]
    near = rng.random(n) < 0.3
    share[near] = 10.0 ** rng.uniform(-12, 0, n)[near]
    at_top = rng.random(n) < 0.5
    above = np.where(at_top, span * share, span - span * share)
    lower, upper = np.where(at_top, -span, 0.0), np.where(at_top, 0.0, span)
    q = np.where(at_top, -span * share, span * share)
    above, below = upper - q, q - lower
    fastest = np.minimum(speed, np.sqrt(2.0 * down * above))
    slowest = -np.minimum(speed, np.sqrt(2.0 * up * below))
    v = slowest + rng.random(n) * (fastest - slowest)
    v[::4], v[1::16], v[2::16] = fastest[::4], slowest[1::16], 0.0
    return States(q, v, above, below, lower, upper, speed, up, down, T)
