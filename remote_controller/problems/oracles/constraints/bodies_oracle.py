"""What distances are measured between: boxes, rounded by a radius, that are fixed to links.

A sphere is a box without extent, a capsule one with an extent along z only.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations, product
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from hoap3.protocol.robot.description import RobotDescription
from hoap3.remote_controller.problems.oracles.parameters import UnverifiableError, complete, numbers

Array = NDArray[np.float64]

PLACE: dict[str, Any] = {"shape": str, "name": str, "frame": None}
SHAPES: dict[str, dict[str, Any]] = {
    "sphere": {**PLACE, "center_m": None, "radius_m": float},
    "capsule": {**PLACE, "ends_m": None, "radius_m": float},
    "box": {**PLACE, "center_m": None, "size_m": None, "rpy_rad": None},
}


@dataclass(frozen=True, eq=False)
class Body:
    """A rounded box.

    Attributes:
        frame: that it is fixed to.
        centre, axes, half: (3,) [m], (3, 3), (3,) [m] of the box, in the frame.
        radius: of the rounding [m].
    """

    frame: str
    centre: Array
    axes: Array
    half: Array
    radius: float

    @property
    def edged(self) -> bool:
        """Whether it has edges: a sphere and a capsule have a core instead."""
        return bool(self.half[:2].any())


Pair = tuple[Body, Body]


def links_of(robot: RobotDescription) -> dict[str, list[Body]]:
    """The <collision> shapes of each link that has any; what contains it, for a cylinder."""
    found: dict[str, list[Body]] = {}
    for link in ET.fromstring(robot.urdf).iterfind("link"):  # noqa: S314 - checked before
        name = link.get("name", "")
        for collision in link.iterfind("collision"):
            origin = collision.find("origin")
            at = {} if origin is None else origin.attrib
            axes = _rotation(_read(at.get("rpy", "0 0 0")))
            for shape in collision.iterfind("geometry/*"):
                body = Body(name, _read(at.get("xyz", "0 0 0")), axes, *_extent(shape))
                found.setdefault(name, []).append(body)
    return found


def obstacle_of(given: object, base: str) -> tuple[str, Body]:
    """An obstacle of a config, and its name.

    Raises:
        UnverifiableError: it is none.
    """
    shape = given.get("shape") if isinstance(given, Mapping) else None
    if shape not in SHAPES:
        raise UnverifiableError(f"an obstacle is {given!r:.60}")
    one = complete(given, SHAPES[shape], "obstacle")
    frame = one["frame"] or base
    if shape == "sphere":
        centre, axes, half = _three(one["center_m"]), np.eye(3), np.zeros(3)
    elif shape == "capsule":
        first, second = (_three(end) for end in one["ends_m"] or (None, None))
        length = float(np.linalg.norm(second - first))
        centre, axes = (first + second) / 2.0, _with_z(second - first)
        half = np.array([0.0, 0.0, length / 2.0])
    else:
        centre, half = _three(one["center_m"]), _three(one["size_m"]) / 2.0
        axes = _rotation(_three(one["rpy_rad"] or (0.0, 0.0, 0.0)))
    return one["name"], Body(frame, centre, axes, half, float(one.get("radius_m", 0.0)))


def joints_between(robot: RobotDescription, first: str, second: str) -> int:
    """Number of movable joints on the way from one link to another."""
    above = {joint.child: joint for joint in robot.structure.joints}

    def passed(link: str) -> set[str]:
        names: set[str] = set()
        while link in above:
            names.add(above[link].name)
            link = above[link].parent
        return names

    return len((passed(first) ^ passed(second)) & set(robot.structure.moved))


def far_apart(robot: RobotDescription, links: Mapping[str, list[Body]], least: int) -> list[Pair]:
    """All shapes of links with at least so many joints between them."""
    return [
        pair
        for first, second in combinations(links, 2)
        if joints_between(robot, first, second) >= least
        for pair in shapes(links[first], links[second])
    ]


def shapes(first: list[Body], second: list[Body]) -> list[Pair]:
    """Every shape of the one with every one of the other; the edgeless, the shorter first."""

    def rank(body: Body) -> tuple[bool, float]:
        return body.edged, float(body.half[2])

    both = product(first, second)
    return [(a, b) if rank(a) <= rank(b) else (b, a) for a, b in both]


def _extent(shape: ET.Element) -> tuple[Array, float]:
    """Half the extents of the box, and the radius around it."""
    if shape.tag == "box":
        return _read(shape.get("size", "")) / 2.0, 0.0
    radius, length = float(shape.get("radius", "nan")), float(shape.get("length", "0"))
    if shape.tag == "cylinder" and length < 2.0 * radius:
        return np.array([radius, radius, length / 2.0]), 0.0
    return np.array([0.0, 0.0, length / 2.0]), radius


def _with_z(direction: Array) -> Array:
    """Some axes of which the third is along a direction, (3, 3)."""
    if not direction.any():
        return np.eye(3)
    z = direction / np.linalg.norm(direction)
    across = np.linalg.svd(z[None])[2][1:]
    if np.linalg.det(np.vstack([across, z])) < 0.0:
        across = across[::-1]
    return np.asarray(np.vstack([across, z]).T)


def _rotation(rpy: Array) -> Array:
    """Roll, pitch and yaw as in a URDF."""
    return np.asarray(Rotation.from_euler("xyz", rpy).as_matrix())


def _read(text: str) -> Array:
    return np.array(text.split(), float)


def _three(given: object) -> Array:
    return np.array(numbers(given, 3, "an obstacle"))
