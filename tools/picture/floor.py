"""The floor under a robot: in squares, with the shadow of the robot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from hoap3.protocol.messages import FloatArray
from hoap3.tools.picture.camera import Camera
from hoap3.tools.picture.flat import Flat
from hoap3.tools.picture.painter import Face

SQUARES_M = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0)
ACROSS = 9  # squares at most, about
FLAT = 0.01  # of the height of a robot: so far below the origin its soles are still on the ground


@dataclass(frozen=True, eq=False)
class Floor:
    """A floor in squares.

    Attributes:
        low, high: (2,) its corners, multiples of a square [m].
        height: z [m].
        square: side of a square [m].
    """

    low: FloatArray
    high: FloatArray
    height: float
    square: float

    @classmethod
    def below(cls, points: FloatArray) -> Floor:
        """One on which all points, (m, 3) [m], m > 0, stand; not above the world's origin."""
        low, high = points.min(axis=0), points.max(axis=0)
        size = high - low
        wide = 1.15 * float(size[:2].max())
        square = next((side for side in SQUARES_M if wide <= ACROSS * side), wide / ACROSS)
        first = np.floor(low[:2] / square - 0.25) * square
        last = np.ceil(high[:2] / square + 0.25) * square
        height = float(low[2])
        return cls(first, last, height if height < -FLAT * float(size[2]) else 0.0, square)

    @property
    def corners(self) -> FloatArray:
        """(4, 3) [m]."""
        (x, y), (X, Y) = self.low, self.high
        return self.on([[x, y], [X, y], [X, Y], [x, Y]])

    def on(self, points: ArrayLike) -> FloatArray:
        """Points on it, below points (…, 2 or 3) [m]."""
        flat = np.asarray(points, np.float64)[..., :2]
        return np.concatenate((flat, np.full((*flat.shape[:-1], 1), self.height)), axis=-1)

    def drawn(self, camera: Camera) -> list[Flat]:
        """Its surface and its lines."""
        found = [Flat("face", camera.project(self.corners), "floor")]
        for axis in (0, 1):
            count = round((self.high[axis] - self.low[axis]) / self.square)
            for place in range(count + 1):
                ends = np.array([self.low, self.high])
                ends[:, axis] = self.low[axis] + place * self.square
                found.append(Flat("line", camera.project(self.on(ends)), "rule", 1.0))
        return found

    def shadows(self, faces: Sequence[Face], camera: Camera) -> list[Flat]:
        """What the light from above leaves dark on the floor, one outline a shape."""
        shapes: dict[int, list[FloatArray]] = {}
        for face in faces:
            shapes.setdefault(face.index, []).append(face.corners[:, :2])
        outlines = [hull(np.concatenate(corners)) for corners in shapes.values()]
        return [
            Flat("face", camera.project(self.on(outline)), "shadow")
            for outline in outlines
            if len(outline) > 2
        ]


def hull(points: FloatArray) -> FloatArray:
    """Convex hull of points (m, 2), turning left: A. M. Andrew, Inf. Process. Lett. 9(5), 1979."""
    ordered = np.unique(points, axis=0)
    if len(ordered) < 3:
        return ordered
    halves = []
    for row in (ordered, ordered[::-1]):
        chain: list[FloatArray] = []
        for point in row:
            while len(chain) > 1 and _turn(chain[-2], chain[-1], point) <= 0.0:
                chain.pop()
            chain.append(point)
        halves += chain[:-1]
    return np.array(halves)


def _turn(a: FloatArray, b: FloatArray, c: FloatArray) -> float:
    return float((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))
