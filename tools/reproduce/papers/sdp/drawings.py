"""Figs. 1 to 7, and the certificate beside what it is a certificate of."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import numpy as np

from hoap3.tools.reproduce.figures import (
    COLOURS,
    Array,
    Axis,
    Curve,
    Figure,
    Panel,
    column,
    level,
    lines,
)
from hoap3.tools.reproduce.papers.sdp import reference as ref
from hoap3.tools.reproduce.papers.sdp.loop import SECONDS, Run
from hoap3.tools.reproduce.papers.sdp.runs import Runs

TIME = Axis("time_s", "time [s]", (0.0, SECONDS), step=0.5)
DASHES = ("-", "--", ":", "-.", "-", "--")
Quantity = Literal["v", "first", "second", "gain_1", "gain_4", "beta"]


def draw_all(runs: Runs) -> list[Figure]:
    """All of them."""
    three = {
        "constant gains": runs.constant,
        f"β̃ = {ref.SLOW:g}": runs.slow,
        f"β̃ = {ref.FAST:g}": runs.fast,
    }
    limits = {
        f"{ref.LOW_LIMIT_RAD_S:g} rad/s": runs.limited,
        f"{ref.LIMIT_RAD_S:g} rad/s": runs.fast,
    }
    by_dt = {f"Δt = {dt:g} s": run for dt, run in runs.periods.items()}
    v = "V = ½|e|² [m²]"
    return [
        _two("fig1", "Fig. 1: V with constant and scheduled gains", three, "v",
             Axis("v_m2", v, (0.0, 0.5)), Axis("v_m2", v, (1e-11, 1.0), log=True)),
        Figure("fig2", "Fig. 2: errors of the tasks",
               ((_panel("hand", "(a) the hand's place", three, "first",
                        Axis("error_m", "|e₁| [m]", (0.0, 1.0))),),
                (_panel("wrist", "(b) the wrist's y", three, "second",
                        Axis("error_m", "|e₂| [m]", (0.0, 0.1))),)), (9.0, 6.5)),
        _one("fig3", "Fig. 3: gain of the wrist's y", three, "gain_4",
             Axis("gain_per_s", "λ₄ [1/s]", (0.0, 600.0))),
        _speeds(runs.fast),
        _one("fig5", f"Fig. 5: β for two limits, β̃ = {ref.FAST:g}", limits, "beta",
             Axis("beta_per_s", "β [1/s]", (0.0, 9.0))),
        _one("fig6", "Fig. 6: gain of the hand's x for other periods", by_dt, "gain_1",
             Axis("gain_per_s", "λ₁ [1/s]", (0.0, 8.0))),
        _two("fig7", "Fig. 7: error of the wrist's y for other periods", by_dt, "second",
             Axis("error_m", "|e₂| [m]", (0.0, 0.1)),
             Axis("error_m", "|e₂| [m]", (1e-7, 1.0), log=True)),
        _rates({dt: runs.periods[dt] for dt in (0.1, ref.DT_S)}),
    ]  # fmt: skip


def values(run: Run, quantity: Quantity) -> Array:
    """What a panel shows, (N,)."""
    e = run.errors
    found: dict[Quantity, Array] = {
        "v": run.v,
        "first": np.linalg.norm(e[:, :3], axis=1),
        "second": np.abs(e[:, 3]),
        "gain_1": run.gains[:, 0],
        "gain_4": run.gains[:, 3],
        "beta": run.beta,
    }
    return found[quantity]


def _panel(name: str, title: str, runs: Mapping[str, Run], of: Quantity, axis: Axis) -> Panel:
    """A quantity of some runs."""
    shown = {label: (run.time_s, values(run, of)) for label, run in runs.items()}
    curves = lines(shown, DASHES)
    return Panel(name, title, TIME, axis, curves)


def _one(name: str, title: str, runs: Mapping[str, Run], of: Quantity, axis: Axis) -> Figure:
    return column(name, title, [_panel("", "", runs, of, axis)], (9.0, 4.0))


def _two(
    name: str, title: str, runs: Mapping[str, Run], of: Quantity, linear: Axis, log: Axis
) -> Figure:
    """As the paper has it, and on a logarithmic scale."""
    above = _panel("", "as in the paper", runs, of, linear)
    below = _panel("log", "on a logarithmic scale", runs, of, log)
    return column(name, title, [above, below], (9.0, 6.5))


def _speeds(run: Run) -> Figure:
    """Fig. 4."""
    joints = {f"joint {i + 1}": (run.time_s, dq) for i, dq in enumerate(run.dq.T)}
    curves = lines(joints, DASHES, style="steps") + [
        level(f"{side} limit", run.time_s[[0, -1]], sign * ref.LIMIT_RAD_S, legend="limits")
        for side, sign in (("upper", 1.0), ("lower", -1.0))
    ]
    axis = Axis("dq_rad_per_s", "joint speeds [rad/s]", (-7.0, 7.0))
    panel = Panel("", "", TIME, axis, curves)
    title = f"Fig. 4: joint speeds within ±{ref.LIMIT_RAD_S:g} rad/s, β̃ = {ref.FAST:g}"
    return column("fig4", title, [panel], (9.0, 4.0))


def _rates(runs: Mapping[float, Run]) -> Figure:
    """What is certified, and what V does."""
    panels = []
    for dt, run in runs.items():
        curves = (
            Curve("β, certified", run.time_s, run.beta, COLOURS[0], "steps"),
            Curve("(1 − V⁺/V)/Δt, in fact", run.time_s[:-1], run.actual, COLOURS[1], "steps"),
        )
        axis = Axis("rate_per_s", "rate [1/s]", (0.0, 16.0))
        panels.append(Panel(f"{dt:g}s", f"Δt = {dt:g} s", TIME, axis, curves))
    title = f"Certified and real rate of V, β̃ = {ref.FAST:g}"
    return column("rates", title, panels, (9.0, 6.5))
