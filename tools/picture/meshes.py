"""Meshes of a robot's folder, which are drawn instead of the shapes that travel.

Only those whose content has the digest that `robot.yaml` names, and only of the very robot that is
to be drawn: its URDF must be the same to the letter.
"""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.errors import UsageError
from hoap3.protocol.messages import FloatArray
from hoap3.protocol.robot.description import RobotDescription
from hoap3.remote_controller.constraints.collision.collision_geometry import rotation
from hoap3.robot_emulator.robots import find_file
from hoap3.robot_emulator.robots.urdf_import.folder import MESHES
from hoap3.robot_emulator.robots.urdf_import.mesh_files import MeshError, digest
from hoap3.robot_emulator.robots.yaml_file import MeshEntry, read_files
from hoap3.tools.picture.solids import Solid, solids_of

MOST = 400_000  # triangles of all meshes of a robot
FINEST = 256  # cells along the longest side of a mesh that is made coarser


@dataclass
class KeptMeshes:
    """Meshes that links are drawn with.

    Attributes:
        entries: what `robot.yaml` says of them, by link; links of which one is missing are not in.
        vertices, triangles: (n, 3) in the mesh's own units and (m, 3), by digest.
        notes: what is drawn otherwise than `robot.yaml` says, and why.
    """

    entries: dict[str, list[MeshEntry]] = field(default_factory=dict)
    vertices: dict[str, FloatArray] = field(default_factory=dict)
    triangles: dict[str, NDArray[np.int64]] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)


def kept_meshes(description: RobotDescription, robot: str | Path) -> KeptMeshes:
    """The meshes of a robot's folder.

    Args:
        description: of the robot that is to be drawn.
        robot: its name or path on this machine.
    """
    kept = KeptMeshes()
    try:
        file = find_file(robot)
        if file is None or not file.exists():
            return kept
        content, urdf = read_files(file)
    except UsageError as error:
        kept.notes.append(f"no meshes: {error}")
        return kept
    if urdf != description.urdf:
        kept.notes.append(f"no meshes: {file} is of another robot than the one that is shown")
        return kept
    left, incomplete = MOST, set[str]()
    for entry in content.meshes:
        path = file.parent / MESHES / entry.file
        try:
            if digest(path) != entry.sha256:
                raise MeshError("is another file than robot.yaml names")
            if entry.sha256 not in kept.vertices:
                vertices, triangles = read_mesh(path, left)
                kept.vertices[entry.sha256], kept.triangles[entry.sha256] = vertices, triangles
                left -= len(triangles)
        except MeshError as error:
            incomplete.add(entry.link)
            kept.notes.append(f"{entry.link} is drawn with primitives: {entry.file} {error}")
            continue
        kept.entries.setdefault(entry.link, []).append(entry)
    for link in incomplete & kept.entries.keys():
        del kept.entries[link]
    return kept


def dressed(
    description: RobotDescription, robot: str | Path | None, most: int
) -> tuple[list[Solid], list[str]]:
    """What links look like, and notes: with meshes where there are any, else with shapes.

    Args:
        description: of the robot.
        robot: its name or path on this machine, None for shapes alone.
        most: triangles of all meshes together; what has more is made coarser.
    """
    shapes = solids_of(description)
    if robot is None:
        return shapes, []
    kept = kept_meshes(description, robot)
    meshes = mesh_solids(kept, most)
    covered = {solid.link for solid in meshes}
    return [*(solid for solid in shapes if solid.link not in covered), *meshes], kept.notes


def mesh_solids(kept: KeptMeshes, most: int) -> list[Solid]:
    """Meshes as shapes of links, made coarser until all of them have so many triangles at most."""
    entries = [entry for group in kept.entries.values() for entry in group]
    counts = [len(kept.triangles[entry.sha256]) for entry in entries]
    share = min(1.0, most / max(1, sum(counts)))
    found = []
    for entry, count in zip(entries, counts, strict=True):
        vertices = kept.vertices[entry.sha256] * np.array(entry.scale)
        triangles = kept.triangles[entry.sha256]
        if share < 1.0:
            vertices, triangles = coarser(vertices, triangles, int(share * count))
        if not len(triangles):
            continue
        a, b, c = vertices[triangles].transpose(1, 0, 2)
        if float((a * np.cross(b, c)).sum()) < 0.0:  # mirrored, or its corners turn right
            triangles = triangles[:, ::-1]
        axes, center = rotation(*entry.rpy_rad), np.array(entry.xyz_m)
        found.append(Solid(entry.link, "mesh", (), center, axes, None, vertices, triangles))
    return found


def coarser(
    vertices: FloatArray, triangles: NDArray[np.int64], most: int
) -> tuple[FloatArray, NDArray[np.int64]]:
    """A mesh whose vertices are moved together, cell by cell, until few triangles are left.

    J. Rossignac and P. Borrel, Multi-resolution 3D approximations for rendering complex scenes,
    Modeling in Computer Graphics, 1993.

    Args:
        vertices: (n, 3).
        triangles: (m, 3), corners as places in `vertices`.
        most: triangles at the most.
    """
    cells = range(1, FINEST + 1)
    fitting = bisect_right(cells, most, key=lambda n: len(_clustered(vertices, triangles, n)[1]))
    return _clustered(vertices, triangles, max(1, fitting))


def _clustered(
    vertices: FloatArray, triangles: NDArray[np.int64], cells: int
) -> tuple[FloatArray, NDArray[np.int64]]:
    """With one vertex, the mean, in each cell of a grid with so many along its longest side."""
    start, size = vertices.min(axis=0), np.ptp(vertices, axis=0).max()
    cell = np.floor((vertices - start) / max(float(size), 1e-12) * cells).clip(0, cells - 1)
    _, first, which = np.unique(cell, axis=0, return_index=True, return_inverse=True)
    which = which.ravel()
    sums = np.zeros((len(first), 3))
    np.add.at(sums, which, vertices)
    means = sums / np.bincount(which)[:, None]
    corners = which[triangles]
    a, b, c = corners.T
    corners = corners[(a != b) & (b != c) & (c != a)]
    turns = np.argmin(corners, axis=1)  # the smallest first, so that twins can be told
    order = (turns[:, None] + np.arange(3)) % 3
    return means, np.unique(np.take_along_axis(corners, order, axis=1), axis=0)


def read_mesh(path: Path, most: int = MOST) -> tuple[FloatArray, NDArray[np.int64]]:
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
    corners = [mesh.tri_indices(number) for number in range(mesh.num_tris)]
    triangles = np.array([(c[0], c[1], c[2]) for c in corners], np.int64).reshape(-1, 3)
    if not len(vertices) or not np.isfinite(vertices).all():
        raise MeshError("has no vertices, or some that are not finite")
    if triangles.size and not 0 <= triangles.min() <= triangles.max() < len(vertices):
        raise MeshError("has triangles of vertices that are not there")
    return vertices, triangles
