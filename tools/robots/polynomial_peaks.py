"""Where many polynomials are least and greatest on [0, 1]."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

HALVINGS = 52  # of an interval: then its ends are neighbours
MOST = 100_000  # polynomials at a time


def derivative(c: Array) -> Array:
    """Coefficients of the derivative: (d + 1, …) of 1, z … become (d, …)."""
    return np.asarray(c[1:] * np.arange(1.0, len(c)).reshape(-1, *[1] * (c.ndim - 1)), float)


def value(c: Array, z: Array) -> Array:
    """Of each polynomial, (d + 1, N), at z, (…, N)."""
    found = np.zeros_like(z)
    for each in c[::-1]:
        found = found * z + each
    return found


def peaks(c: Array) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """(z, value) of the least, and of the greatest, value of each polynomial on [0, 1], (N,) each.

    Args:
        c: coefficients of 1, z, z² …, (d + 1, N).
    """
    parts = [_peaks(c[:, first : first + MOST]) for first in range(0, c.shape[1], MOST)]
    (least, low), (most, high) = (
        tuple(np.concatenate([part[end][i] for part in parts]) for i in range(2))
        for end in range(2)
    )
    return (least, low), (most, high)


def _peaks(c: Array) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    z = _turns(c)
    values = value(c, z)
    each = np.arange(c.shape[1])
    low, high = values.argmin(0), values.argmax(0)
    return (z[low, each], values[low, each]), (z[high, each], values[high, each])


def _turns(c: Array) -> Array:
    """0, 1 and points between, (p, N), from one to the next of which c only rises or only falls."""
    ends = np.zeros((1, c.shape[1])), np.ones((1, c.shape[1]))
    if len(c) <= 2:
        return np.vstack(ends)
    slope = derivative(c)
    edges = _turns(slope)
    low, high = edges[:-1].copy(), edges[1:].copy()
    before = value(slope, low)
    crossed = before * value(slope, high) < 0.0
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        left = np.sign(value(slope, middle)) == np.sign(before)
        low, high = np.where(left, middle, low), np.where(left, high, middle)
    return np.vstack([ends[0], np.where(crossed, low, edges[:-1]), ends[1]])
