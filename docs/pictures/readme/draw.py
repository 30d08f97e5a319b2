"""Makes the still pictures of robots: `python docs/pictures/readme/draw.py [NAME …]`."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from canvas import Canvas

from hoap3.protocol.robot.description import COM
from hoap3.remote_controller.constraints.support.polygon import hull
from hoap3.robot_emulator.robots import load
from hoap3.tools.analysis.report.motion import point_path
from hoap3.tools.picture.body import Body, Placement
from hoap3.tools.picture.marks import Marks
from hoap3.tools.picture.stage import Stage
from hoap3.tools.services.simulate import simulate

FOLDER = Path(__file__).parent
ROBOTS = ("hoap3", "humanoid32", "baxter_left_arm", "lwr", "ur5")
TITLE = 40  # px above a picture
FACES = 4000
TARGET = np.array([0.01, 0.025, 0.2869])  # m_d of the paper, in the right sole's frame [m]


def side_by_side(
    shown: Sequence[tuple[str, Body, Placement, Marks]], width: int, height: int
) -> Any:
    """Robots beside each other, each in a scale of its own, as an image of Pillow."""
    canvas = Canvas(width * len(shown), height + TITLE)
    for place, (title, body, placement, marks) in enumerate(shown):
        stage = Stage.around(body, [placement], [marks], (width, height), 12.0)
        canvas.paint(stage.paint(placement, marks), (place * width, TITLE))
        canvas.write((place * width + width / 2, TITLE - 14), title, "soft", 16.0, "ms")
    return canvas.image


def robots() -> Any:
    """The robots that come with it."""
    shown = []
    for name in ROBOTS:
        description = load(name)
        body = Body(description, FACES)
        placement = body.place(description.initial_position)
        shown.append((f"{name}, {description.n} joints", body, placement, Marks()))
    return side_by_side(shown, 250, 260)


def own_feet() -> Any:
    """HOAP-3 in MuJoCo after 5 s, on one held foot and on both, with its centre of mass."""
    pairs = ("hoap3_one_foot", "qp12"), ("hoap3_standing", "stable_qp_standing")
    description = load("hoap3")
    body, shown = Body(description, FACES), []
    for robot, controller in pairs:
        end = simulate(robot, controller, 5.0).states[-1]
        q, base = end["q"].copy(), end["base"].copy()
        placement = body.place(q, base)
        com = point_path(q[None], description, COM, "r_sole")[0]
        soles = [sole for sole in description.soles if len(base) or sole.frame == "r_sole"]
        corners = [
            placement.to_world(sole.frame, np.column_stack((sole.polygon, np.zeros(4))))
            for sole in soles
        ]
        point, target = placement.to_world("r_sole", np.stack((com, TARGET)))
        support = hull(np.concatenate(corners)[:, :2])
        marks = Marks(point=point, target=target, support=support, plumb=True)
        shown.append((robot, body, placement, marks))
    return side_by_side(shown, 380, 380)


PICTURES: dict[str, tuple[Callable[[], Any], Path]] = {
    "robots": (robots, FOLDER / "robots.png"),
    "own_feet": (own_feet, FOLDER.parent / "own_feet.png"),
}
"""Every picture, and its file."""


def main() -> int:
    """Make those that are named, or all."""
    wanted = sys.argv[1:] or [*PICTURES]
    unknown = [name for name in wanted if name not in PICTURES]
    if unknown:
        sys.stderr.write(f"no picture {', '.join(unknown)}; there are {', '.join(PICTURES)}\n")
        return 2
    for name in wanted:
        draw, path = PICTURES[name]
        draw().save(path, optimize=True)
        sys.stderr.write(f"{path}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
