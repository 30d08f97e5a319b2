"""From waypoint to waypoint along straight lines, at rest at each of them."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from typing import Literal

import numpy as np

from hoap3.protocol.messages import FloatArray
from hoap3.remote_controller.references.target import Target, smooth_step

Profile = Literal["quintic", "trapezoid"]
RAMP = 0.25  # share of a segment's time in which a trapezoid speeds up, and in which it slows down
PEAK: dict[Profile, float] = {"quintic": 1.875, "trapezoid": 1.0 / (1.0 - RAMP)}
"""Highest speed of a segment over its mean speed."""


class Waypoints(Target):
    """Straight segments from where the robot is to each waypoint in turn, and rest at the last.

    Along a segment, s goes from 0 to 1 as `smooth_step` does (`quintic`), or speeds up and slows
    down evenly, each for a quarter of the segment's time (`trapezoid`). The velocity is
    continuous, and 0 at every waypoint; with `quintic` the acceleration is continuous too.

    Args:
        points: (k, m), in the order of visit.
        times_s: when to arrive at each of them, since the start [s], increasing; or
        speed: the highest speed in every segment [unit of the points per s].
        profile: see above.
    """

    def __init__(
        self,
        points: FloatArray,
        times_s: Sequence[float] = (),
        speed: float = 0.0,
        profile: Profile = "quintic",
    ) -> None:
        super().__init__(points.shape[1])
        self._points = np.vstack([points[:1], points])
        self._speed, self._profile = speed, profile
        self._times = [0.0, *times_s]
        if not times_s:
            self._schedule()

    def start(self, present: FloatArray | None, time_s: float) -> None:
        """Begin at `present`; where nobody knows it, at the first waypoint."""
        super().start(present, time_s)
        self._points[0] = self._points[1] if present is None else present
        if self._speed > 0.0:
            self._schedule()

    def follow(self, elapsed_s: float, position_out: FloatArray, velocity_out: FloatArray) -> None:
        """Write x_d and its velocity."""
        times, points = self._times, self._points
        segment = bisect_right(times, elapsed_s) - 1
        if segment >= len(points) - 1:
            position_out[:] = points[-1]
            velocity_out[:] = 0.0
            return
        begin, duration = times[segment], times[segment + 1] - times[segment]
        step = smooth_step if self._profile == "quintic" else trapezoid_step
        s, slope = step((elapsed_s - begin) / duration)
        here, there = points[segment], points[segment + 1]
        for i in range(self.dimension):
            way = there[i] - here[i]
            position_out[i] = here[i] + s * way
            velocity_out[i] = slope / duration * way

    def _schedule(self) -> None:
        self._times = [0.0]
        for here, there in zip(self._points, self._points[1:], strict=False):
            duration = PEAK[self._profile] * math.dist(here, there) / self._speed
            self._times.append(self._times[-1] + duration)


def trapezoid_step(x: float) -> tuple[float, float]:
    """Give s from 0 to 1 and ds/dx, which rises evenly, stays, and falls evenly."""
    if not 0.0 < x < 1.0:
        return (1.0, 0.0) if x >= 1.0 else (0.0, 0.0)
    top = PEAK["trapezoid"]
    if x < RAMP:
        return 0.5 * top * x * x / RAMP, top * x / RAMP
    if x > 1.0 - RAMP:
        rest = 1.0 - x
        return 1.0 - 0.5 * top * rest * rest / RAMP, top * rest / RAMP
    return top * (x - 0.5 * RAMP), top
