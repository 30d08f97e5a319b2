"""The picture of docs/internals/architecture.md: packages, and which room imports which."""

from __future__ import annotations

import ast
from pathlib import Path

from drawing import lines
from matplotlib.axes import Axes
from matplotlib.figure import Figure

HOUSE = Path(__file__).resolve().parents[2]
ROOMS = {  # lower left corner, width and height
    "tools": (0.0, 4.4, 10.0, 1.8),
    "remote_controller": (0.0, 2.1, 5.7, 1.35),
    "robot_emulator": (6.9, 2.1, 3.1, 1.35),
    "protocol": (0.0, 0.0, 10.0, 1.0),
}
ACROSS = {"tools": 7, "remote_controller": 4, "robot_emulator": 2, "protocol": 6}


def packages() -> Figure:
    """Rooms with their packages; an arrow leads from a room to one that it imports."""
    figure = Figure(figsize=(7.2, 3.6))
    axes = figure.add_axes((0.01, 0.01, 0.98, 0.98))
    axes.set_axis_off()
    axes.set_xlim(-0.1, 10.1)
    axes.set_ylim(-0.1, 6.3)
    for room in ROOMS:
        _draw_room(axes, room)
    for source, target in sorted(_imports()):
        _draw_arrow(axes, source, target)
    return figure


def _draw_room(axes: Axes, room: str) -> None:
    x, y, width, height = ROOMS[room]
    corners = [(x, y), (x + width, y), (x + width, y + height), (x, y + height), (x, y)]
    lines(axes, {"": tuple(zip(*corners, strict=True))}, at="", color="#888888", linestyle="-")
    axes.text(x + 0.12, y + height - 0.14, room, weight="bold", va="top", fontsize=9)
    folders = (HOUSE / room).iterdir()
    names = sorted(each.name for each in folders if (each / "__init__.py").is_file())
    step = (width - 0.24) / ACROSS[room]
    for place, name in enumerate(names):
        row, column = divmod(place, ACROSS[room])
        axes.text(x + 0.12 + column * step, y + height - 0.68 - 0.42 * row, name, fontsize=7.5)


def _draw_arrow(axes: Axes, source: str, target: str) -> None:
    """From the bottom of the importing room to the top of the other."""
    x0, y0, width0, _ = ROOMS[source]
    x1, y1, width1, height1 = ROOMS[target]
    x = (max(x0, x1) + min(x0 + width0, x1 + width1)) / 2.0
    if (source, target) == ("tools", "protocol"):
        x = 6.3  # between the two rooms in the middle
    style = {"arrowstyle": "->", "color": "#444444"}
    axes.annotate("", (x, y1 + height1), (x, y0), arrowprops=style)


def _imports() -> set[tuple[str, str]]:
    """Pairs of rooms of which a module of the first imports the second."""
    found = set()
    for room in ROOMS:
        for path in (HOUSE / room).rglob("*.py"):
            tree = ast.walk(ast.parse(path.read_text(encoding="utf-8")))
            named = {each.module or "" for each in tree if isinstance(each, ast.ImportFrom)}
            rooms = {name.split(".")[1] for name in named if name.startswith("hoap3.")}
            found |= {(room, other) for other in rooms if other in ROOMS and other != room}
    return found
