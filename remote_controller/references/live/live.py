"""Targets that come while the robot moves: how a task follows them without a jump.

A target is a point, or a chunk of points at equal times. A chunk is a curve: the natural cubic
spline through its points, or, where their rates are given, the quintic that has them. From its
first tick on the task follows it: along a time-optimal trajectory of bounded speed, acceleration
and jerk (ruckig) that meets the curve where it is by then, and from there on exactly on the curve.
At its end the same bounds bring it to rest, and there it stays.

So delay is never guessed: points have ticks, and those that are in the past decide only where the
curve is now. A newer target replaces an older one from its own first tick on, and what has not
begun by now altogether.

Orientations are unit quaternions (x, y, z, w). A way turns by the rotation vector from where it
begins, the shorter way round; a chunk is the curve through its quaternions, divided by its length.
"""

from __future__ import annotations

import atexit
import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from typing import Any, Literal
from weakref import WeakSet

import numpy as np

from hoap3.protocol.errors import BadProblemError, ConfigError
from hoap3.protocol.messages import FloatArray
from hoap3.remote_controller.references.live.live_plan import Bounds, Chunk, Plan, Rest, Ways
from hoap3.remote_controller.references.live.live_space import Space
from hoap3.remote_controller.references.target import Target

Refusal = Literal[
    "wrong_size", "not_finite", "not_unit", "late", "too_far_ahead", "out_of_range", "too_fast"
]
WhenStale = Literal["hold", "return", "stop"]

AHEAD_S = 10.0  # how far ahead of now a target may begin, and end

_ALL: WeakSet[Live] = WeakSet()
_BEING_BUILT: ContextVar[list[Live] | None] = ContextVar("being_built", default=None)


@contextmanager
def collected() -> Iterator[list[Live]]:
    """All live targets that are made within, in their order: so a controller's are found."""
    found: list[Live] = []
    token = _BEING_BUILT.set(found)
    try:
        yield found
    finally:
        _BEING_BUILT.reset(token)


def check_names(live: Sequence[Live]) -> None:
    """Refuse two live targets of one controller that are called the same.

    Raises:
        ConfigError: names it.
    """
    names = [each.name for each in live]
    for name in names:
        if names.count(name) > 1:
            problem = "is the name of two live targets"
            raise ConfigError("", "name", name, problem, "Give each a `name` of its own")


@dataclass(frozen=True)
class Turning:
    """An orientation behind the other numbers of a target.

    Attributes:
        bounds: of each component of ω, or of the rotation vector of a way.
        around: rotation vector of the orientation near which others must be, (3,) [rad]; None:
            that of the begin.
        within_rad: how near; π is anywhere.
    """

    bounds: Bounds
    around: FloatArray | None = None
    within_rad: float = math.pi


