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
from dataclasses import dataclass, replace

import numpy as np

from hoap3.tools.reproduce.figures import COLOURS, Array, Curve, Figure, Panel, level, lines, mark
from hoap3.tools.reproduce.papers.qp12 import oracle
from hoap3.tools.reproduce.papers.qp12.certified import (
    SHOWN_EVERY,
    CertifiedRun,
    certified,
    config,
    panels,
    run,
)
from hoap3.tools.reproduce.papers.qp12.drawings import over_the_sole, sole_outline
from hoap3.tools.reproduce.papers.qp12.experiments import PERIOD_S, com_path
from hoap3.tools.reproduce.papers.qp12.reference import Ellipse
from hoap3.tools.reproduce.rows import Row, bounded, near

CONFIG = "com_circulation"
SECONDS = 16.0
"""Half of it to the curve, and once round it."""

FLOOR = "floor ζ²T/(4η)"
WAYS = {"forward": 1.0, "backward": -1.0}


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
        center, radii = tuple(curve["center_m"]), tuple(curve["radii_m"])
        ellipse = Ellipse(center, radii, task["speed_m_s"])
        done = run(content, seconds)
        path = com_path(done.q)
        found[name] = Circulation(ellipse, way, done, path, oracle.unseen(ellipse, done.q, path))
    return found


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
    v, error = float(done.v[part].max()) / each.floor, float(done.error[part].max())
    last, below = f"{item}, greatest", (None, 1.0)
    return [
        bounded(f"{last} V of the last round / (ζ²T/(4η))", 0, v, below, _FLOOR),
        bounded(f"{last} |e| of the last round / (|α̇|√(T/(2η)) + aT/(2η))", 0,
                error / each.sharp_floor, below, _SHARP),
        near(f"{item}, rounds in the time of one", None, rounds, each.way, way, absolute=0.01),
        *(
            near(f"{item}, {name} speed along the curve", None, speed, zeta, way, unit="m/s")
            for name, speed in speeds.items()
        ),
        *certified(item, done),
    ]  # fmt: skip


_FLOOR = (
    "On the curve V = 0 in continuous time only: in steps of T it settles below ζ²T/(4η), "
    "|e| = ζ·√(T/(2η)), where η is the least Ψ/(2V) of the last round"
)
_SHARP = (
    "The sharper floor: with the speed across the curve as it was, and a, what Euler's steps do "
    "not see: curvature of the curve and of the kinematics"
)


def draw(found: dict[str, Circulation]) -> Figure:
    """Paths over the sole, and their certificates."""
    made = panels({name: each.done for name, each in found.items()})
    v, colours = made["v"], zip(found.items(), COLOURS, strict=False)
    floors = [
        level(f"floor, {name}", v.x.limits or (), each.floor, colour=colour, legend=FLOOR)
        for (name, each), colour in colours
    ]
    v = replace(v, title="V, and its floor in steps of T", curves=[*v.curves, *floors])
    title = "Section III-D.2: persistent motion of the centre of mass, both ways round"
    rows = ((_paths(found), v, made["v_rate"]), (made["rho"], made["margin"], made["status"]))
    return Figure("circulation", title, rows, (13.0, 6.5))


def _paths(found: dict[str, Circulation]) -> Panel:
    first = next(iter(found.values()))
    turn = np.linspace(0.0, 2.0 * math.pi, 181)
    (cx, cy, _), (a, b) = first.ellipse.center, first.ellipse.radii
    paths = {name: 1e3 * each.path[::SHOWN_EVERY] for name, each in found.items()}
    dashes = ["-" if each.way > 0.0 else "--" for each in found.values()]
    ellipse = 1e3 * (cx + a * np.cos(turn)), 1e3 * (cy + b * np.sin(turn))
    curves = [
        sole_outline(),
        Curve("ellipse", *ellipse, dash=":"),
        *lines({name: (path[:, 0], path[:, 1]) for name, path in paths.items()}, dashes),
        mark("start", 1e3 * first.path[0, 0], 1e3 * first.path[0, 1], "o"),
    ]
    title = "centre of mass over the right sole"
    return over_the_sole("path", title, (-27.0, 27.0), (4.0, 40.0), curves)
