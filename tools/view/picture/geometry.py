"""What a robot looks like: the shapes of its links, and its meshes by their digests.

A description has primitives. Where the robot's folder is on this machine, its meshes are drawn
instead: those whose content has the digest that `robot.yaml` names, and no others.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.description import RobotDescription
from hoap3.protocol.errors import UsageError
from hoap3.protocol.messages import FloatArray
from hoap3.robot_emulator.robots import find_file
from hoap3.robot_emulator.robots.urdf_import.folder import MESHES
from hoap3.robot_emulator.robots.urdf_import.shapes.mesh_files import MeshError, digest
from hoap3.robot_emulator.robots.yaml_file import MeshEntry, read_files

GREY = (0.62, 0.65, 0.70, 1.0)
MESH_LIMIT = 400_000  # triangles of all meshes that are drawn; a page must stay fluent
Shape = dict[str, Any]


@dataclass
class Looks:
    """Shapes of a robot's links.

    Attributes:
        visuals: by link, as the page takes them.
        meshes: as the page takes them, by the digest of their files.
        notes: what is drawn otherwise than `robot.yaml` says, and why.
    """

    visuals: dict[str, list[Shape]]
    meshes: dict[str, bytes] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)


def looks_of(description: RobotDescription, robot: str | None = None) -> Looks:
    """How to draw a robot.

    Args:
        description: of the robot.
        robot: its name or path on this machine, whose folder has its meshes; None where it is not
            here.
    """
    looks = Looks(primitives(description))
    if robot is not None:
        _add_meshes(looks, description, robot)
    return looks


def primitives(description: RobotDescription) -> dict[str, list[Shape]]:
    """The <visual> shapes of each link, its <collision> shapes where it has none."""
    robot = ET.fromstring(description.urdf)  # noqa: S314 (the description has checked it)
    colors = _colors(robot)
    found: dict[str, list[Shape]] = {}
    for link in robot.iterfind("link"):
        parts = link.findall("visual") or link.findall("collision")
        shapes = [_primitive(part, colors) for part in parts]
        found[link.get("name", "")] = [shape for shape in shapes if shape is not None]
    return found


def packed(vertices: FloatArray, triangles: NDArray[np.int64]) -> bytes:
    """A mesh as the page takes it: both counts, vertices, triangles, little endian.

    Args:
        vertices: (n, 3) [m].
        triangles: (m, 3) places of their corners.
    """
    head = struct.pack("<II", len(vertices), len(triangles))
    return head + vertices.astype("<f4").tobytes() + triangles.astype("<u4").tobytes()


def pose(xyz: FloatArray, rotation: FloatArray) -> list[float]:
    """Position and quaternion x y z w of a rotation matrix, (3, 3)."""
    return [*map(float, xyz), *quaternion(rotation)]


def quaternion(rotation: FloatArray) -> list[float]:
    """Unit quaternion x y z w of a rotation matrix, (3, 3), with w ≥ 0."""
    import pinocchio as pin

    found = np.array(pin.Quaternion(np.asarray(rotation, float)).normalized().coeffs())
    return [float(each) for each in (found if found[3] >= 0.0 else -found)]


def rotation_of(rpy: tuple[float, ...] | FloatArray) -> FloatArray:
    """Rz(yaw)·Ry(pitch)·Rx(roll), as a URDF writes a rotation."""
    import pinocchio as pin

    return np.array(pin.rpy.rpyToMatrix(np.asarray(rpy, float)))


def _primitive(part: ET.Element, colors: Mapping[str, list[float]]) -> Shape | None:
    geometry, origin = part.find("geometry"), part.find("origin")
    if geometry is None or not len(geometry):
        return None
    shape = geometry[0]
    read = _SIZES.get(shape.tag)
    if read is None:
        return None
    size = read(shape)
    given = {} if origin is None else origin.attrib
    xyz, rpy = (_numbers(given.get(key, "0 0 0")) for key in ("xyz", "rpy"))
    where = pose(np.array(xyz), rotation_of(tuple(rpy)))
    return {"shape": shape.tag, "size": size, "origin": where, "color": _color(part, colors)}


_SIZES: dict[str, Callable[[ET.Element], list[float]]] = {
    "box": lambda shape: _numbers(shape.get("size", "")),
    "sphere": lambda shape: _numbers(shape.get("radius", "")),
    "cylinder": lambda shape: _numbers(f"{shape.get('radius')} {shape.get('length')}"),
}


def _numbers(text: str) -> list[float]:
    return [float(word) for word in text.split()]


def _colors(robot: ET.Element) -> dict[str, list[float]]:
    """Colours of materials by name."""
    found = {}
    for material in robot.iter("material"):
        color = material.find("color")
        if color is not None and material.get("name"):
            found[material.get("name", "")] = _rgba(color)
    return found


def _color(part: ET.Element, colors: Mapping[str, list[float]]) -> list[float]:
    material = part.find("material")
    if material is None:
        return list(GREY)
    color = material.find("color")
    return _rgba(color) if color is not None else colors.get(material.get("name", ""), list(GREY))


def _rgba(color: ET.Element) -> list[float]:
    try:
        values = _numbers(color.get("rgba", ""))
    except ValueError:  # no reader of descriptions looks at colours
        return list(GREY)
    inside = len(values) == 4 and all(math.isfinite(v) and 0.0 <= v <= 1.0 for v in values)
    return values if inside else list(GREY)


def _add_meshes(looks: Looks, description: RobotDescription, robot: str) -> None:
    """Draw links with the meshes of the robot's folder that are what its file says."""
    try:
        file = find_file(robot)
        if file is None or not file.exists():
            return
        content, urdf = read_files(file)
    except UsageError as error:
        looks.notes.append(f"no meshes: {error}")
        return
    if urdf != description.urdf:
        looks.notes.append(f"no meshes: {file} is of another robot than the one that is shown")
        return
    drawn: dict[str, list[Shape]] = {}
    left, incomplete = MESH_LIMIT, set[str]()
    for entry in content.meshes:
        path = file.parent / MESHES / entry.file
        try:
            if digest(path) != entry.sha256:
                raise MeshError("is another file than robot.yaml names")
            if entry.sha256 not in looks.meshes:
                vertices, triangles = read_mesh(path, left)
                looks.meshes[entry.sha256] = packed(vertices, triangles)
                left -= len(triangles)
        except MeshError as error:
            incomplete.add(entry.link)
            looks.notes.append(f"{entry.link} is drawn with primitives: {entry.file} {error}")
            continue
        drawn.setdefault(entry.link, []).append(_mesh(entry))
    looks.visuals |= {link: shapes for link, shapes in drawn.items() if link not in incomplete}


