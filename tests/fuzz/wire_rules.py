"""Which messages are valid, from docs/reference/wire.md and docs/guides/live.md alone.

Nothing of the product is used here, so that a mistake in its checks cannot hide.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.interpolate import BPoly, CubicSpline

HEADER = b"\x00\x01\x00\x00"
VERSIONS = {"State": 2, "Setpoint": 2, "Target": 2, "Event": 1}
SCALARS = {"State": "<IIQQQQqqqqQQQQQQd", "Setpoint": "<IIQQQqqqqqqqddddddIIII"}
SCALARS |= {"Target": "<IIIIIIQQQ", "Event": "<IIQQqq"}
ARRAYS = {
    "State": (
        *("q", "dq", "tau", "reference", "wrench", "reference_rate", "reference_acceleration"),
        *("followed", "base", "contact", "imu"),
    ),
    "Setpoint": ("values", "extra", "decision", "slacks", "gains", "next"),
    "Target": ("values", "rates"),
    "Event": (),
}
MOST_ELEMENTS = 1024
MOST_OF_SETPOINT = {"extra": 256, "decision": 512, "slacks": 256, "gains": 256, "next": 1024}
KEPT_TICKS = 1024
AHEAD_S, UNIT = 10.0, 1e-3
USED = 0.99
LOOKS = 8  # between two points of a chunk
DENSE = 200

Array = tuple[int, int]
"""Where its first element stands, and how many there are."""


def read(kind: str, payload: bytes) -> tuple[tuple[Any, ...], dict[str, Array]] | None:
    """Scalars and arrays of a payload; None where its size is not what its lengths ask for."""
    scalars = struct.Struct(SCALARS[kind])
    at = 4 + scalars.size
    arrays: dict[str, Array] = {}
    for name in ARRAYS[kind]:
        at += -at % 4
        if len(payload) < at + 4:
            return None
        count = int.from_bytes(payload[at : at + 4], "little")
        at += 4
        if count > MOST_ELEMENTS:
            return None
        if count:
            at += -(at - 4) % 8  # counted from behind the header
        arrays[name] = at, count
        at += 8 * count
    return (scalars.unpack_from(payload, 4), arrays) if len(payload) == at else None


def numbers(payload: bytes, array: Array) -> tuple[float, ...]:
    """Elements of an array."""
    return struct.unpack_from(f"<{array[1]}d", payload, array[0])


def fault(kind: str, payload: bytes) -> str:
    """Why a payload is no message of that kind, or ""."""
    found = read(kind, payload)
    if found is None:
        return "size"
    if payload[:4] != HEADER:
        return "layout"
    return "" if found[0][0] == VERSIONS[kind] else "wire_version"


@dataclass
class SetpointRules:
    """Judges Setpoints as docs/reference/wire.md says.

    Attributes:
        n, session, command: of the robot.
        asked: epoch of each tick that asked.
        answers: bytes of the first answer to each tick.
        newest: tick of the newest answer.
    """

    n: int
    session: int
    command: int
    asked: dict[int, int] = field(default_factory=dict)
    answers: dict[int, bytes] = field(default_factory=dict)
    newest: int = -1

    def judge(self, payload: bytes, last_tick: int) -> str:
        """The first reason of the table, or what becomes of it."""
        found = read("Setpoint", payload)
        if found is None:
            return "size"
        scalars, arrays = found
        if arrays["values"][1] != self.n:
            return "size"
        if any(arrays[name][1] > most for name, most in MOST_OF_SETPOINT.items()):
            return "size"
        if payload[:4] != HEADER:
            return "layout"
        version, command, session, tick, epoch = scalars[:5]
        values = numbers(payload, arrays["values"])
        for reason, wrong in (
            ("wire_version", version != 2),
            ("session", session != self.session),
            ("future", tick > last_tick),
            ("unasked", tick not in self.asked or last_tick - tick >= KEPT_TICKS),
            ("epoch", self.asked.get(tick) != epoch),
            ("command", command != self.command),
            ("not_finite", not all(map(math.isfinite, values))),
        ):
            if wrong:
                return reason
        first, count = arrays["values"]
        raw = payload[first : first + 8 * count]
        if tick in self.answers:
            return "duplicate" if self.answers[tick] == raw else "conflicting"
        self.answers[tick] = raw
        if tick <= self.newest:
            return "out_of_order"
        self.newest = tick
        return "accepted"


@dataclass
class TargetRules:
    """Judges Targets as docs/guides/live.md says.

    Attributes:
        session, period_s: of the robot.
        plain, turns: of each live target, how many numbers, and whether a quaternion follows.
        lower, upper: where each of the plain numbers may lie.
        within_rad: how far a quaternion may be from (0, 0, 0, 1).
        bounds: speed, acceleration and jerk of a plain number.
        operator, epoch, newest: who steers, with which epoch, and its last number.
    """

    session: int
    period_s: float
    plain: Sequence[int]
    turns: Sequence[bool]
    lower: float
    upper: float
    within_rad: float
    bounds: tuple[float, float, float]
    operator: str = ""
    epoch: int = 0
    newest: int = 0

    def judge(self, who: str, payload: bytes, tick: int, *, following: bool) -> set[str]:
        """What may become of it: "" or the reason; both where only rounding decides."""
        found = None if fault("Target", payload) else read("Target", payload)
        if found is None:
            return {"malformed"}
        scalars, arrays = found
        _, target, number, points, dimension, step, session, epoch, first = scalars
        for reason, wrong in (
            ("not_following", not following),
            ("other_session", session != self.session),
            ("not_operator", who != self.operator or not who or epoch != self.epoch),
            ("behind", number <= self.newest),
        ):
            if wrong:
                return {reason}
        self.newest = number
        if target >= len(self.plain):
            return {"unknown_target"}
        plain, turns = self.plain[target], self.turns[target]
        wide, rates_wide = plain + 4 * turns, plain + 3 * turns
        values, rates = (numbers(payload, arrays[name]) for name in ("values", "rates"))
        rows = [values[i : i + wide] for i in range(0, len(values), wide)]
        lengths = [math.hypot(*row[plain:]) for row in rows] if turns else []
        sizes = dimension == wide and points > 0 and len(values) == points * dimension
        for reason, wrong in (
            ("wrong_size", not sizes or len(rates) not in {0, points * rates_wide}),
            ("wrong_size", points > 1 and not step),
            ("not_finite", not all(map(math.isfinite, (*values, *rates)))),
            ("not_unit", any(abs(length - 1.0) > UNIT for length in lengths)),
        ):
            if wrong:
                return {reason}
        return self._timed(rows, rates, target, step, first, tick)

    def _timed(
        self,
        rows: list[tuple[float, ...]],
        rates: Sequence[float],
        target: int,
        step: int,
        first: int,
        tick: int,
    ) -> set[str]:
        """Whether points come in time, and all that follows."""
        points, now = len(rows), tick + 1
        last = first + (points - 1) * step
        doubt: set[str] = set()  # what rounding of times may come to
        if points > 1 and last <= now:
            if last < now:
                return {"late"}
            doubt = {"late"}
        ahead = max(first, last) - now - AHEAD_S / self.period_s
        if ahead >= 0.5:
            return {"too_far_ahead"}
        if ahead > -0.5:
            doubt |= {"too_far_ahead"}
        return doubt | self._place(rows, rates, target, step, max(first, now) - first)

    def _place(
        self,
        rows: list[tuple[float, ...]],
        rates: Sequence[float],
        target: int,
        step: int,
        begin: int,
    ) -> set[str]:
        """Whether its points, and a curve through them, keep what the target takes."""
        plain, turns = self.plain[target], self.turns[target]
        if any(not self.lower <= x <= self.upper for row in rows for x in row[:plain]):
            return {"out_of_range"}
        if any(self._angle(row[plain:]) > self.within_rad for row in rows if turns):
            return {"out_of_range"}
        if len(rows) == 1:
            return {""}
        return self._speed(rows, rates, plain, turns, step, begin)

    def _angle(self, quaternion: Sequence[float]) -> float:
        *vector, scalar = quaternion
        return 2.0 * math.atan2(math.hypot(*vector), abs(scalar))

    def _speed(
        self,
        rows: list[tuple[float, ...]],
        rates: Sequence[float],
        plain: int,
        turns: bool,
        step: int,
        begin: int,
    ) -> set[str]:
        """Whether the plain numbers of a curve keep their bounds, from `begin` ticks on."""
        width = step * self.period_s
        times = np.arange(len(rows)) * width
        places = np.array(rows)[:, :plain]
        curves = []
        with np.errstate(all="ignore"):
            if rates:
                speeds = np.array(rates).reshape(len(rows), -1)[:, :plain]
                bends = np.gradient(speeds, width, axis=0)
                if not np.isfinite(bends).all():
                    return {"too_fast"}
                nodes = np.stack([places, speeds, bends], axis=1)
                curves = [BPoly.from_derivatives(times, nodes[:, :, axis]) for axis in range(plain)]
            else:
                curves = [CubicSpline(times, places[:, a], bc_type="natural") for a in range(plain)]
        start = begin * self.period_s
        few = _inside(times, start, np.arange(1, LOOKS) / LOOKS)
        many = _inside(times, start - width / LOOKS, np.linspace(1e-6, 1.0 - 1e-6, DENSE))
        most = [0.0, 0.0]
        for curve in curves:
            for order, bound in enumerate(self.bounds, 1):
                for which, at in enumerate((few, many)):
                    with np.errstate(all="ignore"):
                        share = np.nan_to_num(np.abs(curve(at, order)) / bound, nan=np.inf)
                    most[which] = max(most[which], share.max(initial=0.0))
        if most[0] > 1.01 * USED:
            return {"too_fast"}
        if most[1] < 0.98 * USED and not turns:
            return {""}
        return {"", "too_fast"}


def _inside(times: np.ndarray, start: float, shares: np.ndarray) -> np.ndarray:
    """Times between the points of a curve, at shares of each stretch, from a time on."""
    found = (times[:-1, None] + np.diff(times)[:, None] * shares).ravel()
    return found[found >= start]
