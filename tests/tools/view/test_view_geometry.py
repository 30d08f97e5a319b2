"""Shapes of links: primitives of the description, meshes of the robot's folder by their digests."""

from __future__ import annotations

import hashlib
import struct
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest

import hoap3
from hoap3.tools.picture.solids import rotation_of
from hoap3.tools.view.picture.geometry import looks_of, primitives, quaternion

URDF = """<robot name="one">
<material name="blue"><color rgba="0 0 1 1"/></material>
<link name="base"><visual><origin xyz="0.1 0.2 0.3" rpy="0 0 1.5707963267948966"/>
<geometry><cylinder radius="0.05" length="0.4"/></geometry><material name="blue"/></visual></link>
<link name="arm"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><geometry><box size="0.1 0.2 0.3"/></geometry></collision></link>
<joint name="turn" type="revolute"><parent link="base"/><child link="arm"/>
<axis xyz="0 0 1"/><limit lower="-1" upper="1" velocity="1" effort="1"/></joint></robot>"""
CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], np.float32)
FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])


def stl(path: Path) -> None:
    """A tetrahedron as binary STL."""
    body = b"".join(struct.pack("<12fH", *np.zeros(3), *CORNERS[face].ravel(), 0) for face in FACES)
    path.write_bytes(bytes(80) + struct.pack("<I", len(FACES)) + body)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "meshes").mkdir()
    stl(tmp_path / "meshes" / "arm.stl")
    digest = hashlib.sha256((tmp_path / "meshes" / "arm.stl").read_bytes()).hexdigest()
    (tmp_path / "one.urdf").write_text(URDF)
    (tmp_path / "robot.yaml").write_text(
        f"name: one\nurdf: one.urdf\nmeshes:\n  - {{link: arm, file: arm.stl, sha256: {digest}, "
        "scale: [2.0, 1.0, 1.0], xyz_m: [0.0, 0.0, 0.5]}\n"
    )
    return tmp_path


def test_primitives_are_those_of_the_description(folder):
    shapes = primitives(hoap3.load_robot(folder))
    (cylinder,), (box,) = shapes["base"], shapes["arm"]
    assert (cylinder["shape"], cylinder["size"]) == ("cylinder", [0.05, 0.4])
    assert cylinder["color"] == [0, 0, 1, 1]
    half = np.sqrt(0.5)
    assert np.allclose(cylinder["origin"], [0.1, 0.2, 0.3, 0, 0, half, half])
    assert (box["shape"], box["size"]) == ("box", [0.1, 0.2, 0.3])


@pytest.mark.parametrize("name", ["hoap3", "ur5", "humanoid32"])
def test_every_visual_of_a_shipped_robot_is_drawn(name):
    robot = hoap3.load_robot(name)
    drawn = primitives(robot)
    assert set(drawn) == set(robot.frames)
    written = len(list(ET.fromstring(robot.urdf).iter("visual")))
    assert sum(map(len, drawn.values())) == written > 0


def test_a_mesh_of_the_folder_is_drawn_and_packed(folder):
    looks = looks_of(hoap3.load_robot(folder), str(folder))
    (shape,) = looks.visuals["arm"]
    assert (shape["shape"], shape["size"]) == ("mesh", [2.0, 1.0, 1.0])
    assert shape["origin"] == [0, 0, 0.5, 0, 0, 0, 1]
    raw = looks.meshes[shape["mesh"].removeprefix("/mesh/")]
    n, m = struct.unpack_from("<II", raw)
    vertices = np.frombuffer(raw, "<f4", 3 * n, 8).reshape(n, 3)
    triangles = np.frombuffer(raw, "<u4", 3 * m, 8 + 12 * n).reshape(m, 3)
    assert len(raw) == 8 + 12 * (n + m)
    found = {frozenset(map(tuple, vertices[each].tolist())) for each in triangles}
    assert found == {frozenset(map(tuple, CORNERS[face].tolist())) for face in FACES}
    assert looks.visuals["base"][0]["shape"] == "cylinder"


def test_a_mesh_that_is_another_one_is_not_drawn(folder):
    path = folder / "meshes" / "arm.stl"
    path.write_bytes(path.read_bytes() + b"\0")
    looks = looks_of(hoap3.load_robot(folder), str(folder))
    assert looks.visuals["arm"][0]["shape"] == "box"
    assert not looks.meshes
    assert len(looks.notes) == 1


def test_a_folder_of_another_robot_gives_no_mesh(folder):
    looks = looks_of(hoap3.load_robot("ur5"), str(folder))
    assert not looks.meshes
    assert len(looks.notes) == 1


def test_quaternions_turn_as_their_matrices():
    rng = np.random.default_rng(5)
    for rpy in rng.uniform(-np.pi, np.pi, (50, 3)):
        rotation = rotation_of(rpy)
        x, y, z, w = quaternion(rotation)
        v = np.array([x, y, z])
        for axis in np.eye(3):
            turned = axis + 2 * w * np.cross(v, axis) + 2 * np.cross(v, np.cross(v, axis))
            assert np.allclose(turned, rotation @ axis, atol=1e-12)