def _mesh(entry: MeshEntry) -> Shape:
    return {
        "shape": "mesh",
        "size": list(entry.scale),
        "origin": pose(np.array(entry.xyz_m), rotation_of(entry.rpy_rad)),
        "color": list(GREY),
        "mesh": f"/mesh/{entry.sha256}",
    }


def read_mesh(path: Path, most: int = MESH_LIMIT) -> tuple[FloatArray, NDArray[np.int64]]:
    """Vertices (n, 3) in the mesh's own units and triangles (m, 3), as Coal reads them.

    Raises:
        MeshError: it cannot be read, or has more triangles than `most`.
    """
    import coal

    try:
        mesh = coal.MeshLoader(coal.BV_AABB).load(str(path))
    except (RuntimeError, ValueError) as error:
        raise MeshError("cannot be read by Coal") from error
    if mesh.num_tris > most:
        raise MeshError(f"has {mesh.num_tris} triangles, which are too many to be drawn")
    vertices = np.array(mesh.vertices(), float).reshape(-1, 3)
    triangles = np.array(list(_triangles(mesh)), np.int64).reshape(-1, 3)
    if not len(vertices) or not np.isfinite(vertices).all():
        raise MeshError("has no vertices, or some that are not finite")
    if triangles.size and not 0 <= triangles.min() <= triangles.max() < len(vertices):
        raise MeshError("has triangles of vertices that are not there")
    return vertices, triangles


def _triangles(mesh: Any) -> Iterator[tuple[int, int, int]]:
    for number in range(mesh.num_tris):
        corner = mesh.tri_indices(number)
        yield corner[0], corner[1], corner[2]
