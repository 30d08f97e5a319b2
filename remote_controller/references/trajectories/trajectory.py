"""A motion through points at times, as ros2_control's joint trajectory controller has it."""

from __future__ import annotations

from bisect import bisect_right
from typing import Literal

import numpy as np

from hoap3.protocol.messages import FloatArray
from hoap3.remote_controller.references.spline import clamped_slopes
from hoap3.remote_controller.references.target import Target
from hoap3.remote_controller.references.trajectories.motion_file import Motion

Degree = Literal["linear", "cubic", "quintic"]
COEFFICIENTS = 6


def degree_of(motion: Motion) -> Degree:
    """By what the points carry: positions, velocities too, or accelerations as well."""
    if motion.velocities is None:
        return "linear"
    return "cubic" if motion.accelerations is None else "quintic"


class Trajectory(Target):
    """Polynomials between points, whose ends have the position, velocity, acceleration given there.

    `linear` heeds positions alone, `cubic` velocities too, `quintic` accelerations as well.
    Velocities that are not given are those of the cubic spline with a continuous acceleration that
    begins and ends at rest; accelerations that are not given are 0.

    Where the first time is above 0, the first segment goes from where the robot is at the start, at
    rest, to the first point. Where it is 0, a quintic leads there within `approach_s`, and the
    trajectory's own time begins at its end. After the last point it stays there.

    Args:
        motion: the points.
        degree: of the polynomials.
        scaling: the times are multiplied by it; velocities become less by it, and accelerations by
            its square.
        approach_s: duration of the way to the first point [s]; 0: at once.
        place, dimension: which of m components each column is; the others stay where they are.

    Attributes:
        times_s: since the start, at which segments begin, and at last the end, (k + 1,) [s].
        polynomials: coefficients of 1, z … z⁵ with z from 0 to 1 in each segment, (k, 6, m); 0 of
            components that stay.
        linear: whether the velocity jumps from segment to segment.
    """

    def __init__(
        self,
        motion: Motion,
        degree: Degree,
        scaling: float = 1.0,
        approach_s: float = 0.0,
        place: list[int] | None = None,
        dimension: int | None = None,
    ) -> None:
        columns = len(motion.names)
        super().__init__(columns if dimension is None else dimension)
        self._places = list(range(columns)) if place is None else place
        self._rest = np.setdiff1d(np.arange(self.dimension), self._places)
        self._stands = np.zeros(len(self._rest))
        times = motion.times_s * scaling
        lead, self._lead_degree = float(times[0]), degree
        if lead == 0.0:
            lead, self._lead_degree = approach_s, "quintic"
        self.linear = degree == "linear"
        velocities, accelerations = _filled(motion, times, scaling)
        whole = np.zeros((3, len(times), self.dimension))
        whole[:, :, self._places] = motion.positions, velocities, accelerations
        self.times_s = np.concatenate([[0.0], lead + (times - times[0])])
        widths = np.diff(self.times_s)
        self.polynomials = np.zeros((len(times), COEFFICIENTS, self.dimension))
        between = polynomial(degree, whole[:, :-1], whole[:, 1:], widths[1:, None])
        self.polynomials[1:] = between.swapaxes(0, 1)
        self._first = whole[:, 0].copy()
        if self.linear:
            self._first[1:] = 0.0
        self._last = motion.positions[-1].copy()
        self._end = np.zeros(self.dimension)
        self._times = self.times_s.tolist()
        self._widths = widths.tolist()
        self._powers, self._slopes = np.ones(COEFFICIENTS), np.zeros(COEFFICIENTS)
        self._orders = np.arange(1.0, COEFFICIENTS)
        self.rests_after_s = self._times[-1]
        self.start(None, 0.0)

    def start(self, present: FloatArray | None, time_s: float) -> None:
        """Begin at `present`; where nobody knows it, at the first point."""
        super().start(present, time_s)
        origin = np.zeros((3, self.dimension))
        origin[0] = self._first[0] if present is None else present
        self._stands[:] = self._end[self._rest] = origin[0, self._rest]
        self._end[self._places] = self._last
        if self._widths[0]:
            lead = self._lead_degree, origin, self._first, self._widths[0]
            self.polynomials[0] = polynomial(*lead)

    def follow(self, elapsed_s: float, position_out: FloatArray, velocity_out: FloatArray) -> None:
        """Write x_d and its velocity."""
        segment = bisect_right(self._times, elapsed_s) - 1
        if segment >= len(self._widths):
            position_out[:] = self._end
            velocity_out[:] = 0.0
            return
        powers, width = self._powers, self._widths[segment]
        z = (elapsed_s - self._times[segment]) / width
        powers[1] = z
        powers[2] = square = z * z
        powers[3] = square * z
        powers[4] = square * square
        powers[5] = square * square * z
        np.multiply(powers[:-1], self._orders, out=self._slopes[1:])
        np.dot(powers, self.polynomials[segment], out=position_out)
        np.dot(self._slopes, self.polynomials[segment], out=velocity_out)
        velocity_out /= width
        if self._stands.size:
            position_out[self._rest] = self._stands
            velocity_out[self._rest] = 0.0


def polynomial(
    degree: Degree, here: FloatArray, there: FloatArray, width: float | FloatArray
) -> FloatArray:
    """Coefficients of 1, z … z⁵ with z from 0 to 1, (6, …, m), between two ends.

    Args:
        degree: of it.
        here, there: position, velocity and acceleration at both ends, (3, …, m) [1, 1/s, 1/s²].
        width: duration [s], one, or (…, 1).
    """
    found = np.zeros((COEFFICIENTS, *here.shape[1:]))
    p, v, a = here[0], here[1] * width, here[2] * width**2
    w, b = there[1] * width, there[2] * width**2
    way = there[0] - p
    found[0] = p
    if degree == "linear":
        found[1] = way
    elif degree == "cubic":
        found[1], found[2], found[3] = v, 3.0 * way - 2.0 * v - w, v + w - 2.0 * way
    else:
        found[1], found[2] = v, 0.5 * a
        found[3] = 10.0 * way - 6.0 * v - 4.0 * w - 1.5 * a + 0.5 * b
        found[4] = -15.0 * way + 8.0 * v + 7.0 * w + 1.5 * a - b
        found[5] = 6.0 * way - 3.0 * v - 3.0 * w - 0.5 * a + 0.5 * b
    return found


def _filled(motion: Motion, times: FloatArray, scaling: float) -> tuple[FloatArray, FloatArray]:
    """Velocities and accelerations at all points, (k, m); those that are missing are found."""
    if motion.velocities is None:
        slopes = clamped_slopes(times, motion.positions, repeats=False)
    else:
        slopes = motion.velocities / scaling
        missing = np.isnan(slopes).any(0)
        slopes[:, missing] = clamped_slopes(times, motion.positions[:, missing], repeats=False)
    bends = np.zeros_like(slopes)
    if motion.accelerations is not None:
        bends = np.nan_to_num(motion.accelerations) / scaling**2
    return slopes, bends
