"""Three moments of a motion that are shown in space: its start, its worst tick, its end."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.messages import FloatArray
from hoap3.protocol.robot.description import RobotDescription
from hoap3.tools.analysis.canvas import BEYOND
from hoap3.tools.analysis.numbers import number
from hoap3.tools.logs.disk_rows import parts

ROUNDING = 1e-9  # of a margin: nearer to 0 is inside
MORE = 1.01  # times the first error: that it is the largest one says something


@dataclass(frozen=True, eq=False)
class Moment:
    """The robot at one tick.

    Attributes:
        name: "start", "worst" or "end".
        tick: of its State.
        time_s: since the first tick that asked for an answer.
        q: (n,) joint positions [rad or m].
        base: (13,) of a free base, as in its State; empty without one.
        why: what is worst, in words; "" of the others.
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
    unit: str,
    description: RobotDescription,
) -> list[Moment]:
    """Return the first State, the worst one, and the last one, as far as they can be drawn.

    Args:
        active: States of the motion, rows of a log, at least one.
        answered: (k,), those that were answered.
        v: (k,), V; NaN without a certificate.
        margin: (k,), smallest margin; NaN where it is not known.
        unit: of √(2V), "" where it is not known.
        description: of the robot.
    """
    start = int(active["stamp_intended"][0])
    found = [_moment("start", active[0], start)]
    worst = _worst(answered, v, margin, unit) or _nearest_to_a_limit(active, description)
    if worst is not None:
        row, why = worst
        found.append(_moment("worst", row, start, why))
    found.append(_moment("end", active[-1], start))
    return [moment for moment in found if _can_be_drawn(moment)]


def _moment(name: str, row: Any, start: int, why: str = "") -> Moment:
    names = row.dtype.names
    base = np.array(row["base"], float) if "base" in names else np.empty(0)
    time_s = (int(row["stamp_intended"]) - start) / 1e9
    return Moment(name, int(row["tick"]), time_s, np.array(row["q"], float), base, why)


def _can_be_drawn(moment: Moment) -> bool:
    figures = np.concatenate((moment.q, moment.base))
    return bool((np.abs(figures) < BEYOND).all())  # not so of NaN


def _worst(answered: Any, v: FloatArray, margin: FloatArray, unit: str) -> tuple[Any, str] | None:
    """A row, and what is worst there: the first of these that says something.

    A margin that is violated; an error that is larger than the first one, as of a target that
    moves; the smallest margin.
    """
    margin, error = _known(margin), np.sqrt(2.0 * np.maximum(_known(v), 0.0))
    least = _place(np.argmin, margin)
    most = _place(np.argmax, error)
    if least is not None and margin[least] < -ROUNDING:
        return answered[least], f"margin {number(float(margin[least]))}, outside"
    if most is not None and error[most] > MORE * error[np.isfinite(error)][0]:
        largest = number((1e3 if unit else 1.0) * float(error[most]))
        return answered[most], f"largest error, {largest}{' mm' if unit else ''}"
    if least is not None:
        return answered[least], f"smallest margin, {number(float(margin[least]))}"
    return None


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
    return active[row], f"{name} nearest to a limit, {number(100.0 * least)} %"


def range_used(positions: FloatArray, description: RobotDescription) -> FloatArray:
    """0 at the lower end of a joint's range, 1 at its upper one; nan where it has no range."""
    lower, room = description.lower, description.upper - description.lower
    ranged = np.isfinite(room)
    used = np.full(positions.shape, np.nan)
    used[:, ranged] = (positions[:, ranged] - lower[ranged]) / room[ranged]
    return used
