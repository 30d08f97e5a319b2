"""How a live target is followed: a way to its curve, the curve, a brake, rest."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hoap3.protocol.errors import BadProblemError
from hoap3.protocol.messages import FloatArray
from hoap3.remote_controller.references.live.live_space import Space
from hoap3.remote_controller.references.target import smooth_step

FIRST_MEETING_S = 0.02  # after which a curve is met at the earliest, unless it is met already
LATER = 1.25  # times as late as that the next try
MET = 1e-9  # of a length, a speed, an acceleration: no way to the curve is needed
ROUNDING = 1e-9  # of a duration [s]
USED = 0.99  # of the bounds; ruckig ends up to 1e-8 beside its aim, and the rest takes that up

Look = Callable[[float, FloatArray], None]
"""Writes the state at a time [s], (3, numbers): see `live_space.Space`."""


@dataclass(frozen=True)
class Bounds:
    """What the motion of an axis keeps: speed, acceleration and jerk, in units of the target."""

    speed: float
    acceleration: float
    jerk: float


class Rest:
    """A point, (numbers,)."""

    def __init__(self, place: FloatArray) -> None:
        self.place = np.array(place, float)

    def look(self, time_s: float, out: FloatArray) -> None:
        """Write it; nothing moves."""
        del time_s
        out[0], out[1:] = self.place, 0.0


class Chunk:
    """The curve through points at equal times.

    Args:
        first_s, step_s: time of the first point, and between two [s].
        points: (p, numbers), p ≥ 2.
        rates: (p, dimension), or empty: then those of the natural cubic spline.
        space: of the points. Quaternions are four numbers of the curve, divided by their length.

    Attributes:
        end_s: time of the last point [s].
    """

    def __init__(
        self, first_s: float, step_s: float, points: FloatArray, rates: FloatArray, space: Space
    ) -> None:
        from hoap3.remote_controller.references.live import live_kernels as kernels

        self._kernels, self._first, self._step, self._space = kernels, first_s, step_s, space
        count, self._d = points.shape
        points, rates = space.curve(points, rates)
        self.end_s = first_s + (count - 1) * step_s
        speeds, accelerations = rates.copy(), np.zeros_like(points)
        if speeds.size:
            kernels.difference_nodes(step_s, speeds, accelerations)
        else:
            speeds = np.zeros_like(points)
            kernels.spline_nodes(step_s, np.ascontiguousarray(points), speeds, accelerations)
        self._nodes = np.hstack([points, speeds, accelerations])
        self._work = np.zeros((4, self._d))

    def look(self, time_s: float, out: FloatArray) -> None:
        """Write where it is at a time [s]."""
        self._kernels.curve_at(time_s - self._first, self._step, self._nodes, self._d, self._work)
        self._space.look(self._work)
        out[:] = self._work[:3]

    def within(self, begin_s: float, bounds: FloatArray) -> bool:
        """Whether it keeps bounds of each axis, (3, dimension), from a time on [s]."""
        found, space = np.zeros((3, self._d)), self._space
        begin = begin_s - self._first
        self._kernels.extremes(
            begin, self._step, self._nodes, self._d, space.place, self._work, found
        )
        kept = found[:, : space.dimension] <= USED * bounds
        return bool(np.isfinite(self._nodes).all() and kept.all())


class Plan:
    """What is followed from a time on: pieces, each until its own end, and then rest.

    Args:
        begin_s: [s].
        rest: at the end.
        pieces: pairs of an end [s] and what is followed until then.
    """

    def __init__(self, begin_s: float, rest: Rest, pieces: Sequence[tuple[float, Look]] = ()):
        self.begin_s, self._rest, self._pieces = begin_s, rest, tuple(pieces)
        self.end_s = pieces[-1][0] if pieces else begin_s

    def look(self, time_s: float, out: FloatArray) -> None:
        """Write the state at a time [s], (3, numbers)."""
        for end_s, look in self._pieces:
            if time_s < end_s:
                look(time_s, out)
                return
        self._rest.look(time_s, out)


class Ways:
    """Time-optimal ways of bounded speed, acceleration and jerk, by ruckig.

    Those of an orientation are of the rotation vector from where the way begins, of each of its
    components. Where it begins faster than its bounds, as a way before was seen from elsewhere, it
    comes back within them first.

    Args:
        space: of the points.
        bounds: speed, acceleration and jerk of each axis, (3, dimension).
    """

    def __init__(self, space: Space, bounds: FloatArray) -> None:
        import ruckig

        self._library: Any = ruckig
        self._make: Any = ruckig.Ruckig(space.dimension)
        self._space, self._bounds = space, bounds
        self._limits = (USED * bounds).tolist()

    def rehearse(self) -> None:
        """Do all of it once, so that nothing is compiled while a robot moves."""
        space = self._space
        here = space.point(np.zeros(space.dimension))
        points, rates = np.tile(here, (3, 1)), np.zeros((3, space.dimension))
        for given in (rates[:0], rates):
            chunk = Chunk(0.0, 0.1, points, given, space)
            chunk.within(0.0, self._bounds)
            state = np.zeros((3, space.numbers))
            space.state(here, np.full((3, space.dimension), MET), state)
            self.plan(0.0, state, chunk)

    def plan(self, begin_s: float, state: FloatArray, curve: Rest | Chunk) -> Plan:
        """From a state to a curve, as soon as it can be met, and along it to its end.

        Raises:
            BadProblemError: there is no way.
        """
        if isinstance(curve, Rest):
            return self._to_rest(begin_s, state, curve, 0.0)
        there = np.zeros((3, self._space.numbers))
        curve.look(curve.end_s, there)
        brake, brake_s = self._way(curve.end_s, there, None, 0.0)
        end_s = curve.end_s + brake_s
        brake(end_s, there)
        rest = Rest(there[0])
        pieces = [(curve.end_s, curve.look), (end_s, brake)]
        curve.look(begin_s, there)
        if self._met(state, there):
            return Plan(begin_s, rest, pieces)
        later_s = FIRST_MEETING_S
        while begin_s + later_s < curve.end_s:
            curve.look(begin_s + later_s, there)
            found = self._meet(begin_s, state, there, later_s)
            if found is not None:
                return Plan(begin_s, rest, [(begin_s + later_s, found), *pieces])
            later_s *= LATER
        return self._to_rest(begin_s, state, rest, end_s - begin_s)

    def _to_rest(self, begin_s: float, state: FloatArray, rest: Rest, least_s: float) -> Plan:
        there = np.zeros((3, self._space.numbers))
        there[0] = rest.place
        way, lasts_s = self._way(begin_s, state, there, least_s)
        return Plan(begin_s, rest, [(begin_s + lasts_s, way)])

    def _met(self, state: FloatArray, there: FloatArray) -> bool:
        here, seen_from = self._space.coordinates, state[0]
        return bool((np.abs(here(seen_from, state) - here(seen_from, there)) <= MET).all())

    def _meet(
        self, begin_s: float, state: FloatArray, there: FloatArray, later_s: float
    ) -> Look | None:
        """The way that is there at just that time, or None: the bounds do not allow it."""
        try:
            way, lasts_s = self._way(begin_s, state, there, later_s)
        except BadProblemError:
            return None
        return way if abs(lasts_s - later_s) <= ROUNDING else None

    def _way(
        self, begin_s: float, state: FloatArray, there: FloatArray | None, least_s: float
    ) -> tuple[Look, float]:
        """The quickest way from one state to another, or to any rest, and how long it takes [s]."""
        library, space, d = self._library, self._space, self._space.dimension
        anchor, limits = state[0].copy(), self._limits
        here = space.coordinates(anchor, state)
        aim = None if there is None else space.coordinates(anchor, there)
        asked: Any = library.InputParameter(d)
        asked.current_position, asked.current_velocity, asked.current_acceleration = here.tolist()
        asked.max_velocity, asked.max_acceleration, asked.max_jerk = limits
        if aim is None:
            asked.control_interface = library.ControlInterface.Velocity
        else:
            asked.synchronization = library.Synchronization.Phase
            asked.target_position, asked.target_velocity, asked.target_acceleration = aim.tolist()
        if least_s > 0.0:
            asked.minimum_duration = least_s
        found: Any = library.Trajectory(d)
        try:
            self._make.calculate(asked, found)
        except (library.RuckigError, ValueError) as error:  # the latter of hours and more
            raise BadProblemError(f"there is no way within the bounds: {error}") from error
        lasts_s = float(found.duration)
        miss = np.zeros(d) if aim is None else aim[0] - found.at_time(lasts_s)[0]
        work = np.zeros((3, d))

        def look(time_s: float, out: FloatArray) -> None:
            elapsed_s = time_s - begin_s
            work[0], work[1], work[2] = found.at_time(elapsed_s)
            share, slope = smooth_step(elapsed_s / lasts_s if lasts_s > 0.0 else 1.0)
            work[0] += share * miss
            if slope:
                work[1] += slope / lasts_s * miss
            space.state(anchor, work, out)

        return look, lasts_s
