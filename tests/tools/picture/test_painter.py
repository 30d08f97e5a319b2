"""Faces that turn to the eye are painted from the farthest to the nearest, with their light."""

from __future__ import annotations

import numpy as np
import pytest

from hoap3.tools.picture.camera import Camera
from hoap3.tools.picture.painter import Face, painted
from hoap3.tools.picture.solids import Solid, faces_of


def box(center) -> list[Face]:
    return faces_of(Solid("link", "box", (1.0, 1.0, 1.0), np.array(center, float), np.eye(3)), 4)


def eye(azimuth=30.0, elevation=20.0) -> Camera:
    points = np.array([[-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]])
    return Camera.around(points, 100, 100, 0.0, azimuth, elevation)


@pytest.mark.parametrize("seed", range(5))
def test_what_is_nearer_is_painted_over_what_is_farther(seed):
    rng = np.random.default_rng(seed)
    camera = eye(rng.uniform(0, 360), rng.uniform(-80, 80))
    boxes = [box(2.0 * k * camera.toward + 0.3 * rng.normal() * camera.right) for k in range(5)]
    shuffled = rng.permutation(np.array([face for faces in boxes for face in faces], object))
    found = [each.points for each in painted(list(shuffled), camera) if each.form == "face"]
    assert len(found) == 15
    for k, faces in enumerate(boxes):
        expected = [camera.project(face.corners) for face in faces]
        for points in found[3 * k : 3 * k + 3]:
            assert any(np.allclose(points, each, atol=1e-9) for each in expected)


def test_light_comes_from_above_and_what_turns_away_is_not_painted():
    camera = eye(30.0, 30.0)
    flat = painted(box((0.0, 0.0, 0.0)), camera)
    faces = [each for each in flat if each.form == "face"]
    assert len(faces) == 3
    height = {each.role: each.points[:, 1].mean() for each in faces}
    levels = sorted(height, key=lambda role: -int(role.removeprefix("body")))
    assert len(levels) == 3
    assert height[levels[0]] == min(height.values())  # the top is the lightest


def test_only_flat_faces_have_edges_and_each_is_over_its_face():
    camera = eye(30.0, 30.0)
    cylinder = Solid("link", "cylinder", (0.1, 0.5), np.zeros(3), np.eye(3))
    flat = painted(faces_of(cylinder, 8), camera)
    (place,) = [k for k, each in enumerate(flat) if each.form == "loop"]
    assert len(flat[place].points) == 8
    assert flat[place].points == pytest.approx(flat[place - 1].points)


def test_nothing_is_painted_of_nothing():
    assert painted([], eye()) == []
