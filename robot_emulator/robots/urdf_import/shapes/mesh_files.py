"""Reads the meshes that a URDF names, through Coal, which reads them as Pinocchio does."""

from __future__ import annotations

import hashlib
from functools import lru_cache
from pathlib import Path

import numpy as np

from hoap3.protocol.config.regular_file import open_regular, read_at_most
from hoap3.protocol.errors import DescriptionError
from hoap3.protocol.messages import FloatArray
from hoap3.robot_emulator.robots.urdf_import.shapes.fitting import Shape, tightest

MAX_BYTES = 256 << 20
MAX_VERTICES = 5_000_000
FAR_M = 1e4
FORMATS = {".stl", ".dae", ".obj", ".ply", ".off", ".3ds", ".glb", ".gltf", ".fbx"}


class MeshError(DescriptionError):
    """A mesh that cannot be used; the text says why, without its name."""


def check_mesh(path: Path) -> None:
    """Refuse what is no mesh by its name, or is none that can be read in reasonable time.

    Raises:
        MeshError: another format, not a regular file, or too large.
    """
    if path.suffix.lower() not in FORMATS:
        known = ", ".join(sorted(FORMATS))
        raise MeshError(f"not a format of meshes that is read here ({known})")
    try:
        with open_regular(path) as stream:
            size = stream.seek(0, 2)
    except OSError as error:
        raise MeshError(error.strerror or "cannot be read") from error
    if size > MAX_BYTES:
        raise MeshError(f"has {size >> 20} MiB, and at most {MAX_BYTES >> 20} are read")


def digest(path: Path) -> str:
    """SHA-256 of a mesh, hexadecimal.

    Raises:
        MeshError: as of `check_mesh`.
    """
    return hashlib.sha256(content(path)).hexdigest()


def content(path: Path) -> bytes:
    """All of a mesh.

    Raises:
        MeshError: as of `check_mesh`.
    """
    check_mesh(path)
    try:
        return read_at_most(path, MAX_BYTES)
    except OSError as error:
        raise MeshError(error.strerror or "cannot be read") from error


def shape_of(path: Path, scale: FloatArray) -> Shape:
    """The tightest box, capsule or sphere around a mesh, in its own axes.

    Args:
        path: of the mesh.
        scale: (3,) of its coordinates; mirrors where negative.

    Raises:
        MeshError: it cannot be read, or has no finite vertices.
    """
    check_mesh(path)
    stat = path.stat()
    x, y, z = scale.tolist()
    return _fitted(str(path), stat.st_mtime_ns, stat.st_size, (x, y, z))


@lru_cache(maxsize=512)  # a robot has many wheels, and is read several times at a start
def _fitted(path: str, changed: int, size: int, scale: tuple[float, float, float]) -> Shape:
    del changed, size  # the same file, if they are the same
    points = _vertices(path) * np.array(scale)
    if not np.isfinite(points).all():
        raise MeshError("has coordinates that are not finite")
    if np.abs(points).max() > FAR_M:
        raise MeshError(f"reaches farther than {FAR_M:g} m: is its scale missing?")
    return tightest(points)


def _vertices(path: str) -> FloatArray:
    """(m, 3), m > 0, in the mesh's own units."""
    import coal

    try:
        mesh = coal.MeshLoader(coal.BV_AABB).load(path)
    except (RuntimeError, ValueError) as error:
        raise MeshError(f"Coal cannot read it ({_reason(error)})") from error
    if mesh.num_vertices > MAX_VERTICES:
        raise MeshError(f"has {mesh.num_vertices} vertices, and at most {MAX_VERTICES} are read")
    points = np.array(mesh.vertices(), dtype=np.float64).reshape(-1, 3)
    if not len(points):
        raise MeshError("has no vertices")
    return points


def _reason(error: Exception) -> str:
    """What the mesh reader said, without where in its source it said it."""
    lines = str(error).partition("message:")[2].splitlines() or str(error).splitlines()
    said = [line.strip() for line in lines[1:] if line.strip() and not line.startswith("Hint")]
    return (said or ["no reason given"])[0][:160]
