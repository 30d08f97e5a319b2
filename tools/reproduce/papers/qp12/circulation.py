"""Section III-D.2: the centre of mass of HOAP-3 to an ellipse, and round it for ever, both ways.

In steps of T, V does not vanish on the curve. A step gives

    V(q + uT) = V + T·V̇ + ½T²·uᵀ∇²V u,   V̇ = −Ψ = −2ηV

with η = Ψ/(2V) [1/s], the rate at which |e| falls. For V = ½|α|² the last term is
½T²·(|α̇|² + α·a), a being the acceleration of α that Euler's steps do not see: that of the curve's
curvature, κζ², and of the kinematics. V settles where it makes up for the second one:

    2ηT|e|² = T²·(|α̇|² + a|e|)   →   |e| ≤ |α̇|·√(T/(2η)) + aT/(2η)

Near the curve a|e| is nothing beside |α̇|². With φ(α̇) of (23) as the objective α̇ would vanish as
well. The shipped config has the joints' speeds as its objective, and leaves α̇ across α free. It
is slower than the motion along the curve, so that the floor is

    |e| = ζ·√(T/(2η)),   V = ζ²T/(4η)
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from hoap3.remote_controller.model.kinematics import Kinematics
from hoap3.robot_emulator.robots import load
from hoap3.tools.reproduce.figures import COLOURS, INK, PALE, Array, Axis, Curve, Figure, Panel
from hoap3.tools.reproduce.papers.qp12.certified import (
    SHOWN_EVERY,
    CertifiedRun,
    certified,
    config,
    panels,
    run,
)
from hoap3.tools.reproduce.papers.qp12.experiments import PERIOD_S, ROBOT, com_path, sole
from hoap3.tools.reproduce.rows import Row, bounded, near

CONFIG = "com_circulation"
SECONDS = 16.0
"""Half of it to the curve, and once round it."""

WAYS = {"forward": 1.0, "backward": -1.0}


@dataclass(frozen=True)
class Ellipse:
    """What is circulated, in the plane z = center[2].

    Attributes:
        center: (3,) [m].
        radii: along x and y [m].
        speed: ζ [m/s].
    """

    center: tuple[float, float, float]
    radii: tuple[float, float]
    speed: float

    @property
    def length(self) -> float:
        """Once round [m], by Ramanujan's formula: exact to 1e-7 for such an ellipse."""
        a, b = self.radii
        h = ((a - b) / (a + b)) ** 2
        return math.pi * (a + b) * (1.0 + 3.0 * h / (10.0 + math.sqrt(4.0 - 3.0 * h)))

    def angle(self, path: Array) -> Array:
        """Where on the ellipse, without jumps, (ticks,) [rad]."""
        x, y = (path[:, :2] - self.center[:2]).T / np.array(self.radii)[:, None]
        return np.asarray(np.unwrap(np.arctan2(y, x)), np.float64)

    def alpha(self, path: Array) -> Array:
        """Both functions that vanish on it, (ticks, 2) [m]."""
        d = path - np.array(self.center)
        level = ((d[:, :2] / np.array(self.radii)) ** 2).sum(axis=1) - 1.0
        return np.stack([0.5 * math.sqrt(math.prod(self.radii)) * level, d[:, 2]], axis=1)

    def tangent(self, path: Array) -> Array:
        """Unit vector along it, from x to y, (ticks, 3)."""
        x, y = (path[:, :2] - self.center[:2]).T / np.array(self.radii)[:, None] ** 2
        along = np.stack([-y, x, np.zeros_like(x)], axis=1)
        return np.asarray(along / np.linalg.norm(along, axis=1)[:, None], np.float64)


@dataclass(frozen=True, eq=False)
class Circulation:
    """A run round the ellipse.

    Attributes:
        ellipse: that it should follow.
        way: 1 from x to y, −1 the other way.
        done: the run.
        path: of the centre of mass, (ticks, 3) [m].
        unseen: |a|, greatest acceleration of α that Euler's steps do not see [m/s²].
    """

    ellipse: Ellipse
    way: float
    done: CertifiedRun
    path: Array
    unseen: float

    @property
    def round(self) -> slice:
        """Ticks of the last time round."""
        return slice(-round(self.ellipse.length / self.ellipse.speed / PERIOD_S) - 1, None)

    @property
    def floor(self) -> float:
        """Of V [m²]."""
        return self.ellipse.speed**2 * PERIOD_S / (4.0 * self.rate)

    @property
    def sharp_floor(self) -> float:
        """Of |e| [m], with α̇ as it was."""
        steps = np.diff(self.ellipse.alpha(self.path), axis=0)[self.round] / PERIOD_S
        across = float(np.linalg.norm(steps, axis=1).max())
        eta, T = self.rate, PERIOD_S
        return across * math.sqrt(T / (2.0 * eta)) + self.unseen * T / (2.0 * eta)

    @property
    def rate(self) -> float:
        """η: the least Ψ/(2V) of the last round [1/s]."""
        part = self.round
        return float((self.done.psi[part] / (2.0 * self.done.v[part])).min())


def circulate(
    say: Callable[[str], None] = lambda _: None, seconds: float = SECONDS
) -> dict[str, Circulation]:
    """Both ways round."""
    found = {}
    for name, way in WAYS.items():
        say(f"circulation, {name}: {seconds:g} s")
        content = config(CONFIG)
        task = content["parameters"]["task"]["parameters"]
        task["direction"] = name
        curve = task["curve_parameters"]
        ellipse = Ellipse(
            tuple(curve["center_m"]),
            tuple(curve["radii_m"]),
            task["speed_m_s"],
        )
        done = run(content, seconds)
        path = com_path(done.q)
        found[name] = Circulation(ellipse, way, done, path, unseen(ellipse, done.q, path))
    return found


