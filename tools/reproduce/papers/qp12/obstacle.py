"""Section III-E: the right forearm of HOAP-3 round a ball, by (25).

The shipped config, and the same without its distance constraint, which goes through the ball.
Distances are found again here, by Coal from the ball to the <collision> shapes of the arm's links
as Pinocchio reads them from the URDF.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from hoap3.tools.reproduce.figures import COLOURS, Array, Axis, Curve, Figure, Panel, level
from hoap3.tools.reproduce.papers.qp12 import oracle
from hoap3.tools.reproduce.papers.qp12.certified import (
    SHOWN_EVERY,
    CertifiedRun,
    certified,
    config,
    constraint,
    falls,
    panels,
    run,
    time_curve,
)
from hoap3.tools.reproduce.rows import Row, bounded

CONFIG = "obstacle"
SECONDS = 10.0
ARM = ("r_forearm", "r_upper_arm", "r_elbow_link")
CURVED = 1e-6  # m: what one Euler step of a curved constraint may overstep
ROUND, THROUGH = "round the ball", "without the constraint"


@dataclass(frozen=True, eq=False)
class Passage:
    """A motion beside a ball.

    Attributes:
        done: the run.
        distance: from the ball to the nearest link of the arm, negative inside, (ticks,) [m].
        nearest: point of the forearm's surface that is nearest to the ball, seen from its centre,
            in the axes of the ball's frame, (ticks, 3) [m].
    """

    done: CertifiedRun
    distance: Array
    nearest: Array


@dataclass(frozen=True, eq=False)
class Obstacle:
    """Both motions.

    Attributes:
        passages: by `ROUND` and `THROUGH`.
        radius: of the ball [m].
        clearance: that the config asks for [m].
    """

    passages: dict[str, Passage]
    radius: float
    clearance: float


def go(say: Callable[[str], None] = lambda _: None, seconds: float = SECONDS) -> Obstacle:
    """With the constraint, and without."""
    content, free = config(CONFIG), config(CONFIG)
    settings = constraint(content, "distance")
    (ball,) = settings["obstacles"]
    free["parameters"]["constraints"] = [
        each for each in free["parameters"]["constraints"] if each["constraint"] != "distance"
    ]
    passages = {}
    for name, each in ((ROUND, content), (THROUGH, free)):
        say(f"obstacle, {name}: {seconds:g} s")
        done = run(each, seconds)
        around = [oracle.distance_from_ball(ball, link, done.q) for link in ARM]
        passages[name] = Passage(done, np.min([gap for gap, _ in around], axis=0), around[0][1])
    return Obstacle(passages, ball["radius_m"], settings["clearance_m"])


def rows(found: Obstacle) -> list[Row]:
    """What (25) promises, and that without it the ball would be hit."""
    around, through = found.passages[ROUND], found.passages[THROUGH]
    done, item = around.done, "(25): obstacle"
    clear = (
        "Found again by Coal, from the ball to the URDF's own shapes; the config asks for "
        f"{1e3 * found.clearance:g} mm"
    )
    hit = "The same config without it goes through the ball: it is the constraint that leads round"
    gap, none = float(around.distance.min()), float(through.distance.min())
    left, wide = float(done.error[-1] / done.error[0]), (found.clearance - CURVED, None)
    falling = "Along the ball V falls on as asked, with ρ = 1"
    return [
        bounded(f"{item}, least distance from ball to arm", "at least 0", gap, wide, clear,
                unit="m"),
        bounded(f"{item}, least distance without the constraint", None, none, (None, 0.0), hit,
                unit="m"),
        bounded(f"{item}, |e| at the end / |e| at the start", "0 in time", left, (None, 0.1),
                falling),
        falls(item, done),
        *certified(item, done, -CURVED),
    ]  # fmt: skip


def draw(found: Obstacle) -> Figure:
    """The forearm's way, distances, and the certificates of both motions."""
    made = panels({name: each.done for name, each in found.passages.items()})
    v, done = made["v"], found.passages[ROUND].done
    curves = [
        time_curve(name, each.done, 1e3 * each.distance, colour=colour)
        for (name, each), colour in zip(found.passages.items(), COLOURS, strict=False)
    ]
    curves += [
        level("clearance", v.x.limits or (), 1e3 * found.clearance),
        time_curve(f"smallest margin, {ROUND}", done, 1e3 * done.margin, colour=COLOURS[2]),
    ]
    title = "distance from the ball to the arm, smallest margin"
    axis = Axis("distance_mm", "distance [mm], margin [mm or mrad]")
    distances = Panel("distance", title, v.x, axis, curves)
    rows = ((_ways(found), distances, v), (made["v_rate"], made["rho"], made["status"]))
    title = "Section III-E: the right forearm round a ball"
    return Figure("obstacle", title, rows, (13.0, 6.5))


def _ways(found: Obstacle) -> Panel:
    """Seen along x, which is nearly along the forearm; how far is true, whatever its tilt."""
    turn = np.linspace(0.0, 2.0 * math.pi, 181)
    circle = np.stack([np.cos(turn), np.sin(turn)])
    ball = 1e3 * found.radius * circle
    clear = ball + 1e3 * found.clearance * circle
    curves = [
        Curve("ball", ball[0], ball[1], style="area"),
        Curve("clearance", clear[0], clear[1], dash="--"),
    ]
    for (name, each), colour in zip(found.passages.items(), COLOURS, strict=False):
        away = 1e3 * np.linalg.norm(each.nearest[::SHOWN_EVERY], axis=1)
        _, y, z = each.nearest[::SHOWN_EVERY].T
        y, z = away * y / np.hypot(y, z), away * z / np.hypot(y, z)
        curves.append(Curve(name, y, z, colour))
    y_mm, z_mm = Axis("y_mm", "y, left, from the ball [mm]"), Axis("z_mm", "z, up [mm]")
    return Panel("path", "nearest point of the forearm", y_mm, z_mm, curves, square=True)
