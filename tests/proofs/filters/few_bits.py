"""The law of the setpoint filter in few bits: every place, velocity, setpoint and predecessor.

Positions are whole numbers of cells, a cell being the unit in the last place at 1. Of a result x
the nearest number of p bits is taken, as of doubles that of 53. For everything that satisfies the
invariant, the next place is within the range, and the motion within speed and acceleration up to
`UNITS` in the last place; and it satisfies the invariant again.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any, NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from .transcribed import source_of, transcribed

MODULES = (
    "hoap3.protocol.limits.setpoint_limits_kernels",
    "hoap3.robot_emulator.filters.position_kernels",
)
FUNCTIONS = (
    "within", "rounding", "stopping_speed", "brake_reserve", "approach_speed", "own_start",
    "taken_over", "follow_one",
)  # fmt: skip
UNITS = 2.0
"""Of 2^(1 − p) of |q| + 3VT, by which a step may differ from its velocity times T."""

OPEN = 64.0
"""Cells that are looked at of a range without an end."""

MARGIN_ULPS = 8.0
"""What braking leaves of the acceleration, in units of the last place: 4504 of doubles."""

Vector = NDArray[np.float64]
Run = Callable[..., tuple[int, int, int]]


class Case(NamedTuple):
    """Limits, in cells and periods.

    Attributes:
        lower, upper: of positions [cells].
        speed: greatest velocity [cells a period].
        change: greatest change of it [cells a period].
        T: period.
    """

    lower: float
    upper: float
    speed: float
    change: float
    T: float


class Result(NamedTuple):
    """What came of a case.

    Attributes:
        looked_at: transitions.
        states: places and velocities that satisfy the invariant.
        wrong: what does not hold, or "".
    """

    looked_at: int
    states: int
    wrong: str


def cases(bits: int) -> dict[str, Case]:
    """What is looked at, by name."""
    one = 2.0 ** (bits - 1)
    return {
        "around 0": Case(-24.0, 24.0, 6.0, 6.0, 0.0625),
        "around 0, weak": Case(-30.0, 30.0, 6.3, 1.7, 0.1),
        "from 1": Case(one, one + 64.0, 8.0, 8.0, 0.1),
        "across 2": Case(2.0 * one - 40.0, 2.0 * one + 24.0, 8.0, 10.0, 0.0625),
        "open upwards": Case(one, math.inf, 8.0, 5.0, 0.1),
    }


WRONG = (
    "",
    "a place beyond the range",
    "a velocity beyond the greatest",
    "a change of velocity beyond the greatest",
    "a step that differs from its velocity",
    "a joint that still moves outwards at the end of its range",
    "the invariant is lost",
    "a place or velocity that is no number",
)


def sources() -> list[str]:
    """Of the kernels."""
    return [source_of(module) for module in MODULES]


def law(texts: Sequence[str], bits: int) -> dict[str, Any]:
    """The kernels in so many bits, compiled."""
    shift = 2.0 ** (53 - bits) + 1.0

    def rounded(x: float) -> float:
        if not abs(x) < 1e250:
            return x
        scaled = x * shift
        return scaled - (scaled - x)

    ulp = 2.0 ** (1 - bits)
    return transcribed(
        texts,
        FUNCTIONS,
        constants={"ULP": ulp, "INSIDE": 1.0 - MARGIN_ULPS * ulp},
        rounding=numba.njit(rounded),
        compiled=numba.njit(error_model="numpy"),
    )


def examined(case: Case, bits: int, texts: Sequence[str] | None = None, stride: int = 1) -> Result:
    """Run every transition of a case.

    Args:
        case, bits: limits, and how precise.
        texts: sources of the kernels; the product's by default.
        stride: every so many velocities only, and the greatest ones and 0.
    """
    names, run = _prepared(tuple(sources() if texts is None else texts), bits)
    cell = 2.0 ** (1 - bits)
    rounded, limits = names["rounded_"], names["JointLimits"]
    T = rounded(case.T)
    own = limits(
        case.lower * cell, case.upper * cell, rounded(case.speed * cell / T),
        rounded(rounded(case.change * cell / T) / T),
    )  # fmt: skip
    highest = min(case.upper, case.lower + OPEN)
    places = np.arange(case.lower, highest + 1.0) * cell
    numbers = _numbers(own.speed, bits)
    velocities = np.unique([*numbers[::stride], 0.0, numbers[0], numbers[-1]])
    beyond = [case.lower * cell - 1.0, highest * cell + 1.0, math.inf, -math.inf, math.nan, 5e-324]
    setpoints = np.array([*places, *beyond])
    near = np.arange(-math.ceil(case.speed) - 2.0, math.ceil(case.speed) + 3.0) * cell
    looked_at, states, wrong = run(places, velocities, setpoints, near, own, T, cell)
    return Result(looked_at, states, WRONG[wrong])


@cache
def _prepared(texts: tuple[str, ...], bits: int) -> tuple[dict[str, Any], Run]:
    """A law, and what looks at its transitions: compiled once for all cases."""
    names = law(texts, bits)
    return names, _examiner(names)


def _numbers(most: float, bits: int) -> Vector:
    """All numbers of so many bits up to `most`, down to an eighth of it, 0, and their opposites."""
    top = math.floor(math.log2(most))
    digits = np.arange(2.0 ** (bits - 1), 2.0**bits)
    up = np.concatenate([digits * 2.0 ** (e + 1 - bits) for e in range(top - 3, top + 1)])
    up = up[up <= most]
    return np.concatenate([-up[::-1], [0.0], up])


def _examiner(names: dict[str, Any]) -> Run:
    """What looks at all transitions with a law, compiled."""
    follow, rounded = names["follow_one"], names["rounded_"]
    inside = names["INSIDE"]

    @numba.njit(error_model="numpy")
    def none(q, own, T, cell):  # type: ignore[no-untyped-def]
        """A velocity that counts as none: what braking leaves of A, and rounding of places."""
        margin = (1.0 - inside) * own.acceleration * T
        return margin + UNITS * cell * (abs(q) + 3.0 * own.speed * T) / T

    @numba.njit(error_model="numpy")
    def keeps(q, v, wall, own, T, cell):  # type: ignore[no-untyped-def]
        """Whether a brake from here, in the law's own arithmetic, ends before a wall upwards."""
        if not abs(wall) < math.inf:
            return True
        change = rounded(rounded(inside * own.acceleration) * T)
        w = rounded(v - change)
        while w > none(wall, own, T, cell):
            q = rounded(q + rounded(w * T))
            if q > wall:
                return False
            w = rounded(w - change)
        return True

    @numba.njit(error_model="numpy")
    def invariant(q, v, own, T, cell):  # type: ignore[no-untyped-def]
        return keeps(q, v, own.upper, own, T, cell) and keeps(-q, -v, -own.lower, own, T, cell)

    @numba.njit(error_model="numpy")
    def fault(q, v, after, w, own, T, cell):  # type: ignore[no-untyped-def]
        if not (abs(after) < math.inf and abs(w) < math.inf):
            return 7
        if not own.lower <= after <= own.upper:
            return 1
        if abs(w) > own.speed:
            return 2
        if abs(w - v) > own.acceleration * T:
            return 3
        unit = cell * (max(abs(q), abs(after)) + 3.0 * own.speed * T)
        at_end = after in (own.lower, own.upper)
        slow = none(after, own, T, cell)
        cut = at_end and abs(w) <= slow and (after - q) * w >= 0.0 and abs(after - q) <= abs(w) * T
        if abs(after - q - w * T) > UNITS * unit and not cut:
            return 4
        if abs(v) <= slow and ((q == own.upper and w > 0.0) or (q == own.lower and w < 0.0)):
            return 5
        return 0 if invariant(after, w, own, T, cell) else 6

    @numba.njit(error_model="numpy")
    def run(places, velocities, setpoints, near, own, T, cell):  # type: ignore[no-untyped-def]
        looked_at, states = 0, 0
        for q in places:
            for v in velocities:
                if not invariant(q, v, own, T, cell):
                    continue
                states += 1
                for s in setpoints:
                    for k in range(near.size + 2):
                        before = math.nan
                        if k < near.size:
                            before = s + near[k]
                        elif k == near.size:
                            before = -s
                        after, w = follow(s, before, q, v, own, T)
                        looked_at += 1
                        wrong = fault(q, v, after, w, own, T, cell)
                        if wrong:
                            return looked_at, states, wrong
        return looked_at, states, 0

    checked: Run = run
    return checked