def unseen(ellipse: Ellipse, q: Array, path: Array) -> float:
    """Greatest 2/T²·|Δα − ∇α·J·Δq| of a motion in steps of T [m/s²]."""
    kinematics = Kinematics(load(ROBOT))
    frame = kinematics.frame_id("r_sole")
    jacobian, place, first = np.zeros((3, kinematics.n)), np.zeros(3), np.zeros((len(q) - 1, 3))
    for k, step in enumerate(np.diff(q, axis=0)):
        kinematics.update(q[k])
        kinematics.com(frame, place, jacobian)
        first[k] = jacobian @ step
    slope = (path[:-1, :2] - ellipse.center[:2]) / np.array(ellipse.radii) ** 2
    scale = math.sqrt(math.prod(ellipse.radii))
    seen = np.stack([scale * (slope * first[:, :2]).sum(axis=1), first[:, 2]], axis=1)
    missed = np.diff(ellipse.alpha(path), axis=0) - seen
    return float(2.0 / PERIOD_S**2 * np.linalg.norm(missed, axis=1).max())


def rows(found: dict[str, Circulation]) -> list[Row]:
    """What (23) promises."""
    return [row for name, each in found.items() for row in _rows(f"(23): {name}", each)]


def _rows(item: str, each: Circulation) -> list[Row]:
    ellipse, done, part = each.ellipse, each.done, each.round
    zeta, path = ellipse.speed, each.path
    steps = np.diff(path, axis=0) / PERIOD_S
    along = (steps * ellipse.tangent(path[:-1])).sum(axis=1)[part] * each.way
    angle = ellipse.angle(path)[part]
    rounds = float(angle[-1] - angle[0]) / (2.0 * math.pi)
    way = "(22) leaves both directions, T and −T; ζ along the path of the centre of mass"
    speeds = {"least": float(along.min()), "greatest": float(along.max())}
    return [
        bounded(
            f"{item}, greatest V of the last round / (ζ²T/(4η))",
            0,
            float(done.v[part].max()) / each.floor,
            (None, 1.0),
            "On the curve V = 0 in continuous time only: in steps of T it settles below ζ²T/(4η), "
            "|e| = ζ·√(T/(2η)), where η is the least Ψ/(2V) of the last round",
        ),
        bounded(
            f"{item}, greatest |e| of the last round / (|α̇|√(T/(2η)) + aT/(2η))",
            0,
            float(done.error[part].max()) / each.sharp_floor,
            (None, 1.0),
            "The sharper floor: with the speed across the curve as it was, and a, what Euler's "
            "steps do not see: curvature of the curve and of the kinematics",
        ),
        near(f"{item}, rounds in the time of one", each.way, rounds, each.way, way, absolute=0.01),
        *(
            near(f"{item}, {name} speed along the curve", zeta, speed, zeta, way, unit="m/s")
            for name, speed in speeds.items()
        ),
        *certified(item, done),
    ]


def draw(found: dict[str, Circulation]) -> Figure:
    """Paths over the sole, and their certificates."""
    made = panels({name: each.done for name, each in found.items()})
    seconds = max(len(each.done.v) for each in found.values()) * PERIOD_S
    floors = [
        Curve(
            f"floor, {name}",
            np.array([0.0, seconds]),
            np.full(2, each.floor),
            colour,
            dash="--",
            legend="floor ζ²T/(4η)",
        )
        for (name, each), colour in zip(found.items(), COLOURS, strict=False)
    ]
    v = made["v"]
    v = Panel(v.name, "V, and its floor in steps of T", v.x, v.y, (*v.curves, *floors))
    title = "Section III-D.2: persistent motion of the centre of mass, both ways round"
    rows = ((_paths(found), v, made["v_rate"]), (made["rho"], made["margin"], made["status"]))
    return Figure("circulation", title, rows, (13.0, 6.5))


def _paths(found: dict[str, Circulation]) -> Panel:
    corners = 1e3 * np.vstack([sole(), sole()[:1]])
    ellipse = next(iter(found.values())).ellipse
    turn = np.linspace(0.0, 2.0 * math.pi, 181)
    x, y = (
        1e3 * (center + radius * wave)
        for center, radius, wave in zip(
            ellipse.center, ellipse.radii, (np.cos(turn), np.sin(turn)), strict=False
        )
    )
    curves = [
        Curve("right sole", corners[:, 0], corners[:, 1], PALE, "area"),
        Curve("ellipse", x, y, INK, dash=":"),
    ]
    for (name, each), colour in zip(found.items(), COLOURS, strict=False):
        path, dash = 1e3 * each.path[::SHOWN_EVERY], "-" if each.way > 0.0 else "--"
        curves.append(Curve(name, path[:, 0], path[:, 1], colour, dash=dash))
    start = 1e3 * next(iter(found.values())).path[:1]
    curves.append(Curve("start", start[:, 0], start[:, 1], INK, dash="", marker="o"))
    return Panel(
        "path",
        "centre of mass over the right sole",
        Axis("x_mm", "x, forward [mm]", (-27.0, 27.0)),
        Axis("y_mm", "y, left [mm]", (4.0, 40.0)),
        tuple(curves),
        square=True,
    )
