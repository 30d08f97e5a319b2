"""Reads the meshes that a URDF names, through Coal, which reads them as Pinocchio does."""

from __future__ import annotations

import hashlib
import re
from functools import lru_cache
from pathlib import Path

import numpy as np

from hoap3.protocol.config.regular_file import open_regular, read_at_most
from hoap3.protocol.errors import DescriptionError
from hoap3.protocol.messages import FloatArray
from hoap3.protocol.robot.urdf import is_finite
from hoap3.robot_emulator.robots.urdf_import.fitting import Shape, tightest

MAX_BYTES = 256 << 20
MAX_VERTICES = 5_000_000
FAR_M = 1e4
MARKS = {".stl": b"facet", ".dae": b"collada", ".obj": b"v ", ".off": b"off", ".glb": b"gltf"}
"""What the content of a format has; a binary STL has its length instead."""
FORMATS = {".stl", ".dae", ".obj", ".ply", ".off", ".3ds", ".glb", ".gltf", ".fbx"}


class MeshError(DescriptionError):
    """A mesh that cannot be used; the text says why, without its name."""


def read_whole(path: Path) -> bytes:
    """All of a mesh, or of a file that a mesh names.

    Raises:
        MeshError: not a regular file, too large, or it cannot be read.
    """
    try:
        with open_regular(path) as stream:
            size = stream.seek(0, 2)
        if size > MAX_BYTES:
            raise MeshError(f"has {size >> 20} MiB, and at most {MAX_BYTES >> 20} are read")
        return read_at_most(path, MAX_BYTES)
    except OSError as error:
        raise MeshError(error.strerror or "cannot be read") from error


def digest(path: Path) -> str:
    """SHA-256 of such a file, hexadecimal.

    Raises:
        MeshError: as of `read_whole`.
    """
    return hashlib.sha256(read_whole(path)).hexdigest()


def content(path: Path) -> bytes:
    """All of a mesh.

    Raises:
        MeshError: another format by its name or its content, or as of `read_whole`.
    """
    suffix = path.suffix.lower()
    if suffix not in FORMATS:
        known = ", ".join(sorted(FORMATS))
        raise MeshError(f"not a format of meshes that is read here ({known})")
    data = read_whole(path)
    binary = suffix == ".stl" and len(data) >= 84 + 50 * int.from_bytes(data[80:84], "little") > 84
    if not data.strip() or not (binary or MARKS.get(suffix, b"") in data[:65536].lower()):
        raise MeshError(f"has no content of a {suffix} file" if data.strip() else "is empty")
    return data


def collada_asset(path: Path, data: bytes) -> tuple[float, str]:
    """The unit of a COLLADA file [m], and its upward axis; 1 and Z_UP of other meshes.

    Raises:
        MeshError: the unit is not a positive number.
    """
    head = data[: data.find(b"<library")] if path.suffix.lower() == ".dae" else b""
    head = re.sub(rb"<!--.*?-->", b"", head, flags=re.DOTALL)
    units = re.findall(rb"<unit\b[^>]*\bmeter\s*=\s*[\"']\s*([^\"']*?)\s*[\"']", head)
    ups = re.findall(rb"<up_axis>\s*([XYZ]_UP)", head)
    text = units[0].decode(errors="replace") if units else "1"
    if not is_finite(text) or not float(text) > 0.0:
        raise MeshError(f"its <unit meter> is {text[:20]!r}, not a positive number")
    return float(text), ups[0].decode() if ups else "Z_UP"


def shape_of(path: Path, scale: FloatArray) -> Shape:
    """The tightest box, capsule or sphere around a mesh, in its own axes.

    Args:
        path: of the mesh.
        scale: (3,) of its coordinates; mirrors where negative.

    Raises:
        MeshError: it cannot be read, or has no finite vertices.
    """
    x, y, z = (collada_asset(path, content(path))[0] * scale).tolist()
    stat = path.stat()
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
