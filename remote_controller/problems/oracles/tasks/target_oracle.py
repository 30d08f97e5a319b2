"""Where a task's target is at each time, and how it moves."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hoap3.remote_controller.problems.oracles.parameters import UnverifiableError

Array = NDArray[np.float64]

PLANES = {"xy": (0, 1), "yz": (1, 2), "zx": (2, 0)}
RAMP = 0.25  # share of a segment in which a trapezoid speeds up, and in which it slows down
PEAK = {"quintic": 15.0 / 8.0, "trapezoid": 1.0 / (1.0 - RAMP)}  # highest over mean speed


class Target(ABC):
    """x_d(t), (m,), and its velocity; it sets out where the robot is, at rest, if it approaches.

    Args:
        dimension: m.
        approach_s: duration of the way from where the robot is to the target [s]; 0 is none.

    Attributes:
        end_s: when a trajectory ends, since the start [s]; of others inf.
    """

    end_s = float("inf")

    def __init__(self, dimension: int, approach_s: float = 0.0) -> None:
        self.dimension, self.approach_s = dimension, approach_s
        self._begin, self._origin = 0.0, np.zeros(dimension)
        self._known = False
        self._stays: Array | None = None

    @property
    def rounding(self) -> float:
        """How many times as much as any other place it may be off by rounding."""
        return 1.0

    def start(self, present: Array | None, time_s: float) -> None:
        """Set out at a time [s] from where the robot is, (m,); None where nobody knows."""
        self._begin, self._known, self._stays = time_s, present is not None, None
        self._origin = np.zeros(self.dimension) if present is None else present.copy()

    def at(self, time_s: float) -> tuple[Array, Array]:
        """x_d and dx_d/dt, both (m,), at a time [s]; before the start as at it."""
        if self._stays is not None:
            return self._stays, np.zeros(self.dimension)
        elapsed = self.elapsed(time_s)
        place, velocity = self.path(elapsed)
        if not self._known or elapsed >= self.approach_s:
            return place, velocity
        s, slope = rise(elapsed / self.approach_s)
        way = place - self._origin
        return self._origin + s * way, slope / self.approach_s * way + s * velocity

    def elapsed(self, time_s: float) -> float:
        """Time since the start [s]."""
        return max(0.0, time_s - self._begin)

    def stay(self, place: Array) -> None:
        """From now on be there, (m,), until the next start."""
        self._stays = place.copy()

    def over(self, time_s: float, period_s: float) -> tuple[Array, Array, Array]:
        """x_d, dx_d/dt and the acceleration that, held for a period, gives the next velocity."""
        place, velocity = self.at(time_s)
        return place, velocity, (self.at(time_s + period_s)[1] - velocity) / period_s

    @abstractmethod
    def path(self, elapsed_s: float) -> tuple[Array, Array]:
        """Where it is without the approach, and its velocity, so long after the start [s]."""


class Point(Target):
    """What stays where it is."""

    def __init__(self, place: Array, approach_s: float = 0.0) -> None:
        super().__init__(len(place), approach_s)
        self._place = np.array(place, float)

    def path(self, elapsed_s: float) -> tuple[Array, Array]:
        """The place."""
        del elapsed_s
        return self._place, np.zeros(self.dimension)


class Hold(Target):
    """Where the robot is at the start."""

    def path(self, elapsed_s: float) -> tuple[Array, Array]:
        """Where it started; 0 where nobody knows."""
        del elapsed_s
        return self._origin, np.zeros(self.dimension)


class Round(Target):
    """A circle r(cos θ, sin θ), or an eight a(sin θ, sin θ cos θ)/(1 + cos²θ), in a plane."""

    def __init__(self, given: Mapping[str, Any]) -> None:
        super().__init__(3, float(given.get("approach_s", 1.0)))
        forward = given.get("direction", "forward") == "forward"
        self._omega = 2.0 * np.pi / (given["period_s"] if forward else -given["period_s"])
        self._centre = np.array(given["center_m"], float)
        self._across = np.zeros((2, 3))
        self._across[[0, 1], PLANES[given.get("plane", "xy")]] = 1.0
        self._circle = given["kind"] == "circle"
        self._first = float(given.get("start_rad", 0.0))
        self._size = float(given["radius_m" if self._circle else "half_width_m"])

    def path(self, elapsed_s: float) -> tuple[Array, Array]:
        """The point of the curve at θ = θ_0 + ωt."""
        angle = self._first + self._omega * elapsed_s
        sine, cosine = np.sin(angle), np.cos(angle)
        if self._circle:
            place, slope = np.array([cosine, sine]), np.array([-sine, cosine])
        else:
            depth = 1.0 + cosine**2
            above = np.array([sine, sine * cosine])
            above_rate = np.array([cosine, cosine**2 - sine**2])
            place = above / depth
            slope = above_rate / depth + above * (2.0 * sine * cosine) / depth**2
        there = self._size * (place @ self._across)
        return self._centre + there, self._omega * self._size * (slope @ self._across)


class Waypoints(Target):
    """Straight from where the robot is to each point in turn, at rest at each of them."""

    def __init__(self, given: Mapping[str, Any]) -> None:
        super().__init__(3)
        self._given = np.array(given["points_m"], float).reshape(-1, 3)
        self._arrivals = np.array(given.get("times_s") or (), float)
        self._profile, self._speed = given.get("profile", "quintic"), given.get("speed_m_s")
        if self._profile not in PEAK or (self._speed is None) == (not len(self._arrivals)):
            raise UnverifiableError("waypoints without times or speed, or of no known profile")
        self.start(None, 0.0)

    def start(self, present: Array | None, time_s: float) -> None:
        """Set out, and find when each point is reached."""
        super().start(present, time_s)
        first = self._given[0] if present is None else present
        self._points = np.vstack([first, self._given])
        if self._speed is None:
            self._times = np.append(0.0, self._arrivals)
        else:
            lengths = np.linalg.norm(np.diff(self._points, axis=0), axis=1)
            self._times = np.append(0.0, np.cumsum(PEAK[self._profile] * lengths / self._speed))

    def path(self, elapsed_s: float) -> tuple[Array, Array]:
        """On the segment of that time."""
        k = int(np.searchsorted(self._times, elapsed_s, "right")) - 1
        if k >= len(self._times) - 1:
            return self._points[-1], np.zeros(3)
        here, there = self._points[k : k + 2]
        duration = self._times[k + 1] - self._times[k]
        step = rise if self._profile == "quintic" else ramp
        s, slope = step((elapsed_s - self._times[k]) / duration)
        return here + s * (there - here), slope / duration * (there - here)


class Joined(Target):
    """Two targets one below the other."""

    def __init__(self, first: Target, second: Target) -> None:
        super().__init__(first.dimension + second.dimension)
        self._both, self._split = (first, second), first.dimension
        self.end_s = max(first.end_s, second.approach_s)

    def start(self, present: Array | None, time_s: float) -> None:
        """Both set out."""
        super().start(present, time_s)
        m = self._split
        starts = (None, None) if present is None else (present[:m], present[m:])
        for target, start in zip(self._both, starts, strict=True):
            target.start(start, time_s)

    def at(self, time_s: float) -> tuple[Array, Array]:
        """Of both."""
        if self._stays is not None:
            return self._stays, np.zeros(self.dimension)
        (x, v), (y, w) = (target.at(time_s) for target in self._both)
        return np.concatenate([x, y]), np.concatenate([v, w])

    def path(self, elapsed_s: float) -> tuple[Array, Array]:
        """Of both, without their approaches."""
        (x, v), (y, w) = (target.path(elapsed_s) for target in self._both)
        return np.concatenate([x, y]), np.concatenate([v, w])


def target_of(given: Mapping[str, Any] | None) -> Target:
    """The target, (3,) [m], of a config's `target`; where the robot starts if there is none.

    Raises:
        UnverifiableError: a kind that is not known, or whose curve is in another file.
    """
    if given is None:
        return Hold(3)
    kind = given.get("kind", "point")
    if kind == "point":
        return Point(np.array(given["position_m"], float), float(given.get("approach_s", 0.0)))
    if kind in {"circle", "lemniscate"}:
        return Round(given)
    if kind == "waypoints":
        return Waypoints(given)
    if kind == "spline":
        raise UnverifiableError("the file of a target's spline is not in the log")
    raise UnverifiableError(f"target of kind {kind!r:.40} is not known")


def rise(x: float) -> tuple[float, float]:
    """S from 0 to 1 with ds/dx = 30x²(1 − x)², and that slope."""
    x = min(max(x, 0.0), 1.0)
    return x**3 * (10.0 - 15.0 * x + 6.0 * x**2), 30.0 * (x * (1.0 - x)) ** 2


def ramp(x: float) -> tuple[float, float]:
    """S from 0 to 1 whose slope rises evenly, stays, and falls evenly, and that slope."""
    x, top = min(max(x, 0.0), 1.0), PEAK["trapezoid"]
    before, after = min(x, RAMP), max(x - (1.0 - RAMP), 0.0)
    s = top * (x - before + 0.5 * before**2 / RAMP - 0.5 * after**2 / RAMP)
    return s, top * min(x, RAMP, 1.0 - x) / RAMP
