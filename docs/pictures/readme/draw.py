"""Makes the pictures of the README: `python docs/pictures/readme/draw.py`."""

from __future__ import annotations

import itertools
import re
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from hoap3.protocol.description import RobotDescription
from hoap3.protocol.robot.pinocchio_model import collision_shapes
from hoap3.remote_controller.model.kinematics import Kinematics
from hoap3.robot_emulator.robots import load
from hoap3.tools.html.palette import LIGHT
from hoap3.tools.report.content import read_content
from hoap3.tools.services.run import run_lockstep
from hoap3.tools.simulate import controller_settings, emulator_settings, simulate

FOLDER = Path(__file__).parent
ROBOTS = ("hoap3", "humanoid32", "baxter_left_arm", "lwr", "ur5")
POSTURES = {"ur5": "outstretched"}  # where another than that of its start shows more
ROUND = 14  # faces round a cylinder or a sphere
LIGHT_FROM = np.array([0.4, -0.5, 0.75])
Array = np.ndarray[Any, np.dtype[np.float64]]


def robots() -> Figure:
    """The collision shapes of the robots that come with it, each in its start posture."""
    figure = Figure(figsize=(8.4, 2.6))
    figure.subplots_adjust(left=0, right=1, bottom=0, top=0.9, wspace=0)
    for place, name in enumerate(ROBOTS):
        description = load(name)
        q = np.array(description.postures[POSTURES.get(name, description.initial_posture)])
        axes = figure.add_subplot(1, len(ROBOTS), place + 1, projection="3d")
        faces = [face for shape in _placed(description, q) for face in shape]
        every = np.concatenate(faces)
        axes.add_collection3d(Poly3DCollection(faces, facecolors=_shaded(faces), linewidths=0))
        middle, reach = (every.max(0) + every.min(0)) / 2, np.ptp(every, axis=0).max() / 2
        for setter, value in zip(
            (axes.set_xlim, axes.set_ylim, axes.set_zlim), middle, strict=True
        ):
            setter(value - 0.66 * reach, value + 0.66 * reach)
        axes.set_box_aspect((1, 1, 1))
        axes.view_init(elev=14, azim=40)
        axes.set_axis_off()
        axes.set_title(f"{name}, {description.n} joints", fontsize=9, color=LIGHT["soft"])
    return figure


def own_feet() -> Figure:
    """HOAP-3 in MuJoCo after 5 s, on one held foot and on both, with its centre of mass."""
    figure = Figure(figsize=(7.0, 3.6))
    figure.subplots_adjust(left=0, right=1, bottom=0, top=0.92, wspace=0)
    pairs = ("hoap3_one_foot", "qp12"), ("hoap3_standing", "stable_qp_standing")
    for place, (robot, controller) in enumerate(pairs):
        end = simulate(robot, controller, 5.0).states[-1]
        description = load("hoap3")
        q = end["q"].copy()
        origin, rotation = _sole(description, q)
        if len(end["base"]):  # x y z, then a quaternion x y z w
            x, y, z, w = end["base"][3:7]
            skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
            turn = np.eye(3) + 2.0 * (w * skew + skew @ skew)
            origin, rotation = -turn.T @ end["base"][:3], turn.T
        world = [
            [(face - origin) @ rotation for face in shape] for shape in _placed(description, q)
        ]
        faces = [face for shape in world for face in shape]
        axes = figure.add_subplot(1, 2, place + 1, projection="3d", computed_zorder=False)
        floor = np.array([[-0.15, -0.1, 0], [0.2, -0.1, 0], [0.2, 0.2, 0], [-0.15, 0.2, 0]])
        axes.add_collection3d(Poly3DCollection([floor], facecolors=LIGHT["wash"], zorder=1))
        shown = Poly3DCollection(faces, facecolors=_shaded(faces), linewidths=0, zorder=2)
        axes.add_collection3d(shown)
        x, y, z = 0.01, 0.025, 0.2869  # m_d
        axes.plot((x, x), (y, y), (0.0, z), color=LIGHT["orange"], zorder=3)
        axes.plot((x,), (y,), (z,), "o", color=LIGHT["orange"], zorder=3)
        axes.set_xlim(-0.26, 0.28)
        axes.set_ylim(-0.22, 0.32)
        axes.set_zlim(-0.02, 0.52)
        axes.set_box_aspect((1, 1, 1), zoom=1.25)
        axes.view_init(elev=12, azim=35)
        axes.set_axis_off()
        axes.set_title(robot, fontsize=9, color=LIGHT["soft"])
    return figure


