"""Files beside a mesh without which it is drawn otherwise: materials, buffers, textures.

A mesh names them as seen from itself, and its content is kept as it is, so each keeps its name
there. One that would lie outside of the mesh's own folder can therefore not be kept.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import unquote, urlsplit

from hoap3.robot_emulator.robots.urdf_import.mesh_files import MeshError, read_whole

MATERIALS, BUFFERS = {".mtl"}, {".bin"}
IMAGES = {".png", ".jpg", ".jpeg", ".tga", ".bmp", ".tif", ".tiff", ".gif", ".dds", ".webp"}
HIGH_RANGE = {".ktx", ".ktx2", ".hdr", ".exr"}
SUFFIXES = MATERIALS | BUFFERS | IMAGES | HIGH_RANGE
PATH = r"[A-Za-z0-9_][A-Za-z0-9_. -]*(/[A-Za-z0-9_][A-Za-z0-9_. -]*)*"
"""What names look like that are kept: below the mesh's folder, and nothing hidden."""

_LIBRARY = re.compile(rb"^[ \t]*mtllib[ \t]+(.+?)[ \t\r]*$", re.MULTILINE)
_MAP = re.compile(
    rb"^[ \t]*(?:map_\w+|bump|norm|disp|decal|refl)[ \t]+(.+?)[ \t\r]*$",
    re.MULTILINE | re.IGNORECASE,
)
_OPTION = re.compile(rb"-\w+(?:[ \t]+(?:-?[\d.]+|on|off|[rgbmlz]|sphere|cube_\w+))*[ \t]+")
_IMAGE = re.compile(rb"<init_from>\s*(?:<ref>)?\s*([^<\s][^<]*?)\s*<")
_PLY = re.compile(rb"^comment[ \t]+TextureFile[ \t]+(.+?)[ \t\r]*$", re.MULTILINE)
_GLB, _JSON = b"glTF", b"JSON"


@dataclass(frozen=True)
class Companion:
    """A file that a mesh names.

    Attributes:
        name: as seen from the mesh.
        path: of the file, here.
        sha256: of its content.
    """

    name: str
    path: Path
    sha256: str


def companions(mesh: Path, data: bytes) -> Iterator[Companion | tuple[str, str]]:
    """The files that a mesh names, and those that these name; or a name, and why it is none.

    Args:
        mesh: where it lies.
        data: its content.
    """
    seen, ahead = set(), list(_named(mesh.suffix.lower(), data))
    while ahead:
        name = ahead.pop(0)
        if name in seen:
            continue
        seen.add(name)
        path = mesh.parent / name
        if not re.fullmatch(PATH, name) or Path(name).suffix.lower() not in SUFFIXES:
            yield name, "not a file below their meshes, of a known kind"
            continue
        try:
            found = read_whole(path)
        except MeshError as error:
            yield name, str(error)
            continue
        yield Companion(name, path, hashlib.sha256(found).hexdigest())
        folder = name.rpartition("/")[0]
        inner = _named(Path(name).suffix.lower(), found)
        ahead += [f"{folder}/{each}" if folder else each for each in inner]


def _named(suffix: str, data: bytes) -> Iterator[str]:
    """What a file of this kind names, as it says it; data inside of it are none."""
    if suffix == ".obj":
        found = _LIBRARY.findall(data)
    elif suffix == ".mtl":
        found = [_OPTION.sub(b"", each) for each in _MAP.findall(data)]
    elif suffix == ".ply":
        found = _PLY.findall(data.partition(b"end_header")[0])
    elif suffix == ".dae":
        found = _IMAGE.findall(data)
    elif suffix in {".gltf", ".glb"}:
        found = list(_uris(_document(suffix, data)))
    else:
        found = []
    for each in found:
        name = each.decode("utf-8", "replace").replace("\\", "/")
        if suffix in {".dae", ".gltf", ".glb"}:
            if urlsplit(name).scheme == "data":
                continue
            name = unquote(name)
        if suffix != ".dae" or "." in name:  # COLLADA calls surfaces likewise, by an id
            yield re.sub(r"^(\./)+", "", name)


def _document(suffix: str, data: bytes) -> object:
    """The JSON of a glTF file; None where it has none."""
    if suffix == ".glb":
        if data[:4] != _GLB or data[16:20] != _JSON:
            return None
        data = data[20 : 20 + int.from_bytes(data[12:16], "little")]
    try:
        document: object = json.loads(data)
    except (ValueError, RecursionError):
        return None
    return document


def _uris(document: object) -> Iterator[bytes]:
    if not isinstance(document, dict):
        return
    for kind in ("buffers", "images"):
        entries = document.get(kind)
        for each in entries if isinstance(entries, list) else ():
            if isinstance(each, dict) and isinstance(each.get("uri"), str):
                yield each["uri"].encode("utf-8", "replace")
