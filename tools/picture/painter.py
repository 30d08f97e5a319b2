"""Faces in the order in which they are painted, each by how much light it gets.

The order is that of `mpl_toolkits.mplot3d`: by the mean depth of the corners, the farthest first.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hoap3.protocol.messages import FloatArray
from hoap3.tools.picture.camera import Camera
from hoap3.tools.picture.palette import SHADES
from hoap3.tools.picture.svg import Flat

LIGHTS = (  # along right, up and toward of the camera, and how strong
    ((-0.42, 0.78, 0.46), 0.64),
    ((0.85, 0.1, 0.5), 0.2),
)
AMBIENT = 0.26
EDGE = 4  # levels that an edge is darker than its face
EDGE_PX = 0.8


@dataclass(frozen=True, eq=False)
class Face:
    """A flat, convex face.

    Attributes:
        corners: (k, 3), counter-clockwise as seen from outside [m].
        outlined: whether its sides are drawn as edges.
        index: of the shape that it is a face of.
    """

    corners: FloatArray
    outlined: bool
    index: int = 0

    @property
    def normal(self) -> FloatArray:
        """Outwards, twice its area long, (3,) [m²]."""
        spokes = self.corners[1:] - self.corners[0]
        return np.asarray(np.cross(spokes[:-1], spokes[1:]).sum(axis=0))


def painted(faces: Sequence[Face], camera: Camera) -> list[Flat]:
    """Return the faces that turn to the camera, shaded, from the farthest to the nearest.

    Args:
        faces: of closed shapes.
        camera: that they are seen from.
    """
    lights = [
        (strength, np.array(place) @ camera.axes / np.linalg.norm(place))
        for place, strength in LIGHTS
    ]
    found = []
    for face in sorted(faces, key=lambda face: float(face.corners.mean(axis=0) @ camera.toward)):
        normal = face.normal
        if not normal @ camera.toward > 0.0:
            continue
        length = float(np.linalg.norm(normal))
        lit = AMBIENT + sum(k * max(0.0, float(normal @ to)) / length for k, to in lights)
        level = round(min(lit, 1.0) * (SHADES - 1))
        corners = camera.project(face.corners)
        found.append(Flat("face", corners, f"body{level}"))
        if face.outlined:
            found.append(Flat("loop", corners, f"body{max(0, level - EDGE)}", EDGE_PX))
    return found
