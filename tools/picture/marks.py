"""What is drawn beside a robot: a point of it, a target, the way there, where it stands."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hoap3.protocol.messages import FloatArray
from hoap3.tools.picture.camera import Camera
from hoap3.tools.picture.flat import Flat
from hoap3.tools.picture.floor import Floor

MOST_POINTS = 120  # of a path


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
        if self.way is not None and len(self.way) > 1:
            found.append(Flat("line", camera.project(_thin(self.way)), "red", 1.0))
        if self.path is not None and len(self.path) > 1:
            found.append(Flat("line", camera.project(_thin(self.path)), "blue", 2.0))
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
