"""What is drawn around a robot: the floor with its shadow, a point, a target and the way there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from hoap3.protocol.messages import FloatArray
from hoap3.remote_controller.constraints.support.polygon import hull
from hoap3.tools.picture.camera import Camera
from hoap3.tools.picture.painter import Face
from hoap3.tools.picture.svg import Flat

SQUARES_M = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0)
ACROSS = 9  # squares at most, about
FLAT = 0.01  # of the height of a robot: so far below the origin its soles are still on the ground
MOST_POINTS = 120  # of a path


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


@dataclass(frozen=True, eq=False)
class Marks:
    """Places in the world that matter.

    Attributes:
        point: (3,), of what is controlled [m].
        target: (3,), where that shall be [m].
        path: (m, 3), where it has been [m].
        way: (m, 3), where the target goes [m].
        support: (c, 2 or 3), corners of the support polygon, seen from above [m].
        plumb: whether a line leads from the point down to the floor, as from a centre of mass.
    """

    point: FloatArray | None = None
    target: FloatArray | None = None
    path: FloatArray | None = None
    way: FloatArray | None = None
    support: FloatArray | None = None
    plumb: bool = False

    @property
    def points(self) -> FloatArray:
        """All of them, but for the support polygon, which lies under the robot, (k, 3)."""
        single = [each[None] for each in (self.point, self.target) if each is not None]
        paths = [each for each in (self.path, self.way) if each is not None]
        return np.concatenate([np.empty((0, 3)), *single, *paths])

    def under(self, floor: Floor, camera: Camera) -> list[Flat]:
        """What is painted on the floor, below the robot."""
        if self.support is None or len(self.support) < 3:
            return []
        return [Flat("face", camera.project(floor.on(self.support)), "support")]

    def over(self, floor: Floor, camera: Camera, size: float = 5.0) -> list[Flat]:
        """What is seen through the robot.

        Args:
            floor, camera: where it is.
            size: radius of the point [px].
        """
        found = []
        if self.support is not None and len(self.support) > 2:
            found.append(Flat("loop", camera.project(floor.on(self.support)), "green", 1.4))
        if self.path is not None and len(self.path) > 1:
            found.append(Flat("line", camera.project(_thin(self.path)), "blue", 2.0))
        if self.way is not None and len(self.way) > 1:
            found.append(Flat("line", camera.project(_thin(self.way)), "red", 1.0))
        if self.plumb and self.point is not None:
            ends = np.stack((self.point, floor.on(self.point)))
            found.append(Flat("dash", camera.project(ends), "blue", 1.2))
            found.append(Flat("dot", camera.project(ends[1:]), "blue", 0.5 * size))
        if self.target is not None:
            at = camera.project(self.target[None])
            found += [Flat("ring", at, "red", 1.5 * size), Flat("cross", at, "red", 2.3 * size)]
        if self.point is not None:
            at = camera.project(self.point[None])
            found += [Flat("dot", at, "card", size + 1.5), Flat("dot", at, "blue", size)]
        return found


def _thin(points: FloatArray) -> FloatArray:
    """As many as can be seen."""
    chosen = np.linspace(0, len(points) - 1, min(len(points), MOST_POINTS))
    return np.asarray(points[chosen.round().astype(int)])
