"""Targets that come while the robot moves: how a task follows them without a jump.

A target is a point, or a chunk of points at equal times. A chunk is a curve: the natural cubic
spline through its points, or, where their rates are given, the quintic that has them. From its
first tick on the task follows it: along a time-optimal trajectory of bounded speed, acceleration
and jerk (ruckig) that meets the curve where it is by then, and from there on exactly on the curve.
At its end the same bounds bring it to rest, and there it stays.

So delay is never guessed: points have ticks, and those that are in the past decide only where the
curve is now. A newer target replaces an older one from its own first tick on, and what has not
begun by now altogether.
"""

from __future__ import annotations

import atexit
import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any, Literal
from weakref import WeakSet

import numpy as np

from hoap3.protocol.errors import ConfigError
from hoap3.protocol.messages import FloatArray
from hoap3.remote_controller.references.live.live_plan import Bounds, Chunk, Plan, Rest, Ways
from hoap3.remote_controller.references.target import Target

Refusal = Literal["wrong_size", "not_finite", "late", "too_far_ahead", "too_fast", "out_of_range"]
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


class Live(Target):
    """A target that somebody steers.

    Args:
        name: by which senders call it.
        unit: of its numbers.
        bounds: of each axis.
        lower, upper: where points may lie, (d,).
        stale_after_s: how long the last target counts.
        when_stale: what happens then: `hold`, `return` to where the task began, or `stop`: the
            controller falls silent, and the robot stops safely.

    d is the number of axes.

    Attributes:
        stops_at_s: time from which the controller is to be silent; inf for never.
    """

    def __init__(
        self,
        name: str,
        unit: str,
        bounds: Bounds,
        lower: FloatArray,
        upper: FloatArray,
        stale_after_s: float = math.inf,
        when_stale: WhenStale = "hold",
    ) -> None:
        super().__init__(len(lower))
        dimension = self.dimension
        self.name, self.unit, self.bounds = name, unit, bounds
        self._lower, self._upper = lower, upper
        self._stale_after, self._when_stale = stale_after_s, when_stale
        self._ways = Ways(dimension, bounds)
        self._home = np.zeros(dimension)
        self._plans: list[Plan] = [Plan(-math.inf, Rest(self._home))]
        self._out = np.zeros((3, dimension))
        self.stops_at_s = math.inf
        self._ways.rehearse()
        _ALL.add(self)
        seen = _BEING_BUILT.get()
        if seen is not None:
            seen.append(self)

    def as_json(self) -> dict[str, Any]:
        """What a sender must know of it."""
        return {
            "name": self.name,
            "dimension": self.dimension,
            "unit": self.unit,
            "speed": self.bounds.speed,
            "acceleration": self.bounds.acceleration,
            "jerk": self.bounds.jerk,
            "stale_after_s": None if math.isinf(self._stale_after) else self._stale_after,
            "when_stale": self._when_stale,
        }

    def start(self, present: FloatArray | None, time_s: float) -> None:
        """Stay where the robot is, until somebody says otherwise."""
        super().start(present, time_s)
        self._home = np.zeros(self.dimension) if present is None else np.array(present, float)
        self._plans = [Plan(-math.inf, Rest(self._home))]
        self.stops_at_s = math.inf

    def take(
        self, first_s: float, step_s: float, points: FloatArray, rates: FloatArray, now_s: float
    ) -> Refusal | int:
        """Follow a target from `first_s` on, or from `now_s` where that is later.

        Args:
            first_s: time of the first point [s].
            step_s: between two points [s].
            points: (p, d).
            rates: (p, d), or empty.
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
            curve: Rest | Chunk = Rest(points[0].copy())
        else:
            curve = Chunk(first_s, step_s, points, rates)
            if not curve.within(begin, self.bounds):
                return "too_fast"
        self._plans = [plan for plan in self._plans if plan.begin_s < now_s][-2:]
        self._plans.append(self._ways.plan(begin, self._where(begin), curve))
        self._grow_stale(now_s + self._stale_after)
        return int(min(max(math.ceil((now_s - first_s) / step_s), 0), count)) if count > 1 else 0

    def at(self, time_s: float, position_out: FloatArray, velocity_out: FloatArray) -> None:
        """Write where it is at a time [s], and its velocity, (d,)."""
        self._plan_of(time_s).look(time_s, self._out)
        position_out[:], velocity_out[:] = self._out[0], self._out[1]

    def follow(self, elapsed_s: float, position_out: FloatArray, velocity_out: FloatArray) -> None:
        """Write where it is so long after the start [s]."""
        self.at(self._begin + elapsed_s, position_out, velocity_out)

    def _doubt(
        self, first_s: float, step_s: float, points: FloatArray, rates: FloatArray, now_s: float
    ) -> Refusal | None:
        if points.ndim != 2 or points.shape[1] != self.dimension or not len(points):
            return "wrong_size"
        if (rates.size and rates.shape != points.shape) or (len(points) > 1 and step_s <= 0.0):
            return "wrong_size"
        if not (np.isfinite(points).all() and np.isfinite(rates).all()):
            return "not_finite"
        last_s = first_s + (len(points) - 1) * step_s
        if len(points) > 1 and last_s <= now_s:
            return "late"
        if max(first_s, last_s) > now_s + AHEAD_S:
            return "too_far_ahead"
        if (points < self._lower).any() or (points > self._upper).any():
            return "out_of_range"
        return None

    def _where(self, time_s: float) -> FloatArray:
        """Position, velocity and acceleration at a time, (3, d)."""
        out = np.zeros((3, self.dimension))
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
