"""The picture of Fig. 5: the elbow near its lower limit, and the hand's way to its pose."""

from __future__ import annotations

from collections.abc import Callable

from hoap3.tools.reproduce.figures import COLOURS, Array, Axis, Curve, Figure, Panel, level
from hoap3.tools.reproduce.papers.bounds.elbow import SECONDS, SHOWN, Run, Runs

SHOWN_S = 1.6
Values = Callable[[Run], Array]


def draw(runs: Runs) -> Figure:
    """Columns as in the paper, and one for what the emulator's filter makes of naive bounds."""
    ideal, emulated = runs.ideal, {"proposed ×2, torques": runs.torques}
    emulated["naive ×2, filtered"] = runs.filtered
    naive, proposed = (
        {f"×{k:g}": ideal[kind, k] for k in periods} for kind, periods in SHOWN.items()
    )
    columns = {
        "naive": ("(a) naive ×2 and ×20", naive),
        "proposed": ("(b) proposed ×1, ×2 and ×20", proposed),
        "emulator": ("through the emulator, at 1 kHz", emulated),
    }
    cells: tuple[tuple[Axis, Values, float], ...] = (
        (Axis("e1_minus_limit_rad", "e1 − its limit [rad]", (-0.06, 0.55), 0.1),
         lambda run: run.room, SHOWN_S),
        (Axis("dq_rad_per_s", "velocity of e1 [rad/s]", (-2.2, 1.3), 0.5),
         lambda run: run.dq, SHOWN_S),
        (Axis("ddq_rad_per_s2", "acceleration of e1 [rad/s²]", (-36.0, 36.0), 10.0),
         lambda run: run.a, SHOWN_S),
        (Axis("log_norm", "|log(H⁻¹H_d)|", (1e-3, 3.0), log=True),
         lambda run: run.error, SECONDS),
    )  # fmt: skip
    rows = tuple(
        tuple(_panel(f"{axis.name}_{name}", title if row == 0 else "", shown, axis, values, end,
                     zero=row < 2)
              for name, (title, shown) in columns.items())
        for row, (axis, values, end) in enumerate(cells)
    )  # fmt: skip
    title = "Fig. 5: Baxter's elbow, the hand on its way to a pose"
    return Figure("fig5", title, rows, (14.0, 11.0))


COLOUR = {
    "×1": COLOURS[2],
    "×2": COLOURS[0],
    "×20": COLOURS[1],
    "proposed ×2, torques": COLOURS[3],
    "naive ×2, filtered": COLOURS[4],
}


def _panel(
    name: str, title: str, shown: dict[str, Run], y: Axis, values: Values, end: float, *, zero: bool
) -> Panel:
    label = "limit" if y.name.startswith("e1") else "at rest"
    curves = [level(label, (0.0, end), 0.0, ":", legend="limit; at rest")] if zero else []
    steps = y.name.startswith("ddq")
    for label, run in shown.items():
        part = slice(0, round(end / run.period_s))
        x, values_shown = run.time_s[part], values(run)[part]
        curves.append(Curve(label, x, values_shown, COLOUR[label], "steps" if steps else "line"))
    return Panel(name, title, Axis("time_s", "time [s]", (0.0, end)), y, curves)