class Live(Target):
    """A target that somebody steers.

    Args:
        name: by which senders call it.
        unit: of its numbers.
        bounds: of every axis, or one for each.
        lower, upper: where points may lie, (k,).
        stale_after_s: how long the last target counts.
        when_stale: what happens then: `hold`, `return` to where the task began, or `stop`: the
            controller falls silent, and the robot stops safely.
        turning: the orientation behind these numbers; None where there is none.
        layout: what the numbers are called, for senders.

    Attributes:
        space: what the numbers of a point are: k, or k + 4.
        stops_at_s: time from which the controller is to be silent; inf for never.
    """

    def __init__(
        self,
        name: str,
        unit: str,
        bounds: Bounds | Sequence[Bounds],
        lower: FloatArray,
        upper: FloatArray,
        stale_after_s: float = math.inf,
        when_stale: WhenStale = "hold",
        *,
        turning: Turning | None = None,
        layout: Sequence[str] = (),
    ) -> None:
        self.space = space = Space(len(lower), turns=turning is not None)
        super().__init__(space.dimension)
        self.name, self.unit, self.layout = name, unit, tuple(layout)
        self._lower, self._upper = lower, upper
        self._turning = turning
        self._stale_after, self._when_stale = stale_after_s, when_stale
        each = [bounds] * space.plain if isinstance(bounds, Bounds) else [*bounds]
        each += [] if turning is None else [turning.bounds] * 3
        self._bounds = np.array([[b.speed, b.acceleration, b.jerk] for b in each]).T
        self._ways = Ways(space, self._bounds)
        self._home = space.point(np.zeros(space.dimension))
        self._around: FloatArray | None = None
        if turning is not None and turning.around is not None:
            self._around = Space(0, turns=True).point(turning.around)
        self._plans: list[Plan] = [Plan(-math.inf, Rest(self._home))]
        self._out = np.zeros((3, space.numbers))
        self.stops_at_s, self._ends_s = math.inf, -math.inf
        self._ways.rehearse()
        _ALL.add(self)
        seen = _BEING_BUILT.get()
        if seen is not None:
            seen.append(self)

    def as_json(self) -> dict[str, Any]:
        """What a sender must know of it."""
        speed, acceleration, jerk = self._bounds.tolist()
        return {
            "name": self.name,
            "dimension": self.space.numbers,
            "rates": self.space.dimension,
            "unit": self.unit,
            "layout": list(self.layout),
            "speed": speed,
            "acceleration": acceleration,
            "jerk": jerk,
            "lower": [each if math.isfinite(each) else None for each in self._lower.tolist()],
            "upper": [each if math.isfinite(each) else None for each in self._upper.tolist()],
            "stale_after_s": None if math.isinf(self._stale_after) else self._stale_after,
            "when_stale": self._when_stale,
        }

    def start(self, present: FloatArray | None, time_s: float) -> None:
        """Stay where the robot is, until somebody says otherwise."""
        super().start(present, time_s)
        self._home = self.space.point(np.zeros(self.dimension) if present is None else present)
        self._plans = [Plan(-math.inf, Rest(self._home))]
        self.stops_at_s, self._ends_s = math.inf, -math.inf

    def is_at_rest(self, time_s: float) -> bool:
        """Return whether it has come to the end of what was sent by a time [s]."""
        return time_s >= self._ends_s

    def take(
        self, first_s: float, step_s: float, points: FloatArray, rates: FloatArray, now_s: float
    ) -> Refusal | int:
        """Follow a target from `first_s` on, or from `now_s` where that is later.

        Args:
            first_s: time of the first point [s].
            step_s: between two points [s].
            points: (p, numbers).
            rates: (p, dimension), or empty.
            now_s: time of the next step [s]; what was asked for up to then stays as it was.

        Returns:
            How many of the points are in the past, or why it is refused.
        """
        count = len(points)
        refusal = self._doubt(first_s, step_s, points, rates, now_s)
        if refusal is not None:
            return refusal
        begin = max(first_s, now_s)
        if count == 1:
            curve: Rest | Chunk = Rest(self.space.curve(points, rates[:0])[0][0])
        else:
            curve = Chunk(first_s, step_s, points, rates, self.space)
            if not curve.within(begin, self._bounds):
                return "too_fast"
        before = self._plans, self.stops_at_s, self._ends_s
        self._plans = [plan for plan in self._plans if plan.begin_s < now_s][-2:]
        try:
            self._plans.append(self._ways.plan(begin, self._where(begin), curve))
            self._ends_s = self._plans[-1].end_s
            self._grow_stale(now_s + self._stale_after)
        except BadProblemError:
            self._plans, self.stops_at_s, self._ends_s = before
            return "too_fast"
        return int(min(max(math.ceil((now_s - first_s) / step_s), 0), count)) if count > 1 else 0

    def at(self, time_s: float, position_out: FloatArray, velocity_out: FloatArray) -> None:
        """Write where it is at a time [s], and its velocity, (dimension,)."""
        self._plan_of(time_s).look(time_s, self._out)
        self.space.give(self._out, position_out, velocity_out)

    def follow(self, elapsed_s: float, position_out: FloatArray, velocity_out: FloatArray) -> None:
        """Write where it is so long after the start [s]."""
        self.at(self._begin + elapsed_s, position_out, velocity_out)

    def _doubt(
        self, first_s: float, step_s: float, points: FloatArray, rates: FloatArray, now_s: float
    ) -> Refusal | None:
        space = self.space
        if points.ndim != 2 or points.shape[1] != space.numbers or not len(points):
            return "wrong_size"
        if rates.size and rates.shape != (len(points), space.dimension):
            return "wrong_size"
        if len(points) > 1 and step_s <= 0.0:
            return "wrong_size"
        if not (np.isfinite(points).all() and np.isfinite(rates).all()):
            return "not_finite"
        if not space.unit(points):
            return "not_unit"
        last_s = first_s + (len(points) - 1) * step_s
        if len(points) > 1 and last_s <= now_s:
            return "late"
        if max(first_s, last_s) > now_s + AHEAD_S:
            return "too_far_ahead"
        return None if self._in_range(points) else "out_of_range"

    def _in_range(self, points: FloatArray) -> bool:
        plain, turning = points[:, : self.space.plain], self._turning
        if (plain < self._lower).any() or (plain > self._upper).any():
            return False
        if turning is None or turning.within_rad >= math.pi:
            return True
        around = self._home[-4:] if self._around is None else self._around
        return self.space.within(points, around, turning.within_rad)

    def _where(self, time_s: float) -> FloatArray:
        """The state at a time, (3, numbers)."""
        out = np.zeros((3, self.space.numbers))
        self._plan_of(time_s).look(time_s, out)
        return out

    def _plan_of(self, time_s: float) -> Plan:
        for plan in reversed(self._plans):
            if plan.begin_s <= time_s:
                return plan
        return self._plans[0]

    def _grow_stale(self, stale_s: float) -> None:
        self.stops_at_s = stale_s if self._when_stale == "stop" else math.inf
        if self._when_stale == "return" and stale_s < math.inf:
            self._plans.append(self._ways.plan(stale_s, self._where(stale_s), Rest(self._home)))


@atexit.register
def _let_go() -> None:
    """Ruckig's binding complains at the end of a process of whatever of it is still held."""
    for live in list(_ALL):
        vars(live).clear()
