"""Three moments of a motion that are shown in space: its start, its worst tick, its end."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.messages import FloatArray
from hoap3.protocol.robot.description import RobotDescription
from hoap3.tools.analysis.canvas import BEYOND
from hoap3.tools.analysis.numbers import count, number, seconds
from hoap3.tools.logs.disk_rows import parts
from hoap3.tools.picture.poses import BASE

ROUNDING = 1e-9  # of a margin: nearer to 0 is inside
MORE = 1.01  # times the first error: that it is the largest one says something
LEAST = 1e-6  # of an error, in its unit; less is rounding, as where it is 0 at first
SEEN = 0.02  # rad or m: postures that differ by less look the same


@dataclass(frozen=True, eq=False)
class Moment:
    """The robot at one tick.

    Attributes:
        name: "start", "worst" or "end".
        tick: of its State.
        time_s: since the first tick that asked for an answer.
        q: (n,) joint positions [rad or m].
        base: (13,) of a free base, as in its State; empty without one.
        why: which quantity is worst here, with its value; "" where none is.
    """

    name: str
    tick: int
    time_s: float
    q: FloatArray
    base: FloatArray
    why: str = ""


def moments(
    active: Any,
    answered: Any,
    v: FloatArray,
    margin: FloatArray,
    units: tuple[str, str],
    description: RobotDescription,
    distance: tuple[Any, FloatArray] | None = None,
) -> list[Moment]:
    """Return the first State, the worst one, and the last one, as far as they can be drawn.

    A worst State that looks like the first or the last one is not drawn again: that one says that
    it is the worst.

    Args:
        active: States of the motion, rows of a log, at least one.
        answered: (k,), those that were answered.
        v: (k,), V; NaN without a certificate.
        margin: (k,), smallest margin; NaN where it is not known.
        units: of √(2V) and of the margin, "" where they are not known.
        description: of the robot.
        distance: States, and how far the point was from its target at each [m]; None where the
            target is not known.
    """
    start_ns = int(active["stamp_intended"][0])
    ends = [_moment("start", active[0], start_ns), _moment("end", active[-1], start_ns)]
    worst, alike = None, 0
    for row, why in _worst(active, answered, v, margin, units, description, distance):
        found = _moment("worst", row, start_ns, why)
        same = [place for place, end in enumerate(ends) if _look_alike(found, end)]
        if not same:
            ends.insert(1, found)
            worst = None
            break
        worst, alike = (found, same[0]) if worst is None else (worst, alike)
    if worst is not None:
        end, at = ends[alike], f" at {seconds(worst.time_s)} s, tick {count(worst.tick)}"
        at = "" if worst.tick == end.tick else at
        ends[alike] = replace(end, why=f"also the worst: {worst.why}{at}")
    return [moment for moment in ends if _can_be_drawn(moment)]


def _moment(name: str, row: Any, start: int, why: str = "") -> Moment:
    names = row.dtype.names
    base = np.array(row["base"], float) if "base" in names else np.empty(0)
    time_s = (int(row["stamp_intended"]) - start) / 1e9
    return Moment(name, int(row["tick"]), time_s, np.array(row["q"], float), base, why)


def _can_be_drawn(moment: Moment) -> bool:
    figures = np.concatenate((moment.q, moment.base))
    return bool((np.abs(figures) < BEYOND).all())  # not so of NaN


def _look_alike(one: Moment, other: Moment) -> bool:
    """Whether two pictures would show the same; not so of NaN."""
    near = np.abs(one.q - other.q) < SEEN
    return bool(near.all() and (np.abs(one.base[:BASE] - other.base[:BASE]) < SEEN).all())


def _worst(
    active: Any,
    answered: Any,
    v: FloatArray,
    margin: FloatArray,
    units: tuple[str, str],
    description: RobotDescription,
    distance: tuple[Any, FloatArray] | None,
) -> Iterator[tuple[Any, str]]:
    """Rows, and which quantity is worst there, the most telling one first.

    A margin that is violated, or a distance or error that is larger than the first one, as of a
    target that moves, is the only one. Else the smallest margin, and the joint that is nearest to
    a limit.
    """
    margin, what, (of_error, of_margin) = _known(margin), "largest error", units
    rows, error = answered, np.sqrt(2.0 * np.maximum(_known(v), 0.0))
    if distance is not None:
        rows, error = distance
        what, of_error = "largest distance to the target", "m"
    least = _place(np.argmin, margin)
    most = _place(np.argmax, error)
    stated = "" if least is None else _with_unit(float(margin[least]), of_margin, "its constraint")
    if least is not None and margin[least] < -ROUNDING:
        yield answered[least], f"constraint violated, margin {stated}"
    elif most is not None and error[most] > max(MORE * error[np.isfinite(error)][0], LEAST):
        scale, unit = (1e3, "mm") if of_error == "m" else (1.0, of_error)
        yield rows[most], f"{what} {_with_unit(scale * error[most], unit, 'the task')}"
    else:
        if least is not None:
            yield answered[least], f"smallest margin {stated}"
        nearest = _nearest_to_a_limit(active, description)
        if nearest is not None:
            yield nearest


def _with_unit(value: float, unit: str, of: str) -> str:
    return f"{number(float(value))} {unit or f'(unit of {of})'}"


def _known(values: FloatArray) -> FloatArray:
    """NaN instead of what no controller means."""
    return np.where(np.abs(values) < BEYOND, values, np.nan)


def _place(which: Any, values: FloatArray) -> int | None:
    """Of the least or greatest value that is known."""
    places: NDArray[np.intp] = np.flatnonzero(np.isfinite(values))
    return int(places[which(values[places])]) if len(places) else None


def _nearest_to_a_limit(active: Any, description: RobotDescription) -> tuple[Any, str] | None:
    least, nearest = np.inf, None
    for part in parts(len(active)):
        used = range_used(_known(active[part]["q"]), description)
        room = np.minimum(used, 1.0 - used)
        if np.isfinite(room).any() and np.nanmin(room) < least:
            at = divmod(int(np.nanargmin(room)), room.shape[1])
            least, nearest = float(room[at]), (part.start + at[0], at[1])
    if nearest is None:
        return None
    row, joint = nearest
    name = description.joint_names[joint]
    return active[row], f"{name} nearest to a limit, {number(100.0 * least)} % of its range"


def range_used(positions: FloatArray, description: RobotDescription) -> FloatArray:
    """0 at the lower end of a joint's range, 1 at its upper one; nan where it has no range."""
    lower, room = description.lower, description.upper - description.lower
    ranged = np.isfinite(room)
    used = np.full(positions.shape, np.nan)
    used[:, ranged] = (positions[:, ranged] - lower[ranged]) / room[ranged]
    return used
