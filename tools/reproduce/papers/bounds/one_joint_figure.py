"""The picture of Fig. 4: position, velocity and acceleration, four ways to bound the latter."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from hoap3.tools.reproduce.figures import COLOURS, INK, Array, Axis, Curve, Figure, Panel
from hoap3.tools.reproduce.papers.bounds.joint import FIG_4
from hoap3.tools.reproduce.papers.bounds.one_joint import SHOWN_S, TOO_LARGE, Run, Runs

COLOUR = dict(zip((1.0, 2.0, 3.0, 5.0, 10.0, TOO_LARGE), COLOURS, strict=False))
"""By T_b/δt."""

SHOWN_NAIVE, SHOWN_PROPOSED = (2.0, 3.0, 5.0, 10.0), (2.0, 3.0, 5.0, 10.0)


def draw(runs: Runs) -> Figure:
    """Columns (a) to (d) as in the paper."""
    columns = {
        "a": ("(a) naive, ×1", {1.0: runs.naive[1.0]}),
        "b": ("(b) naive, larger T_b", {k: runs.naive[k] for k in (*SHOWN_NAIVE, TOO_LARGE)}),
        "c": ("(c) proposed, ×1", {1.0: runs.proposed[1.0]}),
        "d": ("(d) proposed, larger T_b", {
            **{k: runs.proposed[k] for k in SHOWN_PROPOSED}, TOO_LARGE: runs.shrunk}),
    }  # fmt: skip
    rows = (
        tuple(_panel(f"q_{name}", title, shown, lambda run: run.q, _POSITION, (FIG_4.end,))
              for name, (title, shown) in columns.items()),
        tuple(_panel(f"dq_{name}", "", shown, lambda run: run.dq, _VELOCITY,
                     (-FIG_4.speed, FIG_4.speed))
              for name, (title, shown) in columns.items()),
        tuple(_panel(f"ddq_{name}", "", shown, lambda run: run.a, _ACCELERATION,
                     (-FIG_4.acceleration, FIG_4.acceleration), steps=True)
              for name, (title, shown) in columns.items()),
    )  # fmt: skip
    title = "Fig. 4: one joint to its limit; bounds for T_b = ×1 to ×20 of δt = 0.01 s"
    return Figure("fig4", title, rows, (15.0, 8.0))


_POSITION = Axis("q_rad", "q [rad]", (1.5, 2.25), 0.1)
_VELOCITY = Axis("dq_rad_per_s", "dq [rad/s]", (-2.3, 2.3), 1.0)
_ACCELERATION = Axis("ddq_rad_per_s2", "ddq [rad/s²]", (-14.0, 14.0), 6.0)


def _panel(
    name: str,
    title: str,
    shown: Mapping[float, Run],
    values: Callable[[Run], Array],
    y: Axis,
    limits: tuple[float, ...],
    *,
    steps: bool = False,
) -> Panel:
    curves = [
        Curve(f"limit {limit:g}", np.array([0.0, SHOWN_S]), np.full(2, limit), INK, dash=":",
              legend="limit")
        for limit in limits
    ]  # fmt: skip
    for periods, run in shown.items():
        end = round(SHOWN_S / run.joint.period_s)
        curves.append(
            Curve(
                f"×{periods:g}",
                run.time_s[:end],
                values(run)[:end],
                COLOUR[periods],
                "steps" if steps else "line",
            )
        )
    return Panel(name, title, Axis("time_s", "time [s]", (0.0, SHOWN_S), 0.5), y, tuple(curves))
