"""A robot on a floor, with the marks that matter: a picture, whole."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hoap3.protocol.messages import FloatArray
from hoap3.tools.picture.body import Body, Placement
from hoap3.tools.picture.camera import Camera
from hoap3.tools.picture.marks import Floor, Marks
from hoap3.tools.picture.painter import painted
from hoap3.tools.picture.svg import Flat


@dataclass(frozen=True, eq=False)
class Stage:
    """Where a robot is shown.

    Attributes:
        body: the robot.
        floor: on which it stands.
        camera: who sees it.
    """

    body: Body
    floor: Floor
    camera: Camera

    @classmethod
    def around(
        cls,
        body: Body,
        placements: Sequence[Placement],
        marks: Sequence[Marks],
        size: tuple[float, float],
        margin: float,
        **seen_from: float,
    ) -> Stage:
        """One on which the robot can be seen in some postures, with their marks.

        Args:
            body: the robot.
            placements, marks: what must be seen.
            size: width and height of the picture [px].
            margin: around all of it [px].
            seen_from: `azimuth_deg` and `elevation_deg` of `Camera.around`.
        """
        points = np.concatenate([body.points(placement) for placement in placements])
        floor = Floor.below(points)
        every = [points, floor.corners, *(each.points for each in marks)]
        return cls(body, floor, Camera.around(np.concatenate(every), *size, margin, **seen_from))

    def paint(self, placement: Placement, marks: Marks) -> list[Flat]:
        """Floor, shadow, robot and marks, one over the other.

        Args:
            placement: of the robot.
            marks: around it.
        """
        faces = self.body.faces(placement)
        bones = [] if faces else self._bones(placement)
        return [
            *self.floor.drawn(self.camera),
            *self.floor.shadows(faces, self.camera),
            *marks.under(self.floor, self.camera),
            *painted(faces, self.camera),
            *bones,
            *marks.over(self.floor, self.camera),
        ]

    def _bones(self, placement: Placement) -> list[Flat]:
        """Lines from frame to frame, of a robot that has no shapes."""
        ends: list[FloatArray] = [
            self.camera.project(placement.origins[[parent, child]])
            for parent, child in self.body.bones
        ]
        lines = [Flat("line", end, "soft", 3.0) for end in ends]
        return [*lines, *(Flat("dot", end[1:], "ink", 3.0) for end in ends)]
