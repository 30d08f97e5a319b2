"""What is painted last at a place is what a ray from the eye meets first there."""

from __future__ import annotations

import numpy as np
import pytest

from hoap3.tools.picture.camera import Camera
from hoap3.tools.picture.faces import faces_of
from hoap3.tools.picture.painted import painted
from hoap3.tools.picture.painter import Face, back_to_front
from hoap3.tools.picture.solids import Solid

MANY = 100_000


def box(center, size=(1.0, 1.0, 1.0), axes=None, index=0) -> list[Face]:
    axes = np.eye(3) if axes is None else axes
    solid = Solid("link", "box", tuple(size), np.array(center, float), np.array(axes, float))
    return [Face(face.corners, face.edges, index) for face in faces_of(solid, 4)]


def turned(rng) -> np.ndarray:
    axes, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return axes * np.sign(np.linalg.det(axes))


def facing(faces, toward) -> list[Face]:
    return [face for face in faces if face.normal @ toward > 0.0]


def inside(corners: np.ndarray, place: np.ndarray, spare: float) -> bool:
    """Whether a point is in a polygon that turns left, at least so far from its sides."""
    along = np.roll(corners, -1, axis=0) - corners
    away = along[:, 0] * (place[1] - corners[:, 1]) - along[:, 1] * (place[0] - corners[:, 0])
    return bool((away > spare * np.linalg.norm(along, axis=1)).all())


def first_met(faces, camera, place) -> tuple[int, float]:
    """The shape that a ray through a place of the picture meets first, and by how much."""
    met = []
    for face in faces:
        here = face.corners @ camera.axes.T
        if not inside(here[:, :2], place, 0.0):
            continue
        normal = camera.axes @ face.normal
        depth = here[0, 2] + (normal[:2] @ (here[0, :2] - place)) / normal[2]
        met.append((depth, face.index))
    met.sort(reverse=True)
    if not met:
        return -1, np.inf
    return met[0][1], met[0][0] - met[1][0] if len(met) > 1 else np.inf


def painted_last(pieces, camera, place) -> int:
    over = [p.index for p in pieces if inside((p.corners @ camera.axes.T)[:, :2], place, 0.0)]
    return over[-1] if over else -1


def eye(azimuth=30.0, elevation=20.0) -> Camera:
    points = np.array([[-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]])
    return Camera.around(points, 100, 100, 0.0, azimuth, elevation)


def test_of_two_boxes_the_nearer_one_is_painted_over_the_other():
    camera = eye(0.0, 0.0)  # from +x
    near, far = box((2.0, 0.2, 0.0), index=1), box((0.0, 0.0, 0.0), index=2)
    for faces in (near + far, far + near):
        order = [
            face.index for face in back_to_front(facing(faces, camera.toward), camera.toward, MANY)
        ]
        assert order == [2, 1]  # of each one face is seen


def test_a_long_box_before_a_small_one_whose_middle_is_nearer():
    camera = eye(0.0, 0.0)
    faces = box((0.0, 0.0, 0.0), (0.2, 0.2, 0.2), index=1)
    slope = np.array([[1.0, 0.0, 0.9], [0.0, 1.0, 0.0], [-0.9, 0.0, 1.0]]) / np.sqrt(1.81)
    slope[:, 1] = (0.0, 1.0, 0.0)
    faces += box((-0.6, 0.0, 1.2), (0.1, 1.0, 4.0), slope, index=2)  # its lower end comes nearer
    pieces = back_to_front(facing(faces, camera.toward), camera.toward, MANY)
    for place in ((0.05, 0.05), (-0.05, -0.05)):
        met, _ = first_met(facing(faces, camera.toward), camera, np.array(place))
        assert painted_last(pieces, camera, np.array(place)) == met


@pytest.mark.parametrize("seed", range(5))
def test_boxes_that_reach_into_each_other_hide_each_other_as_rays_say(seed):
    rng = np.random.default_rng(seed)
    camera = eye(rng.uniform(0, 360), rng.uniform(-80, 80))
    faces = [
        face
        for index in range(5)
        for face in box(rng.uniform(-0.6, 0.6, 3), rng.uniform(0.2, 1.2, 3), turned(rng), index)
    ]
    shown = facing(faces, camera.toward)
    pieces = back_to_front(shown, camera.toward, MANY)
    compared = 0
    for place in rng.uniform(-1.0, 1.0, (40, 2)):
        met, by = first_met(shown, camera, place)
        if by > 1e-6:
            compared += met >= 0
            assert painted_last(pieces, camera, place) == met
    assert compared > 10


