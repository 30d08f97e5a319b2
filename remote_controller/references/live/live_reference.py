"""Curves through the points of chunks in plain numpy: `live_kernels` is compared with it.

The natural cubic spline has continuous second derivatives a, which solve one linear system, with
a = 0 at both ends. Between two nodes is the polynomial of fifth degree that has their positions,
rates and accelerations: six equations for six coefficients.
"""

from __future__ import annotations

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import NDArray

Array = NDArray[np.float64]


def spline_nodes(step: float, points: Array) -> tuple[Array, Array]:
    """Rates and accelerations of the natural cubic spline, (p, d) each."""
    count = len(points)
    A, right = np.eye(count), np.zeros_like(points)
    for i in range(1, count - 1):
        A[i, i - 1 : i + 2] = step / 6.0, 2.0 * step / 3.0, step / 6.0
        right[i] = (points[i + 1] - 2.0 * points[i] + points[i - 1]) / step
    bends: Array = np.asarray(np.linalg.solve(A, right), np.float64)
    slopes = np.diff(points, axis=0) / step
    rates = slopes - step / 6.0 * (2.0 * bends[:-1] + bends[1:])
    last: Array = slopes[-1] + step / 6.0 * (bends[-2] + 2.0 * bends[-1])
    return np.vstack([rates, last]), bends


def difference_nodes(step: float, rates: Array) -> Array:
    """Accelerations by central differences of rates, one-sided at the ends, (p, d)."""
    return np.asarray(np.gradient(rates, step, axis=0))


def curve_at(elapsed: float, step: float, nodes: Array, d: int) -> Array:
    """Position, rate, acceleration and jerk at a time after the first node, (4, d)."""
    elapsed = min(max(elapsed, 0.0), step * (len(nodes) - 1))
    i = min(int(elapsed / step), len(nodes) - 2)
    ends = nodes[i : i + 2].reshape(2, 3, d)
    powers = [Polynomial([0.0] * k + [1.0]) for k in range(6)]
    A = [[power.deriv(k)(z) for power in powers] for z in (0.0, 1.0) for k in range(3)]
    units = np.array([1.0, step, step**2])[:, None]
    coefficients = np.linalg.solve(np.array(A), (ends * units).reshape(6, d))
    z = elapsed / step - i
    rows = [[power.deriv(k)(z) / step**k for power in powers] for k in range(4)]
    return np.asarray(np.array(rows) @ coefficients)
