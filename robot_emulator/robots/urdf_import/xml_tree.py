"""Parses the XML of a vendor's URDF: no entity is expanded, no depth is unbounded."""

from __future__ import annotations

from xml.etree import ElementTree as ET

from hoap3.protocol.errors import DescriptionError
from hoap3.protocol.urdf import not_well_formed, wrong_root

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
