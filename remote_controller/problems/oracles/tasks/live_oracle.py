"""Where live targets are, from the messages in a controller's log.

A message is followed from its first tick on, or from the next tick after it was taken. The way to
its curve is ruckig's, and meets the curve after the least of 20 ms · 1.25ᵏ that the bounds allow;
they are used to 99 %. The curve is scipy's natural cubic spline, or its quintic polynomials. A way
turns by the rotation vector from where it begins; a curve turns as its quaternions do, whatever
their length.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BPoly, CubicSpline
from scipy.spatial.transform import Rotation

from hoap3.protocol.messages import Target as TargetMessage
from hoap3.remote_controller.problems.oracles.parameters import UnverifiableError
from hoap3.remote_controller.problems.oracles.tasks.logarithm_oracle import (
    inverse_left,
    rotation_of,
    rotation_vector,
)
from hoap3.remote_controller.problems.oracles.tasks.target_oracle import Target, rise
from hoap3.remote_controller.problems.oracles.tasks.turns_oracle import State, aligned, rates_of

Array = NDArray[np.float64]
Curve = Callable[[float], State]
"""Where it is at a time [s]."""

USED, FIRST_S, LATER, MET, EXACT_S = 0.99, 0.02, 1.25, 1e-9, 1e-9
POSITION = {"speed_m_s": 0.25, "acceleration_m_s2": 1.0, "jerk_m_s3": 20.0}
POSTURE = {"speed_rad_s": 0.5, "acceleration_rad_s2": 2.0, "jerk_rad_s3": 40.0}
FORCE = {"rate_n_s": 20.0, "second_n_s2": 200.0, "third_n_s3": 10_000.0}
TORQUE = {"rate_nm_s": 2.0, "second_nm_s2": 20.0, "third_nm_s3": 1000.0}
"""Bounds that a config leaves out."""


@dataclass(frozen=True)
class Taken:
    """A message that a controller took.

    Attributes:
        target: which of its live targets.
        now_s: time of the next tick [s].
        first_s, step_s: of its points [s].
        points, rates: of each point and of its rate, and as many or none.
    """

    target: int
    now_s: float
    first_s: float
    step_s: float
    points: Array
    rates: Array

    @classmethod
    def of(cls, payload: bytes, tick: int, period_s: float) -> Taken:
        """A `Target` that was taken after the State of a tick."""
        target = TargetMessage.like(payload)
        target.load(payload)
        rates = target.rates.reshape(target.points if target.rates.size else 1, -1).copy()
        points = target.values.reshape(target.points, target.dimension).copy()
        first, step = target.first_tick * period_s, target.tick_step * period_s
        return cls(target.target, (tick + 1) * period_s, first, step, points, rates)


class Messages:
    """What a controller took for each of its live targets; more may be added while it is read.

    Args:
        taken: what is known already.
        names: of the targets, in their order.
    """

    def __init__(self, taken: Sequence[Taken] = (), names: Sequence[str] = ()) -> None:
        self._names = list(names)
        self._taken: dict[int, list[Taken]] = {}
        for each in taken:
            self.add(each)

    def add(self, taken: Taken) -> None:
        """Add a message, later than all before it."""
        self._taken.setdefault(taken.target, []).append(taken)

    def of(self, given: Mapping[str, Any]) -> Sequence[Taken]:
        """Those of a target that a config describes, with all that are added later.

        Raises:
            UnverifiableError: the log has no such target.
        """
        name = given.get("name", "target")
        if name not in self._names:
            raise UnverifiableError(f"the log has no live target {name!r:.40}")
        return self._taken.setdefault(self._names.index(name), [])


def live_of(given: Mapping[str, Any], messages: Messages | None) -> LiveTarget:
    """The live target, (3,) [m], of a config's `target`.

    Raises:
        UnverifiableError: its messages were not collected.
    """
    return LiveTarget(given, _collected(given, messages), [POSITION] * 3)


def live_pose_of(given: Mapping[str, Any], messages: Messages | None) -> LiveTarget:
    """The live pose, (6,); as `live_of`."""
    taken = _collected(given, messages)
    return LiveTarget(given, taken, [POSITION] * 3, turns=True)


def live_orientation_of(given: Mapping[str, Any], messages: Messages | None) -> LiveTarget:
    """The live orientation, (3,); as `live_of`."""
    return LiveTarget(given, _collected(given, messages), [], turns=True)


def live_wrench_of(
    given: Mapping[str, Any], messages: Messages | None, torques: Sequence[bool]
) -> LiveTarget:
    """The live wrench along directions of which some are torques; as `live_of`."""
    usual = [TORQUE if each else FORCE for each in torques]
    return LiveTarget(given, _collected(given, messages), usual)


def live_posture_of(given: Mapping[str, Any], messages: Messages | None, joints: int) -> LiveTarget:
    """The live posture of so many joints; as `live_of`."""
    return LiveTarget(given, _collected(given, messages), [POSTURE] * joints)


def _collected(given: Mapping[str, Any], messages: Messages | None) -> Sequence[Taken]:
    if messages is None:
        raise UnverifiableError("live targets of such a controller are not recomputed")
    return messages.of(given)


class LiveTarget(Target):
    """A target that somebody steers.

    Rounding ε of a point is ε/h² in the acceleration of its chunk's curve, h between two points. A
    way that begins there lasts no longer than the chunk, (p − 1)h: it carries (p − 1)²ε on.

    Args:
        given: its settings.
        messages: that were taken for it, in their order.
        usual: bounds of each plain number, in the order speed, acceleration, jerk.
        turns: whether an orientation stands behind them.
    """

    def __init__(
        self,
        given: Mapping[str, Any],
        messages: Sequence[Taken],
        usual: Sequence[Mapping[str, float]],
        *,
        turns: bool = False,
    ) -> None:
        self._k, self._turns = len(usual), turns
        each = [*usual, *([POSTURE] * 3 if turns else [])]
        super().__init__(len(each))
        bounds = [[float(given.get(name, one[name])) for name in one] for one in each]
        self._bounds = (USED * np.array(bounds).T).tolist()
        stale = given.get("stale_after_s")
        returns = given.get("when_stale", "hold") == "return" and stale is not None
        self._returns_after = float(stale or 0.0) if returns else np.inf
        self._messages, self._read, self._longest = messages, 0, 1
        self._home = self._point(np.zeros(self.dimension))
        self._plans: list[tuple[float, Curve]] = []

    @property
    def rounding(self) -> float:
        """As of every target: that of the longest chunk so far."""
        return float(self._longest) ** 2

    def start(self, present: Array | None, time_s: float) -> None:
        """Stay where the robot is, and forget what was asked before."""
        super().start(present, time_s)
        self._home = self._point(np.zeros(self.dimension) if present is None else present)
        self._read = sum(each.now_s <= time_s for each in self._messages)
        self._plans = [(-np.inf, _rest(self._home))]

    def at(self, time_s: float) -> tuple[Array, Array]:
        """x_d and dx_d/dt, both (d,), at a time [s], which never falls."""
        while self._read < len(self._messages) and self._messages[self._read].now_s <= time_s:
            taken = self._messages[self._read]
            self._longest = max(self._longest, len(taken.points))
            self._follow(taken)
            self._read += 1
        state = self._state(time_s)
        place, velocity = state.flat[0], state.flat[1]
        if not state.turns:
            return place, velocity
        r = rotation_vector(state.turn)
        rate = inverse_left(r)[0] @ state.spin[0]
        return np.concatenate([place, r]), np.concatenate([velocity, rate])

    def path(self, elapsed_s: float) -> tuple[Array, Array]:
        """The same so long after the start [s]."""
        return self.at(self._begin + elapsed_s)

    def _point(self, place: Array) -> State:
        """At rest where a task reads that the robot is, (d,)."""
        k = self._k
        return State.resting(place[:k], rotation_of(place[k:]) if self._turns else None)

    def _sent(self, point: Array) -> State:
        """At rest at a point of a message."""
        turn = Rotation.from_quat(point[self._k :]).as_matrix() if self._turns else None
        return State.resting(point[: self._k], turn)

    def _state(self, time_s: float) -> State:
        return next(curve for begin, curve in reversed(self._plans) if begin <= time_s)(time_s)

    def _follow(self, taken: Taken) -> None:
        begin = max(taken.first_s, taken.now_s)
        self._plans = [plan for plan in self._plans if plan[0] < taken.now_s][-2:]
        plan = self._plan(begin, self._state(begin), taken)
        self._plans.append((begin, plan))
        home_s = taken.now_s + self._returns_after
        if home_s < np.inf:
            self._plans.append((home_s, self._leave(home_s, self._state(home_s), self._home)))

    def _plan(self, begin: float, state: State, taken: Taken) -> Curve:
        """The way to a target, its curve, its brake and its rest, one behind the other."""
        if len(taken.points) == 1:
            return self._leave(begin, state, self._sent(taken.points[0]))
        curve, end = _curve(taken, self._k), taken.first_s + (len(taken.points) - 1) * taken.step_s
        brake, brake_s = self._way(end, curve(end), None, 0.0)
        stopped = end + brake_s
        rest = _still(brake(stopped))
        after = [(end, curve), (stopped, brake)]
        seen = [each.seen_from(state.turn) for each in (state, curve(begin))]
        if (np.abs(seen[0] - seen[1]) <= MET).all():
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

    def _leave(self, begin: float, state: State, aim: State, least_s: float = 0.0) -> Curve:
        way, lasts_s = self._way(begin, state, aim, least_s)
        return _chain([(begin + lasts_s, way)], aim)

    def _way(
        self, begin: float, state: State, end: State | None, least_s: float
    ) -> tuple[Curve, float]:
        """The quickest way, and how long it takes [s]; to any rest without an end."""
        import ruckig

        d, anchor = self.dimension, state.turn
        here, aim = state.seen_from(anchor), None if end is None else end.seen_from(anchor)
        asked: Any = ruckig.InputParameter(d)
        asked.current_position, asked.current_velocity, asked.current_acceleration = here.tolist()
        asked.max_velocity, asked.max_acceleration, asked.max_jerk = self._bounds
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
        except (ruckig.RuckigError, ValueError) as error:
            raise RuntimeError(str(error)) from error
        lasts = float(found.duration)
        miss = np.zeros(d) if aim is None else aim[0] - np.array(found.at_time(lasts)[0])

        def way(time_s: float) -> State:
            elapsed = time_s - begin
            seen = np.array(found.at_time(elapsed), float)
            s, slope = rise(elapsed / lasts) if lasts > 0.0 else (1.0, 0.0)
            seen[0] += s * miss
            seen[1] += slope / lasts * miss if slope else 0.0
            return State.of(seen, anchor, self._k)

        return way, lasts


def _still(state: State) -> State:
    """The same place, at rest."""
    return State.resting(state.flat[0], state.turn if state.turns else None)


def _rest(state: State) -> Curve:
    return lambda _: state


def _chain(pieces: Sequence[tuple[float, Curve]], rest: State) -> Curve:
    """Each piece until its end, then rest."""
    still = _rest(rest)

    def curve(time_s: float) -> State:
        return next((piece for end, piece in pieces if time_s < end), still)(time_s)

    return curve


def _curve(taken: Taken, k: int) -> Curve:
    """The curve through the points of a chunk, k plain numbers each; outside its ends as there."""
    count, points, rates = len(taken.points), taken.points, taken.rates
    if points.shape[1] > k:
        turns = aligned(points[:, k:])
        points = np.hstack([points[:, :k], turns])
        if rates.size:
            rates = np.hstack([rates[:, :k], rates_of(turns, rates[:, k:])])
    knots = taken.step_s * np.arange(count)
    made: Any
    if rates.size:
        bends = np.gradient(rates, taken.step_s, axis=0)
        made = BPoly.from_derivatives(knots, np.stack([points, rates, bends], 1))
    else:
        made = CubicSpline(knots, points, bc_type="natural") if count > 2 else None

    def curve(time_s: float) -> State:
        elapsed = min(max(time_s - taken.first_s, 0.0), float(knots[-1]))
        if made is None:  # a line
            slope = (points[1] - points[0]) / taken.step_s
            line = [points[0] + elapsed * slope, slope, np.zeros_like(slope)]
            return State.on_curve(np.array(line), k)
        found = [made(elapsed, nu=order) for order in range(3)]
        return State.on_curve(np.array(found), k)

    return curve
