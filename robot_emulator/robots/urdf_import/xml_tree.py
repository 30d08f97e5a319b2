"""Parses the XML of a vendor's URDF: no entity is expanded, no depth is unbounded."""

from __future__ import annotations

from xml.etree import ElementTree as ET

from hoap3.protocol.errors import DescriptionError

MAX_BYTES = 32 << 20  # a vendor's file may be long; what is made of it has at most 1 MiB
MAX_DEPTH = 64
OTHER_FORMATS = {
    "sdf": "is SDF, not URDF. Convert it, or take the URDF that the vendor has beside it.",
    "mujoco": "is MJCF, not URDF. Take the URDF that the vendor has beside it.",
    "COLLADA": "is a mesh, not a URDF. Name the URDF that names this mesh.",
}


class _Builder(ET.TreeBuilder):
    """Builds the tree; refuses a DTD when it begins, and nests without end."""

    def __init__(self) -> None:
        super().__init__()
        self._depth = 0

    def doctype(self, name: str, pubid: str | None, system: str | None) -> None:  # noqa: ARG002
        """The parser calls this before it reads what a DTD declares."""
        raise DescriptionError("URDF: <!DOCTYPE found. Remove it: a URDF needs none.")

    def start(self, tag: str, attrs: dict[str, str], /) -> ET.Element:
        """An element begins."""
        self._depth += 1
        if self._depth > MAX_DEPTH:
            raise DescriptionError(f"URDF: elements nested deeper than {MAX_DEPTH}. Flatten it.")
        return super().start(tag, attrs)

    def end(self, tag: str, /) -> ET.Element:
        """An element ends."""
        self._depth -= 1
        return super().end(tag)


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
        instead = OTHER_FORMATS.get(root.tag)
        if instead is not None:
            raise DescriptionError(f"URDF: {instead}")
        raise DescriptionError(
            f"URDF: the outermost element is <{root.tag[:40]}>. Write <robot name=..>."
        )
    return root


def is_xacro(root: ET.Element) -> bool:
    """Whether there is something for xacro to do."""
    return any(
        isinstance(each.tag, str) and each.tag.startswith("{") and "xacro" in each.tag.split("}")[0]
        for each in root.iter()
    )


def _why(data: bytes, error: Exception) -> str:
    """What is wrong with text that is no XML, and what to do."""
    if not data.strip():
        return "the file is empty. Name another one."
    if "encoding" in str(error) or isinstance(error, UnicodeError | LookupError):
        return f"not in the encoding that it states ({error}). Save it as UTF-8."
    try:
        data.decode("utf-8")
    except UnicodeDecodeError as wrong:
        return (
            f"byte {wrong.start} is not UTF-8, and the file states no other encoding. "
            "Save it as UTF-8."
        )
    if b"<xacro:" in data:  # a prefix that is not declared
        return 'a xacro file without xmlns:xacro="http://www.ros.org/wiki/xacro". Add that.'
    return f"not well-formed XML ({error}). Correct that place."
