"""Layouts for Foxglove and PlotJuggler, from templates, for one robot.

In a template `$robot` is its name. What says `$index` or `$joint` stands there once for each joint,
with the joint's place, its name, and a `$colour`: an element of a list in JSON, a line in XML.
"""

from __future__ import annotations

import json
from importlib import resources
from pathlib import Path
from string import Template
from typing import Any
from xml.sax.saxutils import escape

from hoap3.protocol.robot.description import RobotDescription
from hoap3.robot_emulator.robots import load
from hoap3.tools.analysis.result_folder import make_folder, unwritable
from hoap3.tools.logs.files import whole_file

FOXGLOVE, PLOTJUGGLER = "foxglove.json", "plotjuggler.xml"  # behind the robot's name
COLOURS = ("#0072b2", "#e69f00", "#009e73", "#cc79a7", "#56b4e9", "#d55e00")
"""Told apart by everybody: six of those of Okabe and Ito, https://jfly.uni-koeln.de/color/."""


def write_layouts(robot: str, folder: Path) -> list[Path]:
    """Write both layouts for a robot.

    Args:
        robot: a name or a path.
        folder: is made where it does not exist.

    Returns:
        The files.

    Raises:
        UsageError: no such robot.
        ConfigError: the folder cannot be written, or holds layouts already.
    """
    description = load(robot)
    texts = {
        f"{description.name}.{FOXGLOVE}": foxglove_layout(description),
        f"{description.name}.{PLOTJUGGLER}": plotjuggler_layout(description),
    }
    for name in texts:
        make_folder(folder, name)
    try:
        for name, text in texts.items():
            with whole_file(folder / name) as draft:
                draft.write_text(text, encoding="utf-8")
    except OSError as error:
        raise unwritable(folder, error) from error
    return [folder / name for name in texts]


def foxglove_layout(description: RobotDescription) -> str:
    """The layout for Foxglove, as JSON."""
    filled = _filled(json.loads(_template(FOXGLOVE)), description, {"robot": description.name})
    return json.dumps(filled, indent=2, ensure_ascii=False) + "\n"


def plotjuggler_layout(description: RobotDescription) -> str:
    """The layout for PlotJuggler, as XML."""
    lines, joints = [], _joints(description)
    for joint in joints:
        joint["joint"] = escape(joint["joint"], {'"': "&quot;"})
    for line in _template(PLOTJUGGLER).splitlines():
        many = joints if _of_a_joint(line) else [{"robot": description.name}]
        lines += [Template(line).substitute(each) for each in many]
    return "\n".join(lines) + "\n"


def _template(name: str) -> str:
    folder = resources.files("hoap3.tools.bridge") / "templates"
    return (folder / name).read_text(encoding="utf-8")


def _joints(description: RobotDescription) -> list[dict[str, str]]:
    return [
        {
            "robot": description.name,
            "index": str(number),
            "joint": name,
            "colour": COLOURS[number % len(COLOURS)],
        }
        for number, name in enumerate(description.joint_names)
    ]


def _of_a_joint(text: str) -> bool:
    return "$index" in text or "$joint" in text


def _filled(part: Any, description: RobotDescription, words: dict[str, str]) -> Any:
    if isinstance(part, str):
        return Template(part).substitute(words)
    if isinstance(part, dict):
        return {key: _filled(each, description, words) for key, each in part.items()}
    if not isinstance(part, list):
        return part
    found = []
    for each in part:
        many = _joints(description) if _of_a_joint(json.dumps(each)) else [words]
        found += [_filled(each, description, one) for one in many]
    return found
