"""The picture of Fig. 4: position, velocity and acceleration, four ways to bound the latter."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from hoap3.tools.reproduce.figures import COLOURS, Axis, Curve, Figure, Panel, level
from hoap3.tools.reproduce.papers.bounds.joint import FIG_4
from hoap3.tools.reproduce.papers.bounds.one_joint import SHOWN_S, TOO_LARGE, Run, Runs

COLOUR = dict(zip((1.0, 2.0, 3.0, 5.0, 10.0, TOO_LARGE), COLOURS, strict=False))
"""By T_b/δt."""

SHOWN_LARGER = (2.0, 3.0, 5.0, 10.0)


def draw(runs: Runs) -> Figure:
    """Columns (a) to (d) as in the paper."""
    columns = {
        "a": ("(a) naive, ×1", {1.0: runs.naive[1.0]}),
        "b": ("(b) naive, larger T_b", {k: runs.naive[k] for k in (*SHOWN_LARGER, TOO_LARGE)}),
        "c": ("(c) proposed, ×1", {1.0: runs.proposed[1.0]}),
        "d": ("(d) proposed, larger T_b", {
            **{k: runs.proposed[k] for k in SHOWN_LARGER}, TOO_LARGE: runs.shrunk}),
    }  # fmt: skip
    quantities: tuple[tuple[str, Axis, tuple[float, ...]], ...] = (
        ("q", Axis("q_rad", "q [rad]", (1.5, 2.25), 0.1), (FIG_4.end,)),
        ("dq", Axis("dq_rad_per_s", "dq [rad/s]", (-2.3, 2.3), 1.0), (-FIG_4.speed, FIG_4.speed)),
        ("a", Axis("ddq_rad_per_s2", "ddq [rad/s²]", (-14.0, 14.0), 6.0),
         (-FIG_4.acceleration, FIG_4.acceleration)),
    )  # fmt: skip
    rows = [
        [
            _panel(name, title if of == "q" else "", shown, of, axis, limits)
            for name, (title, shown) in columns.items()
        ]
        for of, axis, limits in quantities
    ]
    title = "Fig. 4: one joint to its limit; bounds for T_b = ×1 to ×20 of δt = 0.01 s"
    return Figure("fig4", title, rows, (15.0, 8.0))


def _panel(
    column: str,
    title: str,
    shown: Mapping[float, Run],
    of: str,
    y: Axis,
    limits: tuple[float, ...],
) -> Panel:
    curves = [
        level(f"limit {limit:g}", (0.0, SHOWN_S), limit, ":", legend="limit") for limit in limits
    ]
    for periods, run in shown.items():
        end = round(SHOWN_S / run.joint.period_s)
        x, values = run.time_s[:end], getattr(run, of)[:end]
        curve = Curve(f"×{periods:g}", x, values, COLOUR[periods])
        curves.append(replace(curve, style="steps") if of == "a" else curve)
    name = f"{y.name.partition('_')[0]}_{column}"
    return Panel(name, title, Axis("time_s", "time [s]", (0.0, SHOWN_S), 0.5), y, curves)
