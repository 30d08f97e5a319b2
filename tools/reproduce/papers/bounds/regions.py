"""Fig. 3: which upper bound of the acceleration is the least, state by state."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hoap3.tools.reproduce.figures import Array, Axis, Curve, Figure, Panel
from hoap3.tools.reproduce.papers.bounds.joint import FIG_3, Joint
from hoap3.tools.reproduce.papers.bounds.reference import region_shares
from hoap3.tools.reproduce.rows import Row, near

SIDE = 2001  # states along q and along dq, ends included
DRAWN_EVERY = 2  # columns of the grid
SHARE = 1e-3  # 0.1 percentage points

UNREACHABLE, NOT_VIABLE, POSITION, VELOCITY, MAXIMUM, VIABILITY = range(6)
"""Numbers of the regions, as in the paper."""

LOOKS = {
    UNREACHABLE: ("0: unreachable", "#BBBBBB"),
    NOT_VIABLE: ("1: not viable", "#666666"),
    POSITION: ("2: position, (13)", "#CC79A7"),
    VELOCITY: ("3: velocity, (23)", "#56B4E9"),
    MAXIMUM: ("4: greatest acceleration", "#FFF3D6"),
    VIABILITY: ("5: viability, (24)", "#009E73"),
}


@dataclass(frozen=True, eq=False)
class Regions:
    """A grid of states of one joint.

    Attributes:
        q, dq: positions (columns) and velocities (rows).
        region: number of each state's, (rows, columns).
    """

    q: Array
    dq: Array
    region: NDArray[np.int8]

    def share(self, number: int) -> float:
        """Of all states."""
        return float((self.region == number).mean())


def classify(joint: Joint = FIG_3, side: int = SIDE) -> Regions:
    """Ask the shipped bounds, row by row, which of their terms they give."""
    q, speeds = joint.end * np.linspace(-1.0, 1.0, side), joint.speed * np.linspace(-1.0, 1.0, side)
    bounds, T = joint.bounds(side), joint.period_s
    lower, upper = np.zeros(side), np.zeros(side)
    region = np.empty((side, side), np.int8)
    for row, speed in zip(region, speeds, strict=True):
        dq = np.full(side, speed)
        bounds.solve(q, dq, lower, upper)
        row[:] = VIABILITY
        row[joint.end - q < T * speed / 2.0] = POSITION  # turns round within δt
        row[upper == (joint.speed - speed) / T] = VELOCITY
        row[upper == joint.acceleration] = MAXIMUM
        row[~joint.viable(q, dq)] = NOT_VIABLE
        row[~joint.reachable(q, dq)] = UNREACHABLE
    return Regions(q, speeds, region)


def rows(found: Regions) -> list[Row]:
    """Share of each region."""
    why = f"The paper prints no share: ours of {SIDE}² states, next to it those of the printed "
    return [
        near(f"Fig. 3: region {number}, {name}, share of F", None, found.share(number), reference,
             f"{why}Algorithms 1 to 3", absolute=SHARE)
        for number, (name, reference) in enumerate(region_shares(FIG_3, SIDE).items())
    ]  # fmt: skip


def outlines(found: Regions, number: int) -> list[tuple[Array, Array]]:
    """Closed outlines of a region: q and dq. Each column of it must be one piece."""
    inside = (found.region == number)[:, ::DRAWN_EVERY]
    q, some = found.q[::DRAWN_EVERY], inside.any(axis=0)
    lowest = found.dq[inside.argmax(axis=0)]
    highest = found.dq[len(found.dq) - 1 - inside[::-1].argmax(axis=0)]
    edges = np.flatnonzero(np.diff(np.concatenate([[0], some.astype(np.int8), [0]])))
    made = []
    for start, end in edges.reshape(-1, 2):
        columns = slice(start, end)
        there = np.concatenate([q[columns], q[columns][::-1]])
        made.append((there, np.concatenate([lowest[columns], highest[columns][::-1]])))
    return made


def draw(found: Regions) -> Figure:
    """The regions in the plane of states."""
    curves = []
    for number, (name, colour) in LOOKS.items():
        for count, outline in enumerate(outlines(found, number)):
            label = name if count == 0 else f"{name}, piece {count + 1}"
            legend = name if count == 0 else ""
            curves.append(Curve(label, *outline, colour, "area", legend=legend, fill=colour))
    joint = FIG_3
    panel = Panel(
        "",
        f"Q = {joint.end:g} rad, V = {joint.speed:g} rad/s, A = {joint.acceleration:g} rad/s², "
        f"δt = {joint.period_s:g} s",
        Axis("q_rad", "q [rad]", (-1.02 * joint.end, 1.02 * joint.end), 0.1),
        Axis("dq_rad_per_s", "dq [rad/s]", (-1.02 * joint.speed, 1.02 * joint.speed), 0.5),
        curves,
    )
    title = "Fig. 3: which upper bound of the acceleration is the least"
    return Figure("fig3", title, ((panel,),), (9.0, 5.2))
