"""Figs. 1 and 3 to 5."""

from __future__ import annotations

from typing import Literal

import numpy as np

from hoap3.tools.reproduce.figures import (
    COLOURS,
    PALE,
    Array,
    Axis,
    Curve,
    Figure,
    Panel,
    level,
)
from hoap3.tools.reproduce.papers.bounds import elbow, joint

STYLES = {
    joint.UNREACHABLE: ("0: unreachable", "#BBBBBB"),
    joint.NOT_VIABLE: ("1: not viable", "#666666"),
    joint.POSITION: ("2: position, (13)", "#CC79A7"),
    joint.VELOCITY: ("3: velocity, (23)", "#56B4E9"),
    joint.MAXIMUM: ("4: greatest acceleration", "#FFF3D6"),
    joint.VIABILITY: ("5: viability, (24)", "#009E73"),
}

DRAWN_EVERY = 2  # columns of the grid
ELBOW_S = 1.6
BY_PERIODS = dict(zip((1.0, 2.0, 3.0, 5.0, 10.0, joint.TOO_LARGE), COLOURS, strict=False))
"""By T_b/δt."""

SHOWN_LARGER = (2.0, 3.0, 5.0, 10.0)


def draw_viable() -> Figure:
    """States, and the curves that bound them."""
    A, Q, V = joint.FIG_1.acceleration, joint.FIG_1.end, joint.FIG_1.speed
    q, fastest = joint.FIG_1.stopping_speed
    around = np.concatenate([q, -q]), np.concatenate([fastest, -fastest])
    box = np.array([-Q, Q, Q, -Q, -Q]), np.array([-V, -V, V, V, -V])
    fine = np.linspace(-Q, Q, 2001)
    fast = np.sqrt(2.0 * A * (Q + fine))
    slow = fast <= V
    label = "reachable: full acceleration from the wall"
    curves = [
        Curve("feasible set F", *box, PALE, "area"),
        Curve("viable set V", *around, COLOURS[0], "area", fill="#D5E8F3"),
        Curve(label, fine[slow], fast[slow], dash=":"),
        Curve(f"{label}, below", -fine[slow], -fast[slow], dash=":", legend=""),
    ]
    title = f"Q = {Q:g} rad, V = {V:g} rad/s, A = {A:g} rad/s²"
    x = Axis("q_rad", "q [rad]", (-1.1 * Q, 1.1 * Q), 0.5)
    y = Axis("dq_rad_per_s", "dq [rad/s]", (-1.15 * V, 1.15 * V), 1.0)
    panel = Panel("", title, x, y, curves)
    return Figure("fig1", "Fig. 1: states of one joint that are viable", ((panel,),), (7.0, 5.0))


def outlines(found: joint.Regions, number: int) -> list[tuple[Array, Array]]:
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


def draw_regions(found: joint.Regions) -> Figure:
    """The regions in the plane of states."""
    curves = []
    for number, (name, colour) in STYLES.items():
        for count, outline in enumerate(outlines(found, number)):
            label = name if count == 0 else f"{name}, piece {count + 1}"
            legend = name if count == 0 else ""
            curves.append(Curve(label, *outline, colour, "area", legend=legend, fill=colour))
    Q, V, A, T = joint.FIG_3.end, joint.FIG_3.speed, joint.FIG_3.acceleration, joint.FIG_3.period_s
    title = f"Q = {Q:g} rad, V = {V:g} rad/s, A = {A:g} rad/s², δt = {T:g} s"
    q = Axis("q_rad", "q [rad]", (-1.02 * Q, 1.02 * Q), 0.1)
    dq = Axis("dq_rad_per_s", "dq [rad/s]", (-1.02 * V, 1.02 * V), 0.5)
    panel = Panel("", title, q, dq, curves)
    title = "Fig. 3: which upper bound of the acceleration is the least"
    return Figure("fig3", title, ((panel,),), (9.0, 5.2))


