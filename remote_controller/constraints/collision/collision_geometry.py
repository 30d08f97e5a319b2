"""Rounded boxes: what distances are measured between.

A body is all points within a radius of a box. A sphere is a box without extent, a capsule one
with an extent along z only.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal
from xml.etree import ElementTree as ET

import numpy as np
from pydantic import Field

from hoap3.protocol.config.settings import Settings
from hoap3.protocol.messages import FloatArray
from hoap3.protocol.robot.description import RobotDescription

Triple = tuple[float, float, float]
Positive = Annotated[float, Field(gt=0)]


@dataclass(frozen=True, eq=False)
class Body:
    """A rounded box that is fixed to a frame; equal to itself alone.

    Attributes:
        name: of the link or of the obstacle.
        frame: what it is fixed to.
        center: (3,) in that frame [m].
        axes: (3, 3) its axes as columns, in that frame.
        half: (3,) half the box's extents along them [m].
        radius: of the rounding [m].
    """

    name: str
    frame: str
    center: FloatArray
    axes: FloatArray
    half: FloatArray
    radius: float

    @property
    def edged(self) -> bool:
        """Whether its box has edges: those of a sphere and of a capsule are a point and a core."""
        return bool(self.half[:2].any())


class Obstacle(Settings):
    """Something in the world, or an additional part of the robot."""

    name: str = Field(min_length=1, description="in rows and events")
    frame: str | None = Field(None, description="what it is fixed to; none: the base frame")


class Sphere(Obstacle):
    """A ball."""

    shape: Literal["sphere"]
    center_m: Triple = Field(description="in its frame [m]")
    radius_m: Positive = Field(description="of the ball [m]")

    def body(self, base: str) -> Body:
        """As a rounded box."""
        center = np.array(self.center_m)
        return Body(self.name, self.frame or base, center, np.eye(3), np.zeros(3), self.radius_m)


class Capsule(Obstacle):
    """All points within a radius of a segment."""

    shape: Literal["capsule"]
    ends_m: tuple[Triple, Triple] = Field(description="of the segment, in its frame [m]")
    radius_m: Positive = Field(description="of its rounding [m]")

    def body(self, base: str) -> Body:
        """As a rounded box."""
        first, second = np.array(self.ends_m)
        half = np.array([0.0, 0.0, float(np.linalg.norm(second - first)) / 2])
        center, axes = (first + second) / 2, axes_along(second - first)
        return Body(self.name, self.frame or base, center, axes, half, self.radius_m)


class Box(Obstacle):
    """A box with sharp edges."""

    shape: Literal["box"]
    center_m: Triple = Field(description="in its frame [m]")
    size_m: tuple[Positive, Positive, Positive] = Field(description="whole extents [m]")
    rpy_rad: Triple = Field(
        (0.0, 0.0, 0.0), description="roll, pitch, yaw of its axes, as in URDF [rad]"
    )

    def body(self, base: str) -> Body:
        """As a rounded box, of radius 0."""
        half = np.array(self.size_m) / 2
        center, axes = np.array(self.center_m), rotation(*self.rpy_rad)
        return Body(self.name, self.frame or base, center, axes, half, 0.0)


AnyObstacle = Annotated[Sphere | Capsule | Box, Field(discriminator="shape")]


def links(description: RobotDescription) -> dict[str, tuple[Body, ...]]:
    """The <collision> shapes of every link of the URDF that has any, by link name.

    Boxes and spheres are what they are. A cylinder is no rounded box, so a body that contains it
    stands for it: a capsule about its axis, whose ends stick out by the radius; or, where it is
    wider than long, the box around it.
    """
    found = {}
    for link in ET.fromstring(description.urdf).findall("link"):  # noqa: S314 - checked before
        name = str(link.get("name"))
        shapes = tuple(
            _body(name, shape, collision.find("origin"))
            for collision in link.iterfind("collision")
            for shape in collision.iterfind("geometry/*")
        )
        if shapes:
            found[name] = shapes
    return found


def axes_along(direction: FloatArray) -> FloatArray:
    """Some rotation whose third column is along `direction`, (3, 3)."""
    length = float(np.linalg.norm(direction))
    if length == 0.0:
        return np.eye(3)
    z = direction / length
    x = np.cross(np.eye(3)[int(np.abs(z).argmin())], z)
    x /= np.linalg.norm(x)
    return np.stack((x, np.cross(z, x), z), axis=1)


def rotation(roll: float, pitch: float, yaw: float) -> FloatArray:
    """Rz(yaw)·Ry(pitch)·Rx(roll), (3, 3), as URDF has it [rad]."""
    (a, b, c), (d, e, f) = np.cos((roll, pitch, yaw)), np.sin((roll, pitch, yaw))
    return np.array(
        [
            [c * b, c * e * d - f * a, c * e * a + f * d],
            [f * b, f * e * d + c * a, f * e * a - c * d],
            [-e, b * d, b * a],
        ]
    )


def _body(link: str, shape: ET.Element, origin: ET.Element | None) -> Body:
    given = {} if origin is None else origin.attrib
    center = _numbers(given.get("xyz", "0 0 0"))
    half, radius = _extent(shape)
    return Body(link, link, center, rotation(*_numbers(given.get("rpy", "0 0 0"))), half, radius)


def _extent(shape: ET.Element) -> tuple[FloatArray, float]:
    """Half the extents of a shape's box, and the radius around it."""
    if shape.tag == "box":
        return _numbers(str(shape.get("size"))) / 2, 0.0
    radius = float(str(shape.get("radius")))
    if shape.tag == "sphere":
        return np.zeros(3), radius
    length = float(str(shape.get("length")))
    if length < 2.0 * radius:
        return np.array([radius, radius, length / 2]), 0.0
    return np.array([0.0, 0.0, length / 2]), radius


def _numbers(text: str) -> FloatArray:
    return np.array([float(number) for number in text.split()])
