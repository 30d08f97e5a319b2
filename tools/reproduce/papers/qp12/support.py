"""Section III-E: a target for the centre of mass of HOAP-3 that lies beyond its support polygon.

The shipped config, with its target moved forwards out of the sole: the centre of mass stops at the
edge, less the margin that the config keeps, where ρ* = 0 in spite of ∇V ≠ 0.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from hoap3.tools.reproduce.figures import COLOURS, Array, Axis, Curve, Figure, Panel, mark
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
from hoap3.tools.reproduce.papers.qp12.drawings import over_the_sole, sole_outline
from hoap3.tools.reproduce.papers.qp12.experiments import PERIOD_S, com_path, sole
from hoap3.tools.reproduce.rows import Row, bounded

CONFIG = "stable_qp_hoap3"
SECONDS = 4.0
BEYOND_M = 0.08
"""x of the target; the sole ends at 0.054 m."""

CONDITION = "held by support_polygon"
AT_REST_TICKS = 500
AT_THE_EDGE_M = 1e-4
STILL = 1e-6  # m/s, and of ρ


@dataclass(frozen=True, eq=False)
class Support:
    """A motion to the edge.

    Attributes:
        done: the run.
        path: of the centre of mass, (ticks, 3) [m].
        target: [m].
        margin: to the edges of the sole [m].
    """

    done: CertifiedRun
    path: Array
    target: tuple[float, float, float]
    margin: float

    @property
    def distance(self) -> Array:
        """From the centre of mass to the nearest edge, less the margin, (ticks,) [m]."""
        corner = sole().max(axis=0)  # the sole is a rectangle about its centre
        gaps = corner - self.margin - np.abs(self.path[:, :2])
        return np.asarray(gaps.min(axis=1), np.float64)


def go(say: Callable[[str], None] = lambda _: None, seconds: float = SECONDS) -> Support:
    """The motion."""
    say(f"support polygon: {seconds:g} s")
    content = config(CONFIG)
    goal = content["parameters"]["task"]["parameters"]["target"]["position_m"]
    goal[0] = BEYOND_M
    done = run(content, seconds)
    margin = constraint(content, "support_polygon").get("margin_m", 0.0)
    return Support(done, com_path(done.q), tuple(goal), margin)


def rows(found: Support) -> list[Row]:
    """Where it stops, and that it says why."""
    done, item = found.done, "(25): support polygon"
    late = np.linalg.norm(np.diff(found.path[-AT_REST_TICKS:], axis=0), axis=1) / PERIOD_S
    edge = f"Found again from the sole's corners, {1e3 * found.margin:g} mm of margin taken off"
    stops = "As the paper: constraints make minima where ∇V ≠ 0; there ρ* = 0"
    return [
        bounded(f"{item}, least distance of the CoM to the edge", "at least 0",
                float(found.distance.min()), (-1e-9, None), edge, unit="m"),
        bounded(f"{item}, distance to the edge at the end", "at the edge",
                float(found.distance[-1]), (None, AT_THE_EDGE_M), edge, unit="m"),
        bounded(f"{item}, greatest speed of the CoM in the last {AT_REST_TICKS} ms", 0,
                float(late.max()), (None, STILL), stops, unit="m/s"),
        bounded(f"{item}, ρ at the end", 0, float(done.rho[-1]), (None, STILL), stops),
        bounded(f"{item}, |e| at the end", None, float(done.error[-1]),
                (found.target[0] - float(found.path[:, 0].max()), None),
                "The target is out of reach: V stays above 0", unit="m"),
        bounded(f"{item}, condition '{CONDITION}' at the end", 1, float(CONDITION in done.held),
                (1.0, 1.0), "The log says what holds the robot"),
        falls(item, done),
        *certified(item, done),
    ]  # fmt: skip


def draw(found: Support) -> Figure:
    """Path, distance to the edge, and certificates."""
    name = "to the edge"
    made = panels({name: found.done})
    done = found.done
    curves = [
        time_curve("CoM to the edge", done, 1e3 * found.distance, colour=COLOURS[2]),
        time_curve(
            "smallest of all margins", done, 1e3 * done.margin, colour=COLOURS[1], dash="--"
        ),
    ]
    title = "distance to the edge, smallest margin"
    axis = Axis("margin_mm_or_mrad", "margin [mm or mrad]")
    distance = Panel("margin", title, made["v"].x, axis, curves)
    rows = ((_path(found, name), made["v"], made["v_rate"]),
            (made["rho"], distance, made["status"]))  # fmt: skip
    title = "Section III-E: a target beyond the support polygon"
    return Figure("support_polygon", title, rows, (13.0, 6.5))


def _path(found: Support, name: str) -> Panel:
    sole = sole_outline()
    inner_x, inner_y = (side - 1e3 * found.margin * np.sign(side) for side in (sole.x, sole.y))
    path = 1e3 * found.path[::SHOWN_EVERY]
    curves = [
        sole,
        Curve("less the margin", inner_x, inner_y, dash="--"),
        Curve(name, path[:, 0], path[:, 1], COLOURS[0]),
        mark("start", path[0, 0], path[0, 1], "o"),
        mark("target", 1e3 * found.target[0], 1e3 * found.target[1], "X"),
    ]
    title = "centre of mass over the right sole"
    return over_the_sole("path", title, (-60.0, 90.0), (-42.0, 42.0), curves)
