"""A smooth curve through the rows of a CSV file."""

from __future__ import annotations

import csv
import io
import math
from bisect import bisect_right
from pathlib import Path

import numpy as np

from hoap3.protocol.config.regular_file import read_at_most
from hoap3.protocol.errors import ConfigError
from hoap3.protocol.messages import FloatArray
from hoap3.remote_controller.references.target import Target

COLUMNS = ["t", "x", "y", "z"]
MAX_ROWS = 100_000
MAX_BYTES = 1 << 24


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


def read_csv(path: Path, repeats: bool) -> tuple[FloatArray, FloatArray]:
    """Times, (k,) [s], and points, (k, 3) [m], of a CSV with the columns t, x, y, z.

    Raises:
        ConfigError: naming the file, the line and the value.
    """
    file = str(path)
    rows: list[list[float]] = []
    try:
        data = read_at_most(path, MAX_BYTES)
        if len(data) > MAX_BYTES:
            problem = f"is larger than {MAX_BYTES >> 20} MiB"
            raise ConfigError(file, "", None, problem, "Leave rows out")
        lines = csv.reader(io.StringIO(data.decode("utf-8-sig"), newline=""), strict=True)
        header = [name.strip() for name in next(lines, [])]
        if header != COLUMNS:
            remedy = f"The first line is {','.join(COLUMNS)}"
            raise ConfigError(file, "line 1", ",".join(header), "is another header", remedy)
        for row in lines:
            if row:
                rows.append(_numbers(row, file, lines.line_num, rows))
    except OSError as error:
        reason = error.strerror or "cannot be read"
        raise ConfigError(file, "", None, reason, "Name a CSV file that can be read") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise ConfigError(file, "", None, f"is not CSV: {error}", "Save it as UTF-8") from error
    if len(rows) < 2:
        raise ConfigError(file, "", len(rows), "has too few rows", "A curve needs two or more")
    if repeats and rows[0][1:] != rows[-1][1:]:
        problem = "the curve repeats, but ends elsewhere than it begins"
        remedy = f"End it at {rows[0][1:]}, or set repeat: false"
        raise ConfigError(file, "last row", rows[-1][1:], problem, remedy)
    table = np.array(rows)
    return table[:, 0].copy(), table[:, 1:].copy()


def _numbers(row: list[str], file: str, line: int, before: list[list[float]]) -> list[float]:
    where = f"line {line}"
    if len(before) >= MAX_ROWS:
        raise ConfigError(file, where, None, f"has more than {MAX_ROWS} rows", "Leave some out")
    if len(row) != len(COLUMNS):
        problem = f"has {len(row)} values"
        raise ConfigError(file, where, ",".join(row), problem, f"Write {','.join(COLUMNS)}")
    values: list[float] = []
    for name, text in zip(COLUMNS, row, strict=True):
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise ConfigError(file, where, text, f"{name} is not a number", "Write a finite one")
        values.append(value)
    if values[0] < 0.0 or (before and values[0] <= before[-1][0]):
        problem = "t does not increase" if before else "t is negative"
        raise ConfigError(file, where, row[0], problem, "Sort the rows by time, from 0 on")
    return values
