"""What a robot's sensors show of a body that left its stops, or whose free base tilted or moved."""

from __future__ import annotations

import math

import numpy as np

from hoap3.protocol.messages import FloatArray
from hoap3.protocol.robot.description import RobotDescription

BEYOND_RAD, BEYOND_M = math.radians(0.5), 1e-3
"""How far beyond its stops a joint may be measured: simulated stops yield, encoders have noise."""

FALLEN_DEG = 45.0
"""Tilt from which on a free base has fallen."""


class BodyWatch:
    """Looks at each State that is published; docs/start/concepts.md defines its figures.

    Args:
        description: of the robot.
        q, base: the plant's own arrays, which it fills in place: (n,) [rad or m]; and (13,) as
            docs/reference/wire.md has it, or (0,) without a free base.
    """

    def __init__(self, description: RobotDescription, q: FloatArray, base: FloatArray) -> None:
        self._names = description.joint_names
        joints = description.structure.movable
        shift = [joints[name].kind == "prismatic" for name in self._names]
        self._units = ["m" if each else "rad" for each in shift]
        self._slack = np.where(shift, BEYOND_M, BEYOND_RAD)
        self._least = description.lower_hard - self._slack
        self._most = description.upper_hard + self._slack
        self._q, self._base = q, base
        self._inside, self._beyond = np.zeros((2, description.n))
        self._periods, self._first, self._first_tick = 0, -1, -1
        self._worst, self._worst_by, self._worst_share = -1, 0.0, 0.0
        self._free = base.size >= 7
        self._began: tuple[list[float], list[float]] | None = None  # up in the base, and place
        self._upright = 1.0  # cosine of the largest tilt
        self._fallen_tick = -1

    def look(self, tick: int) -> None:
        """Take what was measured for `tick`."""
        inside, beyond = self._inside, self._beyond
        np.maximum(self._q, self._least, out=inside)
        np.minimum(inside, self._most, out=inside)
        np.subtract(self._q, inside, out=beyond)
        if np.logical_or.reduce(beyond):
            self._count(tick)
        if self._free:
            self._look_at_base(tick)

    def summary(self) -> dict[str, object]:
        """`beyond_stops` and `base`, each None where there is nothing to tell."""
        return {"beyond_stops": self._beyond_stops(), "base": self._tell_base()}

    def _count(self, tick: int) -> None:
        """Count a period in which some joint is beyond its stops; not a number counts, too."""
        beyond = np.abs(self._beyond, out=self._beyond)
        np.divide(beyond, self._slack, out=self._inside)
        joint = int(np.argmax(self._inside))
        share = float(self._inside[joint])
        self._periods += 1
        if self._first < 0:
            self._first, self._first_tick = joint, tick
        if self._worst < 0 or share > self._worst_share:
            self._worst, self._worst_share = joint, share
            self._worst_by = float(np.nan_to_num(beyond[joint] + self._slack[joint]))

    def _beyond_stops(self) -> dict[str, object] | None:
        if not self._periods:
            return None
        return {
            "periods": self._periods,
            "first": self._names[self._first],
            "first_tick": self._first_tick,
            "furthest": self._names[self._worst],
            "furthest_by": self._worst_by,
            "unit": self._units[self._worst],
        }

    def _look_at_base(self, tick: int) -> None:
        up = self._up()
        if self._began is None:
            self._began = up, self._base[:3].tolist()
        upright = _dot(up, self._began[0])
        if upright < self._upright:
            self._upright = upright
            if self._fallen_tick < 0 and _degrees(upright) > FALLEN_DEG:
                self._fallen_tick = tick

    def _up(self) -> list[float]:
        """The world's z axis in the base's axes: the third row of R."""
        x, y, z, w = self._base[3:7].tolist()
        return [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)]

    def _tell_base(self) -> dict[str, object] | None:
        if self._began is None:
            return None
        up, place = self._began
        return {
            "tilt_deg": _degrees(_dot(self._up(), up)),
            "largest_tilt_deg": _degrees(self._upright),
            "fallen_tick": None if self._fallen_tick < 0 else self._fallen_tick,
            "moved_m": (self._base[:3] - place).tolist(),
        }


def _dot(a: list[float], b: list[float]) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _degrees(cosine: float) -> float:
    return math.degrees(math.acos(min(max(cosine, -1.0), 1.0)))
