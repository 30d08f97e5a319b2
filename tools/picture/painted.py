"""Faces with the light that falls on them, in the order in which they hide each other."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.messages import FloatArray
from hoap3.tools.html.palette import SHADES
from hoap3.tools.picture.camera import Camera
from hoap3.tools.picture.flat import Flat
from hoap3.tools.picture.painter import Face, back_to_front

LIGHTS = (  # along right, up and toward of the camera, and how strong
    ((-0.42, 0.78, 0.46), 0.64),
    ((0.85, 0.1, 0.5), 0.2),
)
AMBIENT = 0.26
EDGE = 4  # levels that an edge is darker than its face
EDGE_PX = 0.8


def painted(
    faces: Sequence[Face], camera: Camera, most: int, tints: Sequence[str] | None = None
) -> list[Flat]:
    """Faces as they hide each other, each by how much light it gets.

    Args:
        faces: of closed shapes.
        camera: who sees them.
        most: faces at the most.
        tints: the family of shades of each `Face.index`, of `palette.FAMILIES`; default: "body".
    """
    lights = [
        (strength, np.array(place) @ camera.axes / np.linalg.norm(place))
        for place, strength in LIGHTS
    ]
    shown = [face for face in faces if face.normal @ camera.toward > 0.0]
    found = []
    for face in back_to_front(shown, camera.toward, most):
        normal = face.normal
        length = float(np.linalg.norm(normal))
        if not length > 0.0:
            continue
        lit = AMBIENT + sum(k * max(0.0, float(normal @ to)) / length for k, to in lights)
        level = round(min(lit, 1.0) * (SHADES - 1))
        tint = "body" if tints is None else tints[face.index]
        corners = camera.project(face.corners)
        found.append(Flat("face", corners, f"{tint}{level}"))
        edge = f"{tint}{max(0, level - EDGE)}"
        found += [Flat("line", line, edge, EDGE_PX) for line in _lines(corners, face.edges)]
    return found


def _lines(corners: FloatArray, edges: NDArray[np.bool_]) -> list[FloatArray]:
    """The sides of a polygon that are edges, as lines that are as long as they can be."""
    count = len(edges)
    if edges.all():
        return [np.vstack((corners, corners[:2]))]
    begins = [place for place in range(count) if edges[place] and not edges[place - 1]]
    lines = []
    for begin in begins:
        end = next(k for k in range(begin, begin + count) if not edges[k % count])
        lines.append(corners[np.arange(begin, end + 1) % count])
    return lines
