"""Shapes as flat faces, and which of their sides are edges."""

from __future__ import annotations

import numpy as np

from hoap3.tools.picture.painter import Face
from hoap3.tools.picture.solids import Solid

_BOX = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))


def faces_of(solid: Solid, sides: int) -> list[Face]:
    """Faces of a shape, in the axes of its link.

    Args:
        solid: the shape.
        sides: of what is round, a multiple of 4. Edges are those of flat ends alone.
    """
    return [
        Face(face.corners @ solid.axes.T + solid.center, face.edges)
        for face in _own_faces(solid, sides)
    ]


def _own_faces(solid: Solid, sides: int) -> list[Face]:
    if solid.vertices is not None and solid.triangles is not None:
        smooth = np.zeros(3, np.bool_)
        return [Face(corners, smooth) for corners in solid.vertices[solid.triangles]]
    if solid.kind == "box":
        signs = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
        corners = 0.5 * signs * np.array(solid.size)
        return [Face(corners[list(face)], np.ones(4, np.bool_)) for face in _BOX]
    radius, length = (*solid.size, 0.0)[:2]
    if solid.kind == "cylinder":
        return _turned([(radius, -length / 2), (radius, length / 2)], sides)
    tilts = np.linspace(0.0, np.pi / 2, sides // 4 + 1)
    upper = [(radius * np.cos(t), radius * np.sin(t) + length / 2) for t in tilts[:-1]]
    lower = [(r, -z) for r, z in reversed(upper)]
    if length == 0.0:
        upper = upper[1:]  # the same equator
    pole = radius + length / 2
    return _turned([(0.0, -pole), *lower, *upper, (0.0, pole)], sides)


def _turned(profile: list[tuple[float, float]], sides: int) -> list[Face]:
    """Faces of a profile (radius, z), from below, that is turned about z; flat ends are closed."""
    angles = 2.0 * np.pi * (np.arange(sides + 1) % sides) / sides
    cosines, sines = np.cos(angles), np.sin(angles)
    rings = [np.column_stack((r * cosines, r * sines, np.full(sides + 1, z))) for r, z in profile]
    faces, smooth = [], np.zeros(4, np.bool_)
    for level in range(len(profile) - 1):
        low, high = rings[level], rings[level + 1]
        kept = [0, 1, 2, 3]
        if profile[level][0] == 0.0:
            kept = [1, 2, 3]
        elif profile[level + 1][0] == 0.0:
            kept = [0, 1, 2]
        for k in range(sides):
            corners = np.array([low[k], low[k + 1], high[k + 1], high[k]])
            faces.append(Face(corners[kept], smooth[kept]))
    edges = np.ones(sides, np.bool_)
    if profile[0][0] > 0.0:
        faces.append(Face(rings[0][:-1][::-1], edges))
    if profile[-1][0] > 0.0:
        faces.append(Face(rings[-1][:-1], edges))
    return faces
