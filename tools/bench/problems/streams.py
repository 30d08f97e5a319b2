"""Streams of problems that change a little at every call, as those of a loop do."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

STREAM = 512

Array = NDArray[np.float64]


def gradients(n: int, seed: int = 0) -> list[tuple[Array, float]]:
    """Positive gradients, (n,), and the decrease that each shall reach."""
    walk = np.abs(_walk(n, seed))
    return [(a, 0.1 * float(np.linalg.norm(a))) for a in walk]


def jacobians(n: int, seed: int = 1) -> list[tuple[Array, Array]]:
    """Jacobians of a task with three rows, (3, n), and its errors, (3,)."""
    walk = _walk(3 * n + 3, seed)
    return [(row[: 3 * n].reshape(3, n), row[3 * n :]) for row in walk]


def _walk(width: int, seed: int) -> Array:
    """A random walk, (STREAM, width), to and fro: walked through again it has no jump."""
    rng = np.random.default_rng(seed)
    steps = np.cumsum(rng.normal(scale=0.02, size=(STREAM // 2, width)), axis=0)
    walk = rng.normal(size=width) + steps
    return np.ascontiguousarray(np.vstack([walk, walk[::-1]]))
