"""Meshes of a folder are drawn in their places, outwards, and with as few triangles as asked."""

from __future__ import annotations

import hashlib
import struct

import numpy as np
import pytest
from support.log_samples import describe

from hoap3.tools.picture.meshes import coarser, dressed
from hoap3.tools.picture.solids import faces_of

CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], np.float32)
FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])


def ball(around: int):
    """A sphere of many triangles, closed but for its poles, and their corners turning left."""
    turns, tilts = np.arange(around), np.arange(around // 2)
    a, b = np.meshgrid(2 * np.pi * turns / around, np.pi * (tilts + 0.5) / len(tilts))
    points = np.stack((np.sin(b) * np.cos(a), np.sin(b) * np.sin(a), -np.cos(b)), -1)
    number = np.arange(around * len(tilts)).reshape(len(tilts), around)
    low, high = number[:-1], number[1:]
    low_after, high_after = np.roll(low, -1, axis=1), np.roll(high, -1, axis=1)
    first = np.stack((low, low_after, high_after), -1).reshape(-1, 3)
    return points.reshape(-1, 3), np.concatenate(
        (first, np.stack((low, high_after, high), -1).reshape(-1, 3))
    )


@pytest.mark.parametrize("most", [50, 200, 1000])
def test_a_coarser_mesh_has_few_triangles_and_the_same_shape(most):
    vertices, triangles = ball(80)
    fewer, left = coarser(vertices, triangles, most)
    assert 0.2 * most < len(left) <= most < len(triangles)
    away = np.linalg.norm(fewer[np.unique(left)], axis=1)
    assert np.abs(away - 1.0).max() < (0.4 if most == 50 else 0.15)
    a, b, c = fewer[left].transpose(1, 0, 2)
    assert (np.einsum("ij,ij->i", np.cross(b - a, c - a), a + b + c) > 0.0).mean() > 0.95


def robot_with_mesh(folder, scale):
    robot = describe(1)
    body = b"".join(struct.pack("<12fH", *np.zeros(3), *CORNERS[f].ravel(), 0) for f in FACES)
    stl = bytes(80) + struct.pack("<I", len(FACES)) + body
    (folder / "meshes").mkdir()
    (folder / "meshes" / "arm.stl").write_bytes(stl)
    (folder / "one.urdf").write_text(robot.urdf)
    (folder / "robot.yaml").write_text(
        f"name: sample\nurdf: one.urdf\nmeshes:\n  - {{link: link_1, file: arm.stl, sha256: "
        f"{hashlib.sha256(stl).hexdigest()}, scale: {scale}, xyz_m: [0.0, 0.0, 0.5]}}\n"
    )
    return robot


@pytest.mark.parametrize("scale", [[2.0, 1.0, 1.0], [-2.0, 1.0, 1.0]])
def test_a_mesh_of_a_folder_is_in_its_place_and_turns_outwards(scale, tmp_path):
    robot = robot_with_mesh(tmp_path, scale)
    (solid,), notes = dressed(robot, str(tmp_path), 100)
    assert notes == []
    assert (solid.link, solid.kind) == ("link_1", "mesh")
    faces = faces_of(solid, 4)
    corners = np.concatenate([face.corners for face in faces])
    x = sorted((0.0, scale[0]))
    assert corners.min(axis=0) == pytest.approx([x[0], 0.0, 0.5])
    assert corners.max(axis=0) == pytest.approx([x[1], 1.0, 1.5])
    volume = sum(float(face.corners[0] @ face.normal) for face in faces) / 6.0
    assert volume == pytest.approx(2.0 / 6.0)


def test_without_a_folder_or_with_that_of_another_robot_no_mesh_is_drawn(tmp_path):
    robot = robot_with_mesh(tmp_path, [1.0, 1.0, 1.0])
    assert dressed(robot, None, 100) == ([], [])
    shapes, notes = dressed(describe(2), str(tmp_path), 100)
    assert shapes == []
    assert len(notes) == 1
