"""Names that can travel: of robots on the network, of joints in messages and logs, of links."""

from __future__ import annotations

import re
from xml.etree import ElementTree as ET

from hoap3.protocol.errors import DescriptionError
from hoap3.protocol.robot.urdf import RESERVED
from hoap3.robot_emulator.robots.urdf_import.notes import Notes

MOST_ROBOT = 32  # characters
MOST_JOINT = 64
_OTHERS = re.compile(r"[^A-Za-z0-9_./-]+")


def robot_name(stated: str) -> str:
    """A name for the network, `[a-z][a-z0-9_]{0,31}`, as near as can be to the stated one."""
    name = re.sub(r"[^a-z0-9]+", "_", stated.lower()).strip("_")
    if not name[:1].isalpha():
        name = f"robot_{name}" if name else "robot"
    return name[:MOST_ROBOT].rstrip("_")


def joint_names(stated: list[str], notes: Notes) -> dict[str, str]:
    """By stated name, the one under which a joint travels.

    Letters, digits and _ . / - stay; whatever else becomes `_`.

    Raises:
        DescriptionError: a name is too long, or two become the same.
    """
    found: dict[str, str] = {}
    for name in stated:
        new = _OTHERS.sub("_", name)
        if new[:1] in {".", "/", "-"}:
            new = f"_{new}"
        if new in RESERVED["joint"]:
            new = f"{new}_joint"
        if len(new) > MOST_JOINT:
            raise DescriptionError(
                f"URDF joint {name[:40]!r}…: its name has {len(name)} characters, and at most "
                f"{MOST_JOINT} travel in messages. Shorten it."
            )
        if new in found.values() and name not in found:
            raise DescriptionError(
                f"URDF joint {name!r:.80}: would be called {new!r}, as another one is. "
                "Rename one of them."
            )
        if new != name:
            text = "joints renamed: only letters, digits and _ . / - travel, but not 'universe'"
            notes.add("read", text, f"{name!r:.70} is {new}")
        found[name] = new
    return found


def rename_links(robot: ET.Element, notes: Notes) -> None:
    """Rename the links of a URDF whose names have a meaning of their own here."""
    taken = {link.get("name", "") for link in robot.findall("link")}
    for name in sorted(taken & RESERVED["link"]):
        new = f"{name}_link"
        while new in taken:
            new += "_"
        for tag, key in (("link", "name"), ("joint/parent", "link"), ("joint/child", "link")):
            for element in robot.iterfind(tag):
                if element.get(key) == name:
                    element.set(key, new)
        text = "links renamed, because their names have a meaning of their own in configs"
        notes.add("read", text, f"{name!r} is {new}")
