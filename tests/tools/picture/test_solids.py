"""The shapes of a URDF, as closed faces of the right size at the right place."""

from __future__ import annotations

import math

import numpy as np
import pytest
from support.log_samples import describe

from hoap3.robot_emulator.robots import available, load
from hoap3.tools.picture.body import SIDES, Body
from hoap3.tools.picture.solids import Solid, faces_of, solids_of

ROUND = 64


def volume(faces) -> float:
    """By the divergence theorem: right where the faces are closed and turn outwards."""
    return sum(float(face.corners[0] @ face.normal) for face in faces) / 6.0


def solid(kind, *size, center=(0.3, -0.2, 0.5), axes=None) -> Solid:
    axes = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]) if axes is None else axes
    return Solid("link", kind, size, np.array(center), axes)


def polygon(sides: int) -> float:
    """Area of a regular polygon in a circle of radius 1."""
    return 0.5 * sides * math.sin(2.0 * math.pi / sides)


@pytest.mark.parametrize("sides", SIDES)
def test_faces_are_closed_turn_outwards_and_hold_what_the_shape_holds(sides):
    assert volume(faces_of(solid("box", 0.2, 0.3, 0.4), sides)) == pytest.approx(0.024)
    cylinder = volume(faces_of(solid("cylinder", 0.1, 0.5), sides))
    assert cylinder == pytest.approx(0.01 * polygon(sides) * 0.5)
    ball = volume(faces_of(solid("sphere", 0.1), sides))
    capsule = volume(faces_of(solid("capsule", 0.1, 0.5), sides))
    assert capsule == pytest.approx(cylinder + ball)


def test_many_sides_make_it_round():
    ball = volume(faces_of(solid("sphere", 0.1), ROUND))
    assert ball == pytest.approx(4.0 / 3.0 * math.pi * 1e-3, rel=1e-2)


def with_shapes(shapes: str, tag: str = "visual"):
    robot = describe(1)
    made = f'<link name="link_0"><{tag}>{shapes}</{tag}>'
    return robot.model_copy(update={"urdf": robot.urdf.replace('<link name="link_0">', made, 1)})


@pytest.mark.parametrize("tag", ["visual", "collision"])
def test_a_shape_is_where_its_origin_says(tag):
    given = (
        '<origin xyz="1 2 3" rpy="0 0 1.5707963267948966"/><geometry><box size="4 2 1"/></geometry>'
    )
    (shape,) = solids_of(with_shapes(given, tag))
    assert (shape.link, shape.kind, shape.size) == ("link_0", "box", (4.0, 2.0, 1.0))
    corners = np.concatenate([face.corners for face in faces_of(shape, 4)])
    assert corners.min(axis=0) == pytest.approx([0.0, 0.0, 2.5])
    assert corners.max(axis=0) == pytest.approx([2.0, 4.0, 3.5])


@pytest.mark.parametrize(
    "shape",
    [
        "",
        "<geometry/>",
        '<geometry><box size="0 1 1"/></geometry>',
        '<geometry><box size="-1 1 1"/></geometry>',
        '<geometry><box size="1e300 1 1"/></geometry>',
        "<geometry><box/></geometry>",
        '<geometry><cylinder radius="1"/></geometry>',
        '<geometry><sphere radius="0"/></geometry>',
        '<origin xyz="1e9 0 0"/><geometry><sphere radius="1"/></geometry>',
    ],
)
def test_a_shape_that_cannot_be_drawn_is_left_out(shape):
    assert solids_of(with_shapes(shape)) == []


def test_a_cylinder_between_two_spheres_is_a_capsule():
    ends = "".join(
        f'</visual><visual><origin xyz="{x} 0 0"/><geometry><sphere radius="0.1"/></geometry>'
        for x in (0.2, -0.2)
    )
    lying = '<origin rpy="0 1.5707963267948966 0"/><geometry><cylinder radius="0.1" length="0.4"/>'
    (shape,) = solids_of(with_shapes(f"{lying}</geometry>{ends}"))
    assert (shape.kind, shape.size) == ("capsule", (0.1, 0.4))
    apart = ends.replace("-0.2", "-0.3")
    kinds = [each.kind for each in solids_of(with_shapes(f"{lying}</geometry>{apart}"))]
    assert kinds == ["cylinder", "sphere", "sphere"]


@pytest.mark.parametrize("name", available())
def test_every_shipped_robot_has_shapes_of_links_that_it_has(name):
    robot = load(name)
    shapes = solids_of(robot)
    assert len(shapes) > 3
    assert {shape.link for shape in shapes} <= set(robot.frames)


def test_of_many_shapes_the_largest_are_drawn():
    shapes = [solid("box", *[0.01 * (k + 1)] * 3) for k in range(40)]
    robot = describe(1)
    shapes = [Solid("link_0", s.kind, s.size, s.center, s.axes) for s in shapes]
    body = Body(robot, 60, shapes)
    assert body.left_out == 30
    assert [shape.size[0] for shape in body.solids] == pytest.approx(np.arange(31, 41) / 100)
    assert len(body.faces(body.place(np.zeros(1)))) == 60


def test_round_shapes_get_as_many_sides_as_there_is_room_for():
    robot = describe(1)
    shapes = [Solid("link_0", "cylinder", (0.1, 0.2), np.zeros(3), np.eye(3))] * 10
    for most, sides in ((340, 32), (339, 24), (180, 16), (60, 4)):
        body = Body(robot, most, shapes)
        assert len(body.faces(body.place(np.zeros(1)))) == 10 * (sides + 2)
        assert body.left_out == 0
