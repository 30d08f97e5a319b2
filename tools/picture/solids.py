"""What the links of a robot look like: the shapes of its URDF, each where it is in its link.

A link is drawn with its <visual> shapes, and where it has none with its <collision> shapes. A URDF
has no capsules; a cylinder with a sphere of its radius at each end is one, as `urdf_import` writes
them. A shape without an extent, or one that is too large to be drawn, is left out.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from typing import Literal
from xml.etree import ElementTree as ET

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.messages import FloatArray
from hoap3.protocol.robot.description import RobotDescription
from hoap3.remote_controller.constraints.collision.collision_geometry import rotation
from hoap3.tools.picture.painter import Face

Kind = Literal["box", "cylinder", "capsule", "sphere", "mesh"]
FAR_M = 1e4  # no robot is larger
NEAR_M = 1e-6  # of ends of capsules, which a URDF has in decimals
_BOX = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
_SIZES: dict[str, tuple[Kind, tuple[str, ...]]] = {
    "box": ("box", ("size",)),
    "cylinder": ("cylinder", ("radius", "length")),
    "sphere": ("sphere", ("radius",)),
}


@dataclass(frozen=True, eq=False)
class Solid:
    """A shape of a link.

    Attributes:
        link: that it moves with.
        kind: what it is.
        size: box: its three extents; cylinder: radius, length; capsule: radius, length between
            the centres of its ends; sphere: radius [m]; mesh: nothing.
        center: (3,) in the link [m].
        axes: (3, 3), its axes as columns; a cylinder and a capsule lie along the third.
        color: red, green, blue, opacity of its material, from 0 to 1; None without one.
        vertices: (m, 3) of a mesh, in its own axes [m].
        triangles: (k, 3) of a mesh, corners as places in `vertices`.
    """

    link: str
    kind: Kind
    size: tuple[float, ...]
    center: FloatArray
    axes: FloatArray
    color: tuple[float, ...] | None = None
    vertices: FloatArray | None = None
    triangles: NDArray[np.int64] | None = None


def solids_of(description: RobotDescription) -> list[Solid]:
    """The shapes of all links of a robot, in the order of its URDF."""
    description.structure  # noqa: B018 - checks the text, so that it may be parsed
    robot = ET.fromstring(description.urdf)  # noqa: S314
    named = {
        material.get("name", ""): color
        for material in robot.iter("material")
        if (color := _rgba(material)) is not None
    }
    found = []
    for link in robot.iterfind("link"):
        shapes = _shapes(link, "visual", named) or _shapes(link, "collision", named)
        found += _with_capsules(shapes)
    return found


Colors = dict[str, tuple[float, ...]]


def _shapes(link: ET.Element, tag: str, named: Colors) -> list[Solid]:
    found = (_solid(link.get("name", ""), element, named) for element in link.iterfind(tag))
    return [solid for solid in found if solid is not None]


def _solid(link: str, element: ET.Element, named: Colors) -> Solid | None:
    shape = next(iter(element.iterfind("geometry/*")), None)
    if shape is None or shape.tag not in _SIZES:
        return None
    kind, keys = _SIZES[shape.tag]
    size = _numbers(" ".join(shape.get(key, "") for key in keys))
    origin = element.find("origin")
    given = {} if origin is None else origin.attrib
    center, rpy = (np.array(_numbers(given.get(key, "0 0 0"))) for key in ("xyz", "rpy"))
    wanted = 3 if kind == "box" else len(keys)
    figures = (*size, *np.abs(center))
    if len(size) != wanted or min(size) <= 0.0 or not max(figures) <= FAR_M:
        return None
    material = element.find("material")
    color = None if material is None else _rgba(material) or named.get(material.get("name", ""))
    return Solid(link, kind, size, center, rotation(*rpy), color)


def _rgba(material: ET.Element) -> tuple[float, ...] | None:
    """Of its <color>, if it has one that makes sense; readers of descriptions do not look."""
    color = material.find("color")
    try:
        values = _numbers("" if color is None else color.get("rgba", ""))
    except ValueError:
        return None
    return values if len(values) == 4 and all(0.0 <= value <= 1.0 for value in values) else None


def _numbers(text: str) -> tuple[float, ...]:
    """Of a text that `read_urdf` has checked, where it is there."""
    return tuple(map(float, text.split()))


def _with_capsules(solids: list[Solid]) -> list[Solid]:
    """A cylinder and the two spheres that follow it, as one capsule where they are one."""
    found: list[Solid] = []
    rest = list(solids)
    while rest:
        one = rest.pop(0)
        ends = rest[:2]
        if one.kind == "cylinder" and len(ends) == 2 and all(_closes(end, one) for end in ends):
            apart = np.linalg.norm(ends[0].center - ends[1].center)
            if abs(apart - one.size[1]) < 2 * NEAR_M:
                one = replace(one, kind="capsule")
                del rest[:2]
        found.append(one)
    return found


def _closes(sphere: Solid, cylinder: Solid) -> bool:
    """Whether a sphere is a round end of a cylinder."""
    if sphere.kind != "sphere" or abs(sphere.size[0] - cylinder.size[0]) > NEAR_M:
        return False
    half = 0.5 * cylinder.size[1] * cylinder.axes[:, 2]
    away = sphere.center - cylinder.center
    return bool(min(np.abs(away - half).max(), np.abs(away + half).max()) < NEAR_M)


def faces_of(solid: Solid, sides: int) -> list[Face]:
    """Faces of a shape, in the axes of its link.

    Args:
        solid: the shape.
        sides: of what is round, a multiple of 4. Edges are those of flat faces alone.
    """
    return [
        Face(face.corners @ solid.axes.T + solid.center, face.outlined)
        for face in _own_faces(solid, sides)
    ]


def _own_faces(solid: Solid, sides: int) -> list[Face]:
    if solid.vertices is not None and solid.triangles is not None:
        return [Face(corners, outlined=False) for corners in solid.vertices[solid.triangles]]
    if solid.kind == "box":
        signs = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
        corners = 0.5 * signs * np.array(solid.size)
        return [Face(corners[list(face)], outlined=True) for face in _BOX]
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
    circle = np.column_stack((np.cos(angles), np.sin(angles), np.ones(sides + 1)))
    rings = [circle * (radius, radius, z) for radius, z in profile]
    faces = [
        Face(np.array(corners), outlined=False)
        for low, high in itertools.pairwise(rings)
        for corners in zip(low[:-1], low[1:], high[1:], high[:-1], strict=True)
    ]
    if profile[0][0] > 0.0:
        faces.append(Face(rings[0][:0:-1], outlined=True))
    if profile[-1][0] > 0.0:
        faces.append(Face(rings[-1][1:], outlined=True))
    return faces