def test_bars_that_hide_each_other_in_a_circle():
    camera = eye(0.0, 90.0)  # from above; each bar slopes over the next one
    faces = []
    for index, angle in enumerate(np.radians([0.0, 120.0, 240.0])):
        c, s = np.cos(angle), np.sin(angle)
        along = np.array([c, s, 0.25]) / np.hypot(1.0, 0.25)
        across = np.array([-s, c, 0.0])
        axes = np.column_stack((along, across, np.cross(along, across)))
        center = 0.45 * np.array([s, -c, 0.0])
        faces += box(center, (3.0, 0.2, 0.02), axes, index)
    shown = facing(faces, camera.toward)
    pieces = back_to_front(shown, camera.toward, MANY)
    rng, met = np.random.default_rng(3), set()
    for place in rng.uniform(-1.0, 1.0, (400, 2)):
        first, by = first_met(shown, camera, place)
        if np.inf > by > 1e-6:  # where two are over each other
            met.add(first)
            assert painted_last(pieces, camera, place) == first
    assert met == {0, 1, 2}


def test_faces_of_a_shape_that_is_not_convex_hide_each_other():
    camera = eye(0.0, 0.0)
    faces = box((1.0, 0.0, 0.0)) + box((-1.0, 0.1, 0.1))
    mesh = [Face(face.corners, face.edges, 0, convex=False) for face in faces]
    pieces = back_to_front(facing(mesh, camera.toward), camera.toward, MANY)
    assert [piece.corners[0, 0] for piece in pieces] == [-0.5, 1.5]


def test_there_are_never_more_faces_than_asked_for():
    rng = np.random.default_rng(0)
    camera = eye()
    faces = [
        f
        for index in range(12)
        for f in box(rng.uniform(-0.5, 0.5, 3), (1, 1, 1), turned(rng), index)
    ]
    shown = facing(faces, camera.toward)
    free = back_to_front(shown, camera.toward, MANY)
    bound = (len(shown) + len(free)) // 2
    bounded = back_to_front(shown, camera.toward, bound)
    assert len(shown) < len(bounded) <= bound < len(free)
    assert {face.index for face in bounded} == set(range(12))


@pytest.mark.parametrize("seed", range(4))
def test_cuts_add_no_edges_and_lose_none_and_no_area(seed):
    rng = np.random.default_rng(seed)
    camera = eye()
    faces = [
        f
        for index in range(5)
        for f in box(rng.uniform(-0.3, 0.3, 3), (1, 1, 1), turned(rng), index)
    ]
    shown = facing(faces, camera.toward)
    pieces = back_to_front(shown, camera.toward, MANY)
    assert len(pieces) > len(shown)

    def edges(of) -> float:
        sides = [np.roll(f.corners, -1, axis=0) - f.corners for f in of]
        return sum(np.linalg.norm(s[f.edges], axis=1).sum() for s, f in zip(sides, of, strict=True))

    assert edges(pieces) == pytest.approx(edges(shown), rel=1e-9)
    areas = [sum(np.linalg.norm(f.normal) for f in of) for of in (pieces, shown)]
    assert areas[0] == pytest.approx(areas[1], rel=1e-9)


def test_light_comes_from_above_and_what_turns_away_is_not_painted():
    camera = eye(30.0, 30.0)
    flat = painted(box((0.0, 0.0, 0.0)), camera, MANY)
    faces = [each for each in flat if each.form == "face"]
    assert len(faces) == 3
    height = {each.role: each.points[:, 1].mean() for each in faces}
    levels = sorted(height, key=lambda role: -int(role.removeprefix("body")))
    assert len(levels) == 3
    assert height[levels[0]] == min(height.values())  # the top is the lightest


def test_nothing_is_painted_of_nothing():
    assert back_to_front([], np.array([1.0, 0.0, 0.0]), MANY) == []
    assert painted([], eye(), MANY) == []
