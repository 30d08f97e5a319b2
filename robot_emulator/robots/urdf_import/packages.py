"""Finds the files that a URDF names: relative to its folder, as file:// or as package://.

A package is a folder. It is looked for, in this order, in the folders that the caller names, in
those of `HOAP3_PACKAGE_PATH`, `ROS_PACKAGE_PATH` and `AMENT_PREFIX_PATH`, and among the parents of
the URDF. A folder is the package if it is called so, or if its `package.xml` says so.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from urllib.parse import unquote
from xml.etree import ElementTree as ET

from hoap3.protocol.config.regular_file import read_at_most
from hoap3.protocol.errors import ConfigError, DescriptionError

VARIABLES = ("HOAP3_PACKAGE_PATH", "ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH")
INSIDE = ("", "{package}", "share/{package}", "src/{package}")
"""Where a package may lie in a folder of the search path."""
_FIND = re.compile(r"^\$\((?:find|find-pkg-share) +([^)\s]+)\)")
"""What stands for package:// in xacro and in ROS 2."""
REMEDY = f"Name the folder that holds the package with --package-path or {VARIABLES[0]}"


class UnresolvedError(DescriptionError):
    """A file that a URDF names cannot be found; the text says why, without its name."""


class SearchPath:
    """Where the files of one URDF are.

    Args:
        folder: of the URDF.
        package_path: folders that hold packages, or are some, before those of the environment.
        packages: folders of packages that are known by name.
    """

    def __init__(
        self,
        folder: Path,
        package_path: Sequence[Path] = (),
        packages: dict[str, Path] | None = None,
    ) -> None:
        self._folder = _without_dots(folder)
        self._roots = (*map(_without_dots, package_path), *_of_environment())
        self._packages: dict[str, Path] = dict(packages or {})

    @property
    def roots(self) -> tuple[Path, ...]:
        """Folders in which packages are looked for."""
        return self._roots

    def find(self, name: str) -> Path:
        """The file that a URDF calls so.

        Raises:
            UnresolvedError: there is none, or it leaves the package that it is said to be in.
        """
        name = _FIND.sub(r"package://\1", name)
        scheme, mark, rest = name.partition("://")
        if not mark:
            return self._existing(self._folder / name, name)
        if scheme == "file":
            return self._existing(Path(unquote(rest.removeprefix("localhost"))), name)
        if scheme not in {"package", "model"}:
            raise UnresolvedError(f"{scheme[:20]}:// is no place of files here")
        package, _, inside = rest.lstrip("/").partition("/")
        folder = self.package(package)
        path = Path(os.path.normpath(folder / unquote(inside)))
        if not path.is_relative_to(folder):
            raise UnresolvedError(f"leads out of the package {package!r:.60}")
        return self._existing(path, name)

    def package(self, package: str) -> Path:
        """The folder of a package.

        Raises:
            UnresolvedError: there is none of that name.
        """
        if package not in self._packages:
            self._packages[package] = self._look_for(package)
        return self._packages[package]

    def _look_for(self, package: str) -> Path:
        if not package or package in {".", ".."} or "\0" in package:
            raise UnresolvedError(f"{package!r:.60} is no name of a package")
        for root in self._roots:
            for place in INSIDE:
                folder = Path(os.path.normpath(root / place.format(package=package)))
                if _is_package(folder, package):
                    return folder
        here = self._folder.resolve()
        for parent in (self._folder, *self._folder.parents, here, *here.parents):
            for folder in (parent, parent / package):
                if _is_package(folder, package):
                    return folder
        raise UnresolvedError(f"the package {package!r:.60} is nowhere. {REMEDY}")

    def _existing(self, path: Path, name: str) -> Path:
        plain = Path(os.path.normpath(path))
        if "\0" not in name and (plain.exists() or not path.exists()):
            path = plain  # else `..` stands behind a link to a folder
        if "\0" in name or not path.exists():
            raise UnresolvedError("no such file")
        if path.is_dir():
            raise UnresolvedError("a folder")
        return path


def check_folders(package_path: Sequence[Path]) -> None:
    """Refuse a folder that a user named and that is none; the environment may name such.

    Raises:
        ConfigError: there is no such folder.
    """
    for path in package_path:
        if not Path(path).is_dir():
            remedy = "Name a folder that holds packages, or is one"
            raise ConfigError("--package-path", "", str(path), "no such folder", remedy)


def _of_environment() -> Iterable[Path]:
    for variable in VARIABLES:
        for folder in os.environ.get(variable, "").split(os.pathsep):
            if folder:
                yield _without_dots(Path(folder))


def _without_dots(folder: Path) -> Path:
    """A folder as an absolute path without `..`, and with its links unless they stand before it."""
    folder = Path(folder).absolute()
    return folder.resolve() if ".." in folder.parts else folder


def _is_package(folder: Path, package: str) -> bool:
    """Whether a folder is the package: by its own name, or by what its package.xml says."""
    if not folder.is_dir():
        return False
    return folder.name == package or _stated_name(folder) == package


def _stated_name(folder: Path) -> str | None:
    """What the package.xml of a folder says that the package is called, if it says it."""
    try:
        text = read_at_most(folder / "package.xml", 1 << 16)
        if b"<!DOCTYPE" in text or len(text) > 1 << 16:
            return None
        return (ET.fromstring(text).findtext("name") or "").strip() or None  # noqa: S314
    except (OSError, ET.ParseError, ValueError, LookupError):
        return None  # a folder without one, or with one that says nothing to us
