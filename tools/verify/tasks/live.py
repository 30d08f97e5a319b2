"""Where live targets are, from the messages in a controller's log.

A message is followed from its first tick on, or from the next tick after it was taken. The way to
its curve is ruckig's, and meets the curve after the least of 20 ms · 1.25ᵏ that the bounds allow;
they are used to 99 %. The curve is scipy's natural cubic spline, or its quintic polynomials.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BPoly, CubicSpline

from hoap3.tools.verify.tasks.targets import Target, UnknownTaskError, rise

Array = NDArray[np.float64]
Curve = Callable[[float], Array]
"""Position, velocity and acceleration at a time [s], (3, d)."""

USED, FIRST_S, LATER, MET, EXACT_S = 0.99, 0.02, 1.25, 1e-9, 1e-9
POSITION = {"speed_m_s": 0.25, "acceleration_m_s2": 1.0, "jerk_m_s3": 20.0}
POSTURE = {"speed_rad_s": 0.5, "acceleration_rad_s2": 2.0, "jerk_rad_s3": 40.0}
"""Bounds that a config leaves out."""


@dataclass(frozen=True)
class Taken:
    """A message that a controller took.

    Attributes:
        target: which of its live targets.
        now_s: time of the next tick [s].
        first_s, step_s: of its points [s].
        points, rates: (p, d), and as many or none.
    """

    target: int
    now_s: float
    first_s: float
    step_s: float
    points: Array
    rates: Array


class Messages:
    """What a controller took; hands each of its live targets, in their order, its own."""

    def __init__(self, taken: Sequence[Taken] = ()) -> None:
        self._taken, self._given = taken, 0

    def next(self) -> list[Taken]:
        """Those of the next live target."""
        self._given += 1
        return [each for each in self._taken if each.target == self._given - 1]


def live_of(given: Mapping[str, Any], messages: Messages | None) -> LiveTarget:
    """The live target, (3,) [m], of a config's `target`.

    Raises:
        UnknownTaskError: nobody has collected its messages.
    """
    return LiveTarget(given, _collected(messages), 3, POSITION)


def live_posture_of(given: Mapping[str, Any], messages: Messages | None, joints: int) -> LiveTarget:
    """The live posture of so many joints; as `live_of`."""
    return LiveTarget(given, _collected(messages), joints, POSTURE)


def _collected(messages: Messages | None) -> list[Taken]:
    if messages is None:
        raise UnknownTaskError("live targets of such a controller are not recomputed")
    return messages.next()


class LiveTarget(Target):
    """A target that somebody steers.

    Rounding ε of a point is ε/h² in the acceleration of its chunk's curve, h between two points. A
    way that begins there lasts no longer than the chunk, (p − 1)h: it carries (p − 1)²ε on.

    Args:
        given: its settings.
        messages: that were taken for it, in their order.
        dimension: d.
        defaults: of its bounds, in the order speed, acceleration, jerk.
    """

    def __init__(
        self,
        given: Mapping[str, Any],
        messages: Sequence[Taken],
        dimension: int,
        defaults: Mapping[str, float],
    ) -> None:
        super().__init__(dimension)
        self._bounds = [USED * float(given.get(name, least)) for name, least in defaults.items()]
        stale = given.get("stale_after_s")
        returns = given.get("when_stale", "hold") == "return" and stale is not None
        self._returns_after = float(stale or 0.0) if returns else np.inf
        self._messages = messages
        self.rounding = float(max((len(each.points) for each in messages), default=1)) ** 2
        self._home = np.zeros(dimension)
        self._waiting: Iterator[Taken] = iter(())
        self._next: Taken | None = None
        self._plans: list[tuple[float, Curve]] = []

    def start(self, present: Array | None, time_s: float) -> None:
        """Stay where the robot is, and forget what was asked before."""
        super().start(present, time_s)
        self._home = np.zeros(self.dimension) if present is None else present.copy()
        self._waiting = (each for each in self._messages if each.now_s > time_s)
        self._next = next(self._waiting, None)
        self._plans = [(-np.inf, _rest(self._home))]

    def at(self, time_s: float) -> tuple[Array, Array]:
        """x_d and dx_d/dt, both (d,), at a time [s], which never falls."""
        while self._next is not None and self._next.now_s <= time_s:
            self._follow(self._next)
            self._next = next(self._waiting, None)
        place, velocity, _ = self._state(time_s)
        return place, velocity

    def path(self, elapsed_s: float) -> tuple[Array, Array]:
        """The same so long after the start [s]."""
        return self.at(self._begin + elapsed_s)

    def _state(self, time_s: float) -> Array:
        return next(curve for begin, curve in reversed(self._plans) if begin <= time_s)(time_s)

    def _follow(self, taken: Taken) -> None:
        begin = max(taken.first_s, taken.now_s)
        self._plans = [plan for plan in self._plans if plan[0] < taken.now_s]
        plan = self._plan(begin, self._state(begin), taken)
        self._plans.append((begin, plan))
        home_s = taken.now_s + self._returns_after
        if home_s < np.inf:
            self._plans.append((home_s, self._leave(home_s, self._state(home_s), self._home)))

    def _plan(self, begin: float, state: Array, taken: Taken) -> Curve:
        """The way to a target, its curve, its brake and its rest, one behind the other."""
        if len(taken.points) == 1:
            return self._leave(begin, state, taken.points[0])
        curve, end = _curve(taken), taken.first_s + (len(taken.points) - 1) * taken.step_s
        brake, brake_s = self._way(end, curve(end), None, 0.0)
        stopped = end + brake_s
        rest = brake(stopped)[0]
        after = [(end, curve), (stopped, brake)]
        if (np.abs(state - curve(begin)) <= MET).all():
            return _chain(after, rest)
        later = FIRST_S
        while begin + later < end:
            try:
                way, lasts_s = self._way(begin, state, curve(begin + later), later)
            except RuntimeError:  # the curve asks there for what no way may end with
                lasts_s = np.inf
            if abs(lasts_s - later) <= EXACT_S:
                return _chain([(begin + later, way), *after], rest)
            later *= LATER
        return self._leave(begin, state, rest, stopped - begin)

    def _leave(self, begin: float, state: Array, place: Array, least_s: float = 0.0) -> Curve:
        aim = np.zeros_like(state)
        aim[0] = place
        way, lasts_s = self._way(begin, state, aim, least_s)
        return _chain([(begin + lasts_s, way)], place)

    def _way(
        self, begin: float, state: Array, aim: Array | None, least_s: float
    ) -> tuple[Curve, float]:
        """The quickest way, and how long it takes [s]; to any rest without an aim."""
        import ruckig

        d = self.dimension
        asked: Any = ruckig.InputParameter(d)
        asked.current_position, asked.current_velocity, asked.current_acceleration = state.tolist()
        asked.max_velocity, asked.max_acceleration, asked.max_jerk = (
            [bound] * d for bound in self._bounds
        )
        if aim is None:
            asked.control_interface = ruckig.ControlInterface.Velocity
        else:
            asked.synchronization = ruckig.Synchronization.Phase
            asked.target_position, asked.target_velocity, asked.target_acceleration = aim.tolist()
        if least_s > 0.0:
            asked.minimum_duration = least_s
        found: Any = ruckig.Trajectory(d)
        try:
            ruckig.Ruckig(d).calculate(asked, found)
        except ruckig.RuckigError as error:
            raise RuntimeError(str(error)) from error
        lasts = float(found.duration)
        miss = np.zeros(d) if aim is None else aim[0] - np.array(found.at_time(lasts)[0])

        def way(time_s: float) -> Array:
            elapsed = time_s - begin
            state = np.array(found.at_time(elapsed), float)
            s, slope = rise(elapsed / lasts) if lasts > 0.0 else (1.0, 0.0)
            state[0] += s * miss
            state[1] += slope / lasts * miss if slope else 0.0
            return state

        return way, lasts


def _rest(place: Array) -> Curve:
    still = np.zeros((3, len(place)))
    still[0] = place
    return lambda _: still


def _chain(pieces: Sequence[tuple[float, Curve]], rest: Array) -> Curve:
    """Each piece until its end, then rest."""
    still = _rest(rest)

    def curve(time_s: float) -> Array:
        return next((piece for end, piece in pieces if time_s < end), still)(time_s)

    return curve


def _curve(taken: Taken) -> Curve:
    """The curve through the points of a chunk; outside its ends as there."""
    count, points = len(taken.points), taken.points
    knots = taken.step_s * np.arange(count)
    made: Any
    if taken.rates.size:
        bends = np.gradient(taken.rates, taken.step_s, axis=0)
        made = BPoly.from_derivatives(knots, np.stack([points, taken.rates, bends], 1))
    else:
        made = CubicSpline(knots, points, bc_type="natural") if count > 2 else None

    def curve(time_s: float) -> Array:
        elapsed = min(max(time_s - taken.first_s, 0.0), float(knots[-1]))
        if made is None:  # a line
            slope = (points[1] - points[0]) / taken.step_s
            return np.array([points[0] + elapsed * slope, slope, np.zeros_like(slope)])
        return np.array([made(elapsed, nu=order) for order in range(3)])

    return curve
