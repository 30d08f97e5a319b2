"""A smooth curve through points at given times."""

from __future__ import annotations

import math
from bisect import bisect_right

import numpy as np

from hoap3.protocol.messages import FloatArray
from hoap3.remote_controller.references.target import Target


class Spline(Target):
    """Cubic spline through points at given times; position, velocity and acceleration continuous.

    It begins and ends at rest. Before the first time it waits at the first point, and after the
    last one at the last, or it begins again where it `repeats`; then first and last point are the
    same, and nothing rests.

    Args:
        times_s: (k,), k ≥ 2, increasing [s].
        points: (k, m).
        repeats: whether it is a closed curve.
    """

    def __init__(self, times_s: FloatArray, points: FloatArray, repeats: bool = False) -> None:
        super().__init__(points.shape[1])
        slopes = clamped_slopes(times_s, points, repeats)
        width = np.diff(times_s)[:, None]
        mean = np.diff(points, axis=0) / width
        self._times = [float(t) for t in times_s]
        self._repeats = repeats
        self._last = points[-1].copy()
        self._coefficients = np.stack(
            [
                points[:-1],
                slopes[:-1],
                (3.0 * mean - 2.0 * slopes[:-1] - slopes[1:]) / width,
                (slopes[:-1] + slopes[1:] - 2.0 * mean) / width**2,
            ],
            axis=1,
        ).tolist()

    def follow(self, elapsed_s: float, position_out: FloatArray, velocity_out: FloatArray) -> None:
        """Write x_d and its velocity."""
        times, time = self._times, elapsed_s
        if self._repeats and time > times[0]:
            time = times[0] + math.fmod(time - times[0], times[-1] - times[0])
        segment = bisect_right(times, time) - 1
        if segment >= len(times) - 1:
            position_out[:] = self._last
            velocity_out[:] = 0.0
            return
        x = time - times[max(0, segment)] if segment >= 0 else 0.0
        a, b, c, d = self._coefficients[max(0, segment)]
        for i in range(self.dimension):
            position_out[i] = a[i] + x * (b[i] + x * (c[i] + x * d[i]))
            velocity_out[i] = b[i] + x * (2.0 * c[i] + 3.0 * x * d[i])
        if segment < 0:
            velocity_out[:] = 0.0


def clamped_slopes(times: FloatArray, points: FloatArray, repeats: bool) -> FloatArray:
    """Velocities at the points, (k, m), that make the acceleration continuous."""
    width = np.diff(times)[:, None]
    mean = np.diff(points, axis=0) / width
    pull = 3.0 * (width[1:] * mean[:-1] + width[:-1] * mean[1:])
    wide = width[:, 0]
    inner = len(times) - 2
    slopes = np.zeros_like(points)
    if not repeats:
        if inner:
            slopes[1:-1] = _tridiagonal(wide[1:], 2.0 * (wide[:-1] + wide[1:]), wide[:-1], pull)
        return slopes
    # first and last slope are one unknown more: solve for it by superposition
    seam_pull = 3.0 * (wide[0] * mean[-1] + wide[-1] * mean[0])
    seam = 2.0 * (wide[0] + wide[-1])
    if not inner:
        return slopes
    ends = np.zeros((inner, 1))
    ends[0] -= wide[1]
    ends[-1] -= wide[-2]
    both = _tridiagonal(wide[1:], 2.0 * (wide[:-1] + wide[1:]), wide[:-1], np.hstack([pull, ends]))
    free, bent = both[:, :-1], both[:, -1:]
    at_seam = (seam_pull - wide[-1] * free[0] - wide[0] * free[-1]) / (
        seam + wide[-1] * bent[0] + wide[0] * bent[-1]
    )
    slopes[0] = slopes[-1] = at_seam
    slopes[1:-1] = free + bent * at_seam
    return slopes


def _tridiagonal(
    below: FloatArray, middle: FloatArray, above: FloatArray, right: FloatArray
) -> FloatArray:
    """Solve rows below·x_{i−1} + middle·x_i + above·x_{i+1} = right; diagonally dominant."""
    middle, right = middle.copy(), right.copy()
    for i in range(1, len(middle)):
        factor = below[i] / middle[i - 1]
        middle[i] -= factor * above[i - 1]
        right[i] -= factor * right[i - 1]
    right[-1] /= middle[-1]
    for i in range(len(middle) - 2, -1, -1):
        right[i] = (right[i] - above[i] * right[i + 1]) / middle[i]
    return right
