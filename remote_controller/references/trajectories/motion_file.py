"""The rows of a motion: a CSV of times, positions, and what else it gives."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.config.regular_file import read_named
from hoap3.protocol.errors import ConfigError
from hoap3.protocol.messages import FloatArray

TIME = "t"
LONGEST_S = 86_400.0  # of a motion: a day
PARTS = ("position", "velocity", "acceleration")
QUATERNION = ("qx", "qy", "qz", "qw")
MAX_ROWS = 100_000
MAX_BYTES = 1 << 23
UNIT = 1e-3  # how far the length of a quaternion may be from 1


@dataclass(frozen=True)
class Motion:
    """Points at times.

    Attributes:
        names: what each column is of: joints, or axes.
        times_s: (k,), k ≥ 2, increasing from 0 or later [s].
        positions: (k, m).
        velocities, accelerations: the same, or None; NaN in columns for which none are given.
        lines: of the file, (k,).
        file: what errors call it.
    """

    names: tuple[str, ...]
    times_s: FloatArray
    positions: FloatArray
    velocities: FloatArray | None
    accelerations: FloatArray | None
    lines: NDArray[np.int64]
    file: str

    def refuse(self, row: int, name: str, value: object, problem: str, remedy: str) -> ConfigError:
        """An error about a number."""
        return ConfigError(
            self.file, f"line {self.lines[row]}, column {name}", value, problem, remedy
        )


def read_text(path: Path) -> str:
    """The content of a file.

    Raises:
        ConfigError: it cannot be read, is too large, or no text.
    """
    file = str(path)
    data = read_named(path, MAX_BYTES, file, "a CSV file")
    if len(data) > MAX_BYTES:
        raise ConfigError(file, "", None, f"is larger than {MAX_BYTES >> 20} MiB", "Leave rows out")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        problem = f"is not UTF-8: {error}"
        remedy = "Save it as UTF-8, or name a log *.mcap"
        raise ConfigError(file, "", None, problem, remedy) from error


def read_motion(text: str, file: str, known: Sequence[str], *, turns: bool = False) -> Motion:
    """The motion that a CSV says.

    The first column is `t` [s]. Another one is a name, or `name/position`, `name/velocity`,
    `name/acceleration`. Columns may stand in any order; the motion has them in that of `known`.

    Args:
        text: of the file.
        file: what errors call it.
        known: names that may be there.
        turns: whether qx, qy, qz, qw may be there as well, an orientation; as rotation vectors
            they become the columns rx, ry, rz [rad], behind the others.

    Raises:
        ConfigError: naming the file, the line, the column and the value.
    """
    rows = _rows(text, file)
    header = [name.strip() for name in rows[0][1]]
    accepted = (*known, *QUATERNION) if turns else tuple(known)
    columns = _columns(header, file, rows[0][0], accepted)
    table = np.array([_numbers(row, header, file, line) for line, row in rows[1:]])
    lines = np.array([line for line, _ in rows[1:]])
    if len(table) < 2:
        remedy = "A motion needs two or more: where it is at some time, and where later"
        raise ConfigError(file, "", len(table), "has too few rows", remedy)
    _check_times(table[:, 0], lines, file)
    names = tuple(name for name in known if name in columns[0])
    parts: list[FloatArray | None] = []
    for given in columns:
        there = [given[name] for name in names if name in given]
        parts.append(table[:, there] if there else None)
    positions, velocities, accelerations = parts
    if columns[0].keys() >= set(QUATERNION):
        quaternions = table[:, [columns[0][name] for name in QUATERNION]]
        turned = _rotation_vectors(quaternions, lines, file)
        names = (*names, "rx", "ry", "rz")
        positions = turned if positions is None else np.hstack([positions, turned])
        velocities, accelerations = (
            None if each is None else np.hstack([each, np.full_like(turned, np.nan)])
            for each in (velocities, accelerations)
        )
    if positions is None:
        raise ConfigError(file, "line 1", None, "has no column of positions", _remedy(known))
    return Motion(names, table[:, 0].copy(), positions, velocities, accelerations, lines, file)


def _rows(text: str, file: str) -> list[tuple[int, list[str]]]:
    """Lines with their numbers; the first is the header."""
    try:
        lines = csv.reader(io.StringIO(text, newline=""), strict=True)
        rows = [(lines.line_num, row) for row in lines if row]
    except csv.Error as error:
        raise ConfigError(file, "", None, f"is not CSV: {error}", "Save it as CSV") from error
    if not rows:
        raise ConfigError(file, "", None, "is empty", f"The first line is {TIME},NAME,…")
    if len(rows) > MAX_ROWS + 1:
        raise ConfigError(file, "", None, f"has more than {MAX_ROWS} rows", "Leave some out")
    return rows


def _columns(
    header: list[str], file: str, line: int, known: Sequence[str]
) -> tuple[dict[str, int], dict[str, int], dict[str, int]]:
    """Where positions, velocities and accelerations are, by name."""
    where = f"line {line}"
    if header[:1] != [TIME]:
        remedy = f"The first line is {TIME},NAME,… with the time [s] in the first column"
        raise ConfigError(file, where, header[0], "is not the time", remedy)
    found: tuple[dict[str, int], dict[str, int], dict[str, int]] = ({}, {}, {})
    for place, title in enumerate(header[1:], 1):
        name, _, part = title.partition("/")
        part = part or PARTS[0]
        if name not in known or part not in PARTS:
            raise ConfigError(file, where, title, "is no column of this motion", _remedy(known))
        if name in QUATERNION and part != PARTS[0]:
            raise ConfigError(file, where, title, "is not read", "Leave the column out")
        given = found[PARTS.index(part)]
        if name in given:
            raise ConfigError(file, where, title, "is there twice", "Leave one out")
        given[name] = place
    if 0 < len(set(found[0]) & set(QUATERNION)) < len(QUATERNION):
        problem = "has a part of a quaternion"
        raise ConfigError(file, where, ",".join(header), problem, "Give qx, qy, qz and qw")
    wanted = {name for name in found[0] if name not in QUATERNION}
    for given, part in zip(found[1:], PARTS[1:], strict=True):
        if given and given.keys() != wanted:
            odd = sorted(given.keys() ^ wanted)[0]
            problem = f"columns have a {part} and others have none"
            raise ConfigError(file, where, odd, problem, f"Give {NAME_OF[part]} of all, or of none")
    if found[2] and not found[1]:
        problem = "has accelerations without velocities"
        raise ConfigError(file, where, ",".join(header), problem, "Give both, or leave them out")
    return found


NAME_OF = {part: f"NAME/{part}" for part in PARTS}


def _remedy(known: Sequence[str]) -> str:
    return (
        f"Columns are NAME, NAME/velocity and NAME/acceleration of: {', '.join(known) or 'nothing'}"
    )


def _numbers(row: list[str], header: list[str], file: str, line: int) -> list[float]:
    if len(row) != len(header):
        problem, remedy = f"has {len(row)} values", f"Give {len(header)}, one for each column"
        raise ConfigError(file, f"line {line}", ",".join(row), problem, remedy)
    values: list[float] = []
    for name, text in zip(header, row, strict=True):
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            where = f"line {line}, column {name}"
            raise ConfigError(file, where, text, "is not a finite number", "Write one")
        values.append(value)
    return values


def _check_times(times: FloatArray, lines: NDArray[np.int64], file: str) -> None:
    where = "line {}, column " + TIME
    if times[-1] > LONGEST_S:
        problem = f"is later than {LONGEST_S:g} s after the begin"
        remedy = "Count from the begin: of times of a clock subtract the first one"
        raise ConfigError(file, where.format(lines[-1]), float(times[-1]), problem, remedy)
    if times[0] < 0.0:
        problem, remedy = "time is negative", "Begin at 0 or later"
        raise ConfigError(file, where.format(lines[0]), float(times[0]), problem, remedy)
    for row in np.flatnonzero(np.diff(times) <= 0.0)[:1] + 1:
        problem = f"time does not increase: the row before has {float(times[row - 1])!r}"
        remedy = "Sort the rows by time, and leave out what stands twice"
        raise ConfigError(file, where.format(lines[row]), float(times[row]), problem, remedy)


def _rotation_vectors(quaternions: FloatArray, lines: NDArray[np.int64], file: str) -> FloatArray:
    """Axis × angle of quaternions (x, y, z, w), each the one nearest to that before, (k, 3)."""
    lengths = np.linalg.norm(quaternions, axis=1)
    for row in np.flatnonzero(~(np.abs(lengths - 1.0) <= UNIT))[:1]:
        where = f"line {lines[row]}, column {QUATERNION[0]}"
        problem = f"quaternion has the length {lengths[row]:.6g}, not 1"
        raise ConfigError(file, where, quaternions[row].tolist(), problem, "Divide it by that")
    found = np.zeros((len(quaternions), 3))
    last = np.zeros(3)
    for row, q in enumerate(quaternions / lengths[:, None]):
        last = found[row] = nearest_vector(q, last)
    return found


def nearest_vector(q: FloatArray, near: FloatArray) -> FloatArray:
    """Of all rotation vectors of a unit quaternion (x, y, z, w) the one nearest to another, (3,).

    They are (θ + 2πk)·a for the axis a and the angle θ.
    """
    sine = float(np.linalg.norm(q[:3]))
    if sine > 0.0:
        axis, angle = q[:3] / sine, 2.0 * math.atan2(sine, q[3])
    else:
        length = float(np.linalg.norm(near))
        axis, angle = (near / length if length else np.zeros(3)), 0.0
    turns = round((float(axis @ near) - angle) / (2.0 * math.pi))
    return np.asarray(axis * (angle + 2.0 * math.pi * turns), float)
