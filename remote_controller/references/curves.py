"""Closed plane curves in space: the circle and Bernoulli's lemniscate."""

from __future__ import annotations

import math
from typing import Literal

from hoap3.protocol.messages import FloatArray
from hoap3.remote_controller.references.target import Target

Plane = Literal["xy", "yz", "zx"]
AXES: dict[Plane, tuple[int, int]] = {"xy": (0, 1), "yz": (1, 2), "zx": (2, 0)}


class _PlaneCurve(Target):
    """A curve in a plane that is parallel to two axes.

    Args:
        center: (3,) [m].
        plane: the first axis of its name is the curve's own first one.
        period_s: of one round [s]; negative goes the other way.
    """

    def __init__(self, center: FloatArray, plane: Plane, period_s: float) -> None:
        super().__init__(3)
        self._center = [float(x) for x in center]
        self._first, self._second = AXES[plane]
        self._omega = 2.0 * math.pi / period_s

    def _write(
        self,
        place: tuple[float, float],
        slope: tuple[float, float],
        position_out: FloatArray,
        velocity_out: FloatArray,
    ) -> None:
        """Write the point of the plane at `place`, and the velocity for `slope` = d/dθ."""
        position, velocity = self._center.copy(), [0.0, 0.0, 0.0]
        position[self._first] += place[0]
        position[self._second] += place[1]
        velocity[self._first] = slope[0] * self._omega
        velocity[self._second] = slope[1] * self._omega
        position_out[:], velocity_out[:] = position, velocity


class Circle(_PlaneCurve):
    """r·(cos θ, sin θ), with θ = θ_0 + 2πt/period.

    Args:
        center, plane, period_s: see `_PlaneCurve`.
        radius: r [m].
        start_rad: θ_0 [rad].
    """

    def __init__(
        self,
        center: FloatArray,
        radius: float,
        period_s: float,
        plane: Plane = "xy",
        start_rad: float = 0.0,
    ) -> None:
        super().__init__(center, plane, period_s)
        self._radius, self._start = radius, start_rad

    def follow(self, elapsed_s: float, position_out: FloatArray, velocity_out: FloatArray) -> None:
        """Write x_d and its velocity."""
        angle = self._start + self._omega * elapsed_s
        x, y = self._radius * math.cos(angle), self._radius * math.sin(angle)
        self._write((x, y), (-y, x), position_out, velocity_out)


class Lemniscate(_PlaneCurve):
    """a·(sin θ, sin θ·cos θ)/(1 + cos² θ): an eight that lies along the plane's first axis.

    It starts in the middle, at θ = 0, towards the first axis; θ = 2πt/period. Its speed
    2πa/(period·√(1 + cos² θ)) is highest at both tips.

    Args:
        center, plane, period_s: see `_PlaneCurve`.
        half_width: a, from the middle to each tip [m].
    """

    def __init__(
        self, center: FloatArray, half_width: float, period_s: float, plane: Plane = "xy"
    ) -> None:
        super().__init__(center, plane, period_s)
        self._half_width = half_width

    def follow(self, elapsed_s: float, position_out: FloatArray, velocity_out: FloatArray) -> None:
        """Write x_d and its velocity."""
        angle = self._omega * elapsed_s
        s, c = math.sin(angle), math.cos(angle)
        scale = self._half_width / (1.0 + c * c)
        turn = 2.0 * s * c / (1.0 + c * c)  # d(scale)/dθ over the scale
        place = scale * s, scale * s * c
        slope = scale * c + place[0] * turn, scale * (c * c - s * s) + place[1] * turn
        self._write(place, slope, position_out, velocity_out)