def _sole(description: RobotDescription, q: Array) -> tuple[Array, Array]:
    """Origin and rotation of the right sole in the root."""
    kinematics = Kinematics(description)
    kinematics.update(q)
    origins, rotations, *_ = kinematics.frames()
    sole = kinematics.frame_id("r_sole")
    return origins[sole].copy(), rotations[sole].copy()


def _placed(description: RobotDescription, q: Array) -> list[list[Array]]:
    """Faces of every shape of the robot, in the axes of its root, (k, 3) [m] each."""
    kinematics = Kinematics(description)
    kinematics.update(q)
    origins, rotations, *_ = kinematics.frames()
    shapes = []
    for link, those in collision_shapes(description).items():
        frame = kinematics.frame_id(link)
        for geometry, centre, axes in those:
            here = [face @ axes.T + centre for face in _faces(geometry)]
            shapes.append([face @ rotations[frame].T + origins[frame] for face in here])
    return shapes


def _faces(geometry: Any) -> list[Array]:
    """Faces of a box, a sphere, or a cylinder, about its own centre."""
    angles = np.linspace(0.0, 2.0 * np.pi, ROUND + 1)
    if hasattr(geometry, "halfSide"):
        half = np.array(geometry.halfSide).ravel()
        corners = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * half
        sides = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
        return [corners[list(side)] for side in sides]
    if hasattr(geometry, "halfLength"):
        rings = [(geometry.radius, z * geometry.halfLength) for z in (-1.0, 1.0)]
    else:
        tilts = np.linspace(-np.pi / 2, np.pi / 2, ROUND // 2)
        rings = [(geometry.radius * np.cos(t), geometry.radius * np.sin(t)) for t in tilts]
    circles = [
        np.column_stack((r * np.cos(angles), r * np.sin(angles), np.full(ROUND + 1, z)))
        for r, z in rings
    ]
    faces = [
        np.array([low[k], low[k + 1], high[k + 1], high[k]])
        for low, high in itertools.pairwise(circles)
        for k in range(ROUND)
    ]
    return [*faces, circles[0], circles[-1]]


def _shaded(faces: list[Array]) -> Array:
    """A colour of each face, by how much light it gets."""
    colours = np.empty((len(faces), 3))
    base = np.array([int(LIGHT["blue"][k : k + 2], 16) / 255 for k in (1, 3, 5)])
    for place, face in enumerate(faces):
        normal = np.cross(face[1] - face[0], face[2] - face[0])
        length = float(np.linalg.norm(normal))
        lit = abs(float(normal @ LIGHT_FROM)) / length if length > 0.0 else 0.5
        colours[place] = 1.0 - (1.0 - base) * (0.35 + 0.55 * (1.0 - lit))
    return colours


def report() -> str:
    """Some drawings of a report, side by side, as one SVG for light pages."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) / "run"
        run_lockstep(emulator_settings("hoap3", 0), controller_settings("qp12"), 5.0, folder)
        content = read_content(folder)
        found = [content.motion_drawings[0], *content.certificate_drawings[:2]]
        drawn = [(each.title, each.svg) for each in found]
    width, height, parts = 430, 300, []
    for place, (title, svg) in enumerate(drawn):
        x = place * width
        place_it = f'<svg x="{x + 5}" y="34" width="420" height="250" '
        inner = svg.replace("<svg ", place_it, 1)
        parts.append(
            f'<text x="{x + 12}" y="22" font-size="13" fill="{LIGHT["ink"]}">{title}</text>'
            f"{inner if inner.endswith('</svg>') else inner + '</svg>'}"
        )
    whole = (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {len(drawn) * width} {height}" '
        f'font-family="sans-serif"><rect width="100%" height="100%" fill="{LIGHT["page"]}"/>'
        f"{''.join(parts)}</svg>\n"
    )
    return re.sub(r"var\(--(\w+)\)", lambda role: LIGHT[role[1]], whole)


def main() -> int:
    """Make them."""
    figure = robots()
    FigureCanvasAgg(figure)
    figure.savefig(FOLDER / "robots.png", dpi=110, metadata={"Software": None})
    figure = own_feet()
    FigureCanvasAgg(figure)
    figure.savefig(FOLDER.parent / "own_feet.png", dpi=110, metadata={"Software": None})
    (FOLDER / "report.svg").write_text(report(), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
