"""The rows of a motion: a CSV of times, positions, and what else it gives."""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote, unquote

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.config.regular_file import read_named
from hoap3.protocol.errors import ConfigError, did_you_mean
from hoap3.protocol.messages import FloatArray

TIME = "t"
LONGEST_S = 86_400.0  # of a motion: a day
PARTS = ("position", "velocity", "acceleration")
QUATERNION = ("qx", "qy", "qz", "qw")
MAX_ROWS = 100_000
MAX_BYTES = 1 << 23
UNIT = 1e-3  # how far the length of a quaternion may be from 1
SEPARATORS = {";": "semicolons", "\t": "tabs", "|": "bars", " ": "blanks"}
COMMENTS = ("#", "%", "//")
_OTHER_FORMAT = re.compile(r"\s*(?:[\[{<]|---)|[^,;\t|]*:\s*$")
UNITS = {"milliseconds": "1e3", "microseconds": "1e6", "nanoseconds": "1e9"}


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
        remedy = "Save it as CSV in UTF-8, or name a log *.mcap"
        raise ConfigError(file, "", None, problem, remedy) from error


def read_motion(text: str, file: str, known: Sequence[str], *, turns: bool = False) -> Motion:
    """The motion that a CSV says.

    The first column is `t` [s]. Another one is a name, or `name/position`, `name/velocity`,
    `name/acceleration`. Columns may stand in any order; the motion has them in that of `known`.
    Names may be percent-encoded, as must be one of `known` that another column could be, too:
    `arm%2Fvelocity` is the name `arm/velocity`.

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
    _check_format(rows, file)
    columns = _columns(header, file, rows[0][0], known, QUATERNION if turns else ())
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
    if turns and columns[0].keys() >= set(QUATERNION):
        quaternions = table[:, [columns[0][name] for name in QUATERNION]]
        turned = _rotation_vectors(quaternions, lines, file)
        names = (*names, "rx", "ry", "rz")
        positions = turned if positions is None else np.hstack([positions, turned])
        velocities, accelerations = (
            None if each is None else np.hstack([each, np.full_like(turned, np.nan)])
            for each in (velocities, accelerations)
        )
    if positions is None:
        raise ConfigError(file, "line 1", None, "has no column of positions", _remedy("", known))
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


def _check_format(rows: list[tuple[int, list[str]]], file: str) -> None:
    """Refuse what is not a table with commas whose first column is the time."""
    line, header = rows[0]
    first = header[0].strip()
    comments = [(line, row) for line, row in rows if row[0].lstrip().startswith(COMMENTS)]
    signs = [name for sign, name in SEPARATORS.items() if sign in first and len(header) == 1]
    problem, remedy = "is not the time", f"Call it {TIME}, in seconds"
    if comments:
        line, header = comments[0]
        problem, remedy = "is a comment", f"Remove lines that begin with {' or '.join(COMMENTS)}"
    elif _OTHER_FORMAT.match(first):
        problem, remedy = "is not CSV", "Only CSV and logs *.mcap are read"
    elif signs:
        problem = f"has {signs[0]} between its columns"
        remedy = "Separate columns by commas, and write a decimal point"
    elif first == TIME:
        return
    elif {"log_time", "tick"} <= {*header}:
        remedy = "Take the motion from the log itself: hoap3 trajectory from LOG"
    remedy = f"{remedy}. The first line is {TIME},NAME,… with the time [s] in the first column"
    raise ConfigError(file, f"line {line}", header[0], problem, remedy)


def column_title(name: str) -> str:
    """Return how a file names the positions of a joint, so that nothing else has that name."""
    return quote(name, safe="") if name.rpartition("/")[2] in PARTS else name


def _meanings(title: str, known: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Yield each name and part that a column can be of."""
    if title in known or (unquote(title) in known and "/" not in title):
        yield unquote(title), PARTS[0]
    name, _, part = title.rpartition("/")
    if unquote(name) in known and part in PARTS:
        yield unquote(name), part


def are_columns(text: str, known: Sequence[str]) -> bool:
    """Return whether all columns of a CSV but the first can be of these names."""
    try:
        header = next(filter(None, csv.reader(io.StringIO(text, newline=""))), [])
    except csv.Error:
        return False
    return len(header) > 1 and all(any(_meanings(title.strip(), known)) for title in header[1:])


def _columns(
    header: list[str], file: str, line: int, names: Sequence[str], turns: Sequence[str]
) -> tuple[dict[str, int], dict[str, int], dict[str, int]]:
    """Where positions, velocities and accelerations are, by name."""
    where, known = f"line {line}", (*names, *turns)
    found: tuple[dict[str, int], dict[str, int], dict[str, int]] = ({}, {}, {})
    meanings = [[*_meanings(title, known)] for title in header[1:]]
    certain = [each[0] for each in meanings if len(each) == 1]
    for place, (title, each) in enumerate(zip(header[1:], meanings, strict=True), 1):
        left = [meaning for meaning in each if meaning not in certain] or each
        if not left:
            raise ConfigError(
                file, where, title, "is no column of this motion", _remedy(title, known)
            )
        if len(left) > 1:
            (whole, _), (name, part) = left
            problem = f"may be the joint {whole!r}, or the {part} of {name!r}"
            remedy = f"Write {column_title(whole)} or %{ord(name[0]):X}{name[1:]}/{part}"
            raise ConfigError(file, where, title, problem, remedy)
        name, part = left[0]
        if name in turns and part != PARTS[0]:
            raise ConfigError(file, where, title, "is not read", "Leave the column out")
        given = found[PARTS.index(part)]
        if name in given:
            raise ConfigError(file, where, title, "is there twice", "Leave one out")
        given[name] = place
    if 0 < len(set(found[0]) & set(turns)) < len(turns):
        problem = "has a part of a quaternion"
        raise ConfigError(file, where, ",".join(header), problem, "Give qx, qy, qz and qw")
    wanted = {name for name in found[0] if name not in turns}
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


def _remedy(title: str, known: Sequence[str]) -> str:
    inside = next((f"Did you mean {part!r}?" for part in title.split("/") if part in known), "")
    guess = inside or did_you_mean(title, known)
    return (
        f"{guess} Columns are NAME, NAME/velocity and NAME/acceleration of: "
        f"{', '.join(known) or 'nothing'}"
    ).lstrip()


def _numbers(row: list[str], header: list[str], file: str, line: int) -> list[float]:
    if len(row) != len(header):
        problem = f"has {len(row)} values"
        remedy = f"Give {len(header)}, one for each column, with a decimal point, not a comma"
        raise ConfigError(file, f"line {line}", ",".join(row), problem, remedy)
    values: list[float] = []
    for name, text in zip(header, row, strict=True):
        try:
            value = float(text) if text.isascii() and "_" not in text else math.nan
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            where, remedy = f"line {line}, column {name}", "Write digits, such as -0.5 or 1e-3"
            raise ConfigError(file, where, text, "is not a finite number", remedy)
        values.append(value)
    return values


def _check_times(times: FloatArray, lines: NDArray[np.int64], file: str) -> None:
    where = "line {}, column " + TIME
    if times[-1] > LONGEST_S:
        problem = f"is later than {LONGEST_S:g} s after the begin"
        clocks = [
            f"these are {name}: divide by {one}"
            for name, one in UNITS.items()
            if 1e9 <= times[0] / float(one) < 1e10  # since 1970
        ]
        units = clocks or [f"divide {name} by {one}" for name, one in UNITS.items()]
        remedy = f"Count seconds from the begin: subtract the first time; {', '.join(units)}"
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
