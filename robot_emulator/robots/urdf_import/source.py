"""Where a vendor's robot comes from: a URDF, a xacro file, or `robot_descriptions` by name."""

from __future__ import annotations

import contextlib
import hashlib
import importlib
import importlib.util
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

from hoap3.protocol.config.regular_file import read_named
from hoap3.protocol.errors import ConfigError, DescriptionError, NotInstalledError
from hoap3.robot_emulator.robots.urdf_import.shapes.packages import SearchPath, check_folders
from hoap3.robot_emulator.robots.urdf_import.xml_tree import MAX_BYTES, is_xacro, parse_robot

SUFFIXES = {".urdf", ".xacro"}
DESCRIPTIONS = "robot_descriptions"
_DESCRIPTION = re.compile(rf"{DESCRIPTIONS}:([a-z][a-z0-9_]*)")
XACRO = "'hoap3[xacro]'"
ROBOTS = "'hoap3[descriptions]'"


@dataclass(frozen=True)
class Source:
    """A URDF that was read, and where its files are.

    Attributes:
        label: what the user calls it.
        path: of the file.
        sha256: of the file as it lies there.
        robot: its <robot>.
        search: where the files that it names are.
    """

    label: str
    path: Path
    sha256: str
    robot: ET.Element
    search: SearchPath


def is_source(name: str | Path) -> bool:
    """Whether a path or a name says that it is a vendor's robot, by its form alone."""
    return Path(name).suffix.lower() in SUFFIXES or str(name).startswith(f"{DESCRIPTIONS}:")


def read_source(name: str | Path, package_path: Sequence[Path] = ()) -> Source:
    """Read the URDF that a path or a `robot_descriptions:NAME` leads to.

    Args:
        name: what the user gave.
        package_path: folders in which packages are looked for first.

    Raises:
        ConfigError: the file cannot be read, or a folder of `package_path` is none.
        DescriptionError: it is no URDF.
        NotInstalledError: it needs a library that is not installed.
    """
    check_folders(package_path)
    if str(name).startswith(f"{DESCRIPTIONS}:"):
        return _of_descriptions(str(name), package_path)
    return _of_file(Path(name), str(name), SearchPath(Path(name).parent, package_path))


def _of_file(
    path: Path, label: str, search: SearchPath, arguments: Mapping[str, str] | None = None
) -> Source:
    data = read_named(path, MAX_BYTES, label, "a URDF")
    digest = hashlib.sha256(data).hexdigest()
    if path.suffix.lower() == ".xacro":
        return Source(label, path, digest, parse_robot(_expand(path, search, arguments)), search)
    robot = parse_robot(data)
    if is_xacro(robot):
        robot = parse_robot(_expand(path, search, arguments))
    return Source(label, path, digest, robot, search)


def _expand(path: Path, search: SearchPath, arguments: Mapping[str, str] | None) -> bytes:
    """What xacro makes of a file."""
    if importlib.util.find_spec("xacrodoc") is None:
        raise NotInstalledError("package", "xacrodoc", f"{XACRO}, or expand it yourself")
    xacrodoc: Any = importlib.import_module("xacrodoc")
    path = path.absolute()
    try:
        with contextlib.chdir(path.parent):  # includes are relative to it
            xacrodoc.packages.look_in([str(root) for root in search.roots if root.is_dir()])
            document = xacrodoc.XacroDoc.from_file(
                path, subargs=dict(arguments or {}), resolve_packages=False
            )
            text: str = document.to_urdf_string()
    except Exception as error:  # whatever its macros raise
        reason = str(error).strip().partition("\n")[0][:200]
        raise DescriptionError(
            f"xacro cannot expand it ({type(error).__name__}: {reason}). Correct it, or name the "
            "packages that it needs with --package-path."
        ) from error
    return text.encode("utf-8")


def _of_descriptions(name: str, package_path: Sequence[Path]) -> Source:
    """A robot of the package `robot_descriptions`, which fetches it when it is first imported."""
    found = _DESCRIPTION.fullmatch(name)
    if found is None:
        remedy = f"Write {DESCRIPTIONS}:NAME, such as {DESCRIPTIONS}:panda_description"
        raise ConfigError(name, "", None, "is not the name of a description", remedy)
    if importlib.util.find_spec(DESCRIPTIONS) is None:
        raise NotInstalledError("package", DESCRIPTIONS, ROBOTS)
    try:
        module = importlib.import_module(f"{DESCRIPTIONS}.{found[1]}")
    except Exception as error:  # it fetches, and fails in every way
        reason = str(error).strip().partition("\n")[0][:200]
        problem = f"cannot be imported ({type(error).__name__}: {reason})"
        remedy = f"`python -m {DESCRIPTIONS} list` has the names; the first use needs the network"
        raise ConfigError(name, "", None, problem, remedy) from error
    given = getattr(module, "URDF_PATH", None) or getattr(module, "XACRO_PATH", None)
    if given is None:
        raise ConfigError(name, "", None, "has no URDF, only another format", "Name another one")
    path = Path(given)
    roots = [Path(getattr(module, key)) for key in _PLACES if hasattr(module, key)]
    around = [folder for root in roots for folder in (root, root.parent)]
    packages = getattr(module, "XACRO_PACKAGE_PATHS", {})
    known = {str(key): Path(folder) for key, folder in packages.items()}
    search = SearchPath(path.parent, [*package_path, *around], known)
    return _of_file(path, name, search, getattr(module, "XACRO_ARGS", None))


_PLACES = ("PACKAGE_PATH", "REPOSITORY_PATH")
