"""Where a vendor's robot comes from: a URDF, a xacro file, or `robot_descriptions` by name."""

from __future__ import annotations

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
from hoap3.protocol.errors import (
    ConfigError,
    DescriptionError,
    NotInstalledError,
    one_of,
)
from hoap3.protocol.robot.urdf import not_well_formed, wrong_root
from hoap3.robot_emulator.robots.urdf_import.packages import (
    SearchPath,
    UnresolvedError,
    check_folders,
)

SUFFIXES = {".urdf", ".xacro"}
DESCRIPTIONS = "robot_descriptions"
_ARGUMENT = re.compile(r"\s+(?=[A-Za-z_]\w*:=)")
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
    name = split_arguments(name)[0]
    return Path(name).suffix.lower() in SUFFIXES or name.startswith(f"{DESCRIPTIONS}:")


def split_arguments(name: str | Path) -> tuple[str, dict[str, str]]:
    """The path or name of a robot, and the xacro arguments behind it: `FILE NAME:=VALUE ..`."""
    path, *arguments = _ARGUMENT.split(str(name))
    return path, dict(each.split(":=", 1) for each in arguments)


def absolute(name: str, folder: Path) -> str:
    """A robot's path, counted from a folder, as an absolute one; xacro arguments stay behind it."""
    if name.startswith(f"{DESCRIPTIONS}:"):
        return name
    path, arguments = split_arguments(name)
    rest = (f" {key}:={value}" for key, value in arguments.items())
    return "".join((str((folder / path).resolve()), *rest))


def read_source(name: str | Path, package_path: Sequence[Path] = ()) -> Source:
    """Read the URDF that a path or a `robot_descriptions:NAME` leads to.

    Args:
        name: what the user gave; xacro arguments may stand behind it, as `NAME:=VALUE`.
        package_path: folders in which packages are looked for first.

    Raises:
        ConfigError: the file cannot be read, or a folder of `package_path` is none.
        DescriptionError: it is no URDF.
        NotInstalledError: it needs a library that is not installed.
    """
    check_folders(package_path)
    given = split_arguments(name)[0]
    if given.startswith(f"{DESCRIPTIONS}:"):
        return _of_descriptions(str(name), package_path)
    return _of_file(Path(given), str(name), SearchPath(Path(given).parent, package_path))


def _of_file(
    path: Path, label: str, search: SearchPath, arguments: Mapping[str, str] | None = None
) -> Source:
    """Read a file, with the arguments in its label and others, which a xacro file need not have."""
    given = split_arguments(label)[1]
    data = read_named(path, MAX_BYTES, label, "a URDF")
    digest = hashlib.sha256(data).hexdigest()
    robot = parse_robot(data)
    if path.suffix.lower() == ".xacro" or is_xacro(robot):
        asked = _Arguments({**(arguments or {}), **given})
        robot = parse_robot(_expand(path, search, asked))
        for key in sorted(given.keys() - asked.known.keys()):
            hint = one_of(key, asked.known, "Its arguments")
            raise DescriptionError(f"{key[:60]}:= is no argument of this xacro file. {hint:.400}.")
    elif given:
        problem = "is not a xacro file, which alone takes arguments"
        raise ConfigError(label, "", None, problem, "Leave them out")
    return Source(label, path, digest, robot, search)


class _Arguments(dict[str, str]):
    """Arguments of a xacro file; keeps the names that it asks for."""

    def __init__(self, given: Mapping[str, str]) -> None:
        super().__init__(given)
        self.known: dict[str, None] = {}

    def __contains__(self, key: object) -> bool:
        self.known[str(key)] = None
        return super().__contains__(key)

    def __getitem__(self, key: str) -> str:
        self.known[key] = None
        return super().__getitem__(key)