def draw_motions(runs: joint.Runs) -> Figure:
    """Position, velocity and acceleration; columns (a) to (d) as in the paper."""
    larger, large = {k: runs.proposed[k] for k in SHOWN_LARGER}, joint.TOO_LARGE
    columns = {
        "a": ("(a) naive, ×1", {1.0: runs.naive[1.0]}),
        "b": ("(b) naive, larger T_b", {k: runs.naive[k] for k in (*SHOWN_LARGER, large)}),
        "c": ("(c) proposed, ×1", {1.0: runs.proposed[1.0]}),
        "d": ("(d) proposed, larger T_b", {**larger, large: runs.shrunk}),
    }
    speed, most = joint.FIG_4.speed, joint.FIG_4.acceleration
    quantities: tuple[tuple[str, Axis, tuple[float, ...]], ...] = (
        ("q", Axis("q_rad", "q [rad]", (1.5, 2.25), 0.1), (joint.FIG_4.end,)),
        ("dq", Axis("dq_rad_per_s", "dq [rad/s]", (-2.3, 2.3), 1.0), (-speed, speed)),
        ("a", Axis("ddq_rad_per_s2", "ddq [rad/s²]", (-14.0, 14.0), 6.0), (-most, most)),
    )
    time = Axis("time_s", "time [s]", (0.0, joint.SHOWN_S), 0.5)
    end = round(joint.SHOWN_S / joint.FIG_4.period_s)
    rows = []
    for of, axis, limits in quantities:
        panels = []
        for column, (title, shown) in columns.items():
            curves = [level(f"limit {limit:g}", (0.0, joint.SHOWN_S), limit, ":", legend="limit")
                      for limit in limits]  # fmt: skip
            for periods, run in shown.items():
                x, values, name = run.time_s[:end], getattr(run, of)[:end], f"×{periods:g}"
                style: Literal["line", "steps"] = "steps" if of == "a" else "line"
                curves.append(Curve(name, x, values, BY_PERIODS[periods], style))
            name, above = f"{axis.name.partition('_')[0]}_{column}", title if of == "q" else ""
            panels.append(Panel(name, above, time, axis, curves))
        rows.append(panels)
    title = "Fig. 4: one joint to its limit; bounds for T_b = ×1 to ×20 of δt = 0.01 s"
    return Figure("fig4", title, rows, (15.0, 8.0))


ELBOW = {"×1": COLOURS[2], "×2": COLOURS[0], "×20": COLOURS[1]}


def draw_elbow(runs: elbow.Runs) -> Figure:
    """Columns as in the paper."""
    naive, proposed = (
        {f"×{k:g}": runs.ideal[kind, k] for k in periods} for kind, periods in elbow.SHOWN.items()
    )
    columns = {
        "naive": ("(a) naive ×2 and ×20", naive),
        "proposed": ("(b) proposed ×1, ×2 and ×20", proposed),
    }
    zero = {"legend": "limit; at rest", "dash": ":"}
    cells: tuple[tuple[Axis, str, float, list[Curve]], ...] = (
        (Axis("e1_minus_limit_rad", "e1 − its limit [rad]", (-0.06, 0.55), 0.1), "room", ELBOW_S,
         [level("limit", (0.0, ELBOW_S), 0.0, **zero)]),
        (Axis("dq_rad_per_s", "velocity of e1 [rad/s]", (-2.2, 1.3), 0.5), "dq", ELBOW_S,
         [level("at rest", (0.0, ELBOW_S), 0.0, **zero)]),
        (Axis("ddq_rad_per_s2", "acceleration of e1 [rad/s²]", (-36.0, 36.0), 10.0), "a", ELBOW_S,
         []),
        (Axis("log_norm", "|log(H⁻¹H_d)|", (1e-3, 3.0), log=True), "error", elbow.SECONDS, []),
    )  # fmt: skip
    rows: list[list[Panel]] = []
    for axis, of, end, curves in cells:
        time = Axis("time_s", "time [s]", (0.0, end))
        rows.append([])
        for name, (title, shown) in columns.items():
            panel = [*curves]
            for label, run in shown.items():
                part = slice(0, round(end / elbow.PERIOD_S))
                x, y = run.time_s[part], getattr(run, of)[part]
                panel.append(Curve(label, x, y, ELBOW[label], "steps" if of == "a" else "line"))
            above = title if of == "room" else ""
            rows[-1].append(Panel(f"{axis.name}_{name}", above, time, axis, panel))
    title = "Fig. 5: Baxter's elbow, the hand on its way to a pose"
    return Figure("fig5", title, rows, (10.0, 11.0))