def _expand(path: Path, search: SearchPath, subargs: _Arguments) -> bytes:
    """What xacro makes of a file; nothing of another file that this process expanded is left."""
    if importlib.util.find_spec("xacrodoc") is None:
        raise NotInstalledError("package", "xacrodoc", f"{XACRO}, or expand it yourself")
    xacrodoc: Any = importlib.import_module("xacrodoc")
    xacro: Any = importlib.import_module("xacro")
    substitution: Any = importlib.import_module("xacro.substitution_args")
    path = path.absolute()

    def find(package: str) -> str:
        """The folder of a package, as for package://, or as xacrodoc finds it."""
        try:
            return str(search.package(package))
        except UnresolvedError:
            return str(xacrodoc.packages.get_path(package))

    xacrodoc.packages.reset()
    xacrodoc.packages.look_in([str(root) for root in search.roots if root.is_dir()])
    substitution._eval_find = substitution._eval_dict["find"] = find  # as xacrodoc does
    xacro.init_stacks(str(path))
    try:
        document = xacrodoc.XacroDoc.from_file(path, subargs=subargs, resolve_packages=False)
        text: str = document.to_urdf_string()
    except (Exception, SystemExit) as error:  # whatever its macros raise
        reason = str(error).strip().partition("\n")[0][:200]
        remedy = "Correct it, or name the packages that it needs with --package-path"
        missing = [key for key in subargs.known if key not in subargs and "argument" in reason]
        if missing:
            remedy = f"Give its arguments behind the file, as {missing[-1]}:=VALUE"
        raise DescriptionError(
            f"xacro cannot expand it ({type(error).__name__}: {reason}). {remedy}."
        ) from error
    return text.encode("utf-8")


def _of_descriptions(name: str, package_path: Sequence[Path]) -> Source:
    """A robot of the package `robot_descriptions`, which fetches it when it is first imported."""
    found = _DESCRIPTION.fullmatch(split_arguments(name)[0])
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


MAX_BYTES = 32 << 20  # a vendor's file may be long; what is made of it has at most 1 MiB
MAX_DEPTH = 64


class _Builder(ET.TreeBuilder):
    """Builds the tree; refuses a DTD when it begins, and nests without end.

    A default namespace of <robot> becomes its attribute `xmlns`, and is no part of the tags.
    """

    def __init__(self) -> None:
        super().__init__()
        self._depth, self._namespace = 0, ""

    def doctype(self, name: str, pubid: str | None, system: str | None) -> None:  # noqa: ARG002
        """The parser calls this before it reads what a DTD declares."""
        raise DescriptionError("URDF: <!DOCTYPE found. Remove it: a URDF needs none.")

    def start(self, tag: str, attrs: dict[str, str], /) -> ET.Element:
        """An element begins."""
        self._depth += 1
        if self._depth > MAX_DEPTH:
            raise DescriptionError(f"URDF: elements nested deeper than {MAX_DEPTH}. Flatten it.")
        if self._depth == 1 and tag.endswith("}robot"):
            self._namespace = tag.removesuffix("robot")
            attrs["xmlns"] = self._namespace[1:-1]
        return super().start(tag.removeprefix(self._namespace), attrs)

    def end(self, tag: str, /) -> ET.Element:
        """An element ends."""
        self._depth -= 1
        return super().end(tag.removeprefix(self._namespace))


def parse_robot(data: bytes) -> ET.Element:
    """The <robot> of a URDF.

    Raises:
        DescriptionError: too large, not well-formed, a DTD, or another format.
    """
    if len(data) > MAX_BYTES:
        raise DescriptionError(f"URDF: more than {MAX_BYTES >> 20} MiB. Is this a URDF?")
    parser = ET.XMLParser(target=_Builder())  # noqa: S314 - no DTD gets in
    try:
        parser.feed(data)
        root: ET.Element = parser.close()
    except (ET.ParseError, UnicodeError, ValueError, LookupError) as error:
        raise DescriptionError(f"URDF: {_why(data, error)}") from error
    if root.tag != "robot":
        raise DescriptionError(f"URDF: {wrong_root(root.tag)}")
    return root


def is_xacro(root: ET.Element) -> bool:
    """Whether there is something for xacro to do."""
    return any("xacro" in str(each.tag).rpartition("}")[0] for each in root.iter())


def _why(data: bytes, error: Exception) -> str:
    """What is wrong with text that is no XML, and what to do."""
    if not data.strip():
        return "the file is empty. Name another one."
    if "encoding" in str(error) or isinstance(error, UnicodeError | LookupError):
        return f"not in the encoding that it states ({error}). Save it as UTF-8."
    try:
        data.decode("utf-8")
    except UnicodeDecodeError as wrong:
        return f"byte {wrong.start} is not UTF-8. Save it as UTF-8, or state its encoding."
    return not_well_formed(error)
