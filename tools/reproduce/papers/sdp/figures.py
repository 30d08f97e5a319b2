"""Figs. 1 to 7."""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping

import numpy as np

from hoap3.tools.reproduce.figures import Array, Axis, Figure, Panel, column, level, lines
from hoap3.tools.reproduce.papers.sdp import runs as ref
from hoap3.tools.reproduce.papers.sdp.runs import SECONDS, Run, Runs

TIME = Axis("time_s", "time [s]", (0.0, SECONDS), step=0.5)
DASHES = ("-", "--", ":", "-.", "-", "--")
LOW, HIGH = (9.0, 4.0), (9.0, 6.5)  # inch
WRIST = operator.attrgetter("wrist")


def draw_all(runs: Runs) -> list[Figure]:
    """All of them, and some also on a logarithmic scale."""
    slow, fast = f"β̃ = {ref.SLOW:g}", f"β̃ = {ref.FAST:g}"
    three = {"constant gains": runs.constant, slow: runs.slow, fast: runs.fast}
    limits = {
        f"{ref.LOW_LIMIT_RAD_S:g} rad/s": runs.limited,
        f"{ref.LIMIT_RAD_S:g} rad/s": runs.fast,
    }
    by_dt = {f"Δt = {dt:g} s": run for dt, run in runs.periods.items()}
    v, gain = ("v_m2", "V = ½|e|² [m²]"), "gain_per_s"
    first, second = ("error_m", "|e₁| [m]"), ("error_m", "|e₂| [m]")
    above, below = "as in the paper", "on a logarithmic scale"
    return [
        column("fig1", "Fig. 1: V with constant and scheduled gains", [
            _panel("", above, three, lambda run: run.v, Axis(*v, (0.0, 0.5))),
            _panel("log", below, three, lambda run: run.v, Axis(*v, (1e-11, 1.0), log=True)),
        ], HIGH),
        column("fig2", "Fig. 2: errors of the tasks", [
            _panel("hand", "(a) the hand's place", three,
                   lambda run: np.linalg.norm(run.errors[:, :3], axis=1), Axis(*first, (0.0, 1.0))),
            _panel("wrist", "(b) the wrist's y", three, WRIST, Axis(*second, (0.0, 0.1))),
        ], HIGH),
        column("fig3", "Fig. 3: gain of the wrist's y", [
            _panel("", "", three, lambda run: run.gains[:, 3],
                   Axis(gain, "λ₄ [1/s]", (0.0, 600.0))),
        ], LOW),
        _speeds(runs.fast),
        column("fig5", f"Fig. 5: β for two limits, {fast}", [
            _panel("", "", limits, lambda run: run.beta,
                   Axis("beta_per_s", "β [1/s]", (0.0, 9.0))),
        ], LOW),
        column("fig6", "Fig. 6: gain of the hand's x for other periods", [
            _panel("", "", by_dt, lambda run: run.gains[:, 0], Axis(gain, "λ₁ [1/s]", (0.0, 8.0))),
        ], LOW),
        column("fig7", "Fig. 7: error of the wrist's y for other periods", [
            _panel("", above, by_dt, WRIST, Axis(*second, (0.0, 0.1))),
            _panel("log", below, by_dt, WRIST, Axis(*second, (1e-7, 1.0), log=True)),
        ], HIGH),
    ]  # fmt: skip


def _panel(
    name: str, title: str, runs: Mapping[str, Run], of: Callable[[Run], Array], axis: Axis
) -> Panel:
    """A quantity of some runs, (N,) each."""
    shown = {label: (run.time_s, of(run)) for label, run in runs.items()}
    return Panel(name, title, TIME, axis, lines(shown, DASHES))


def _speeds(run: Run) -> Figure:
    """Fig. 4."""
    joints = {f"joint {i + 1}": (run.time_s, dq) for i, dq in enumerate(run.dq.T)}
    curves = lines(joints, DASHES, style="steps") + [
        level(f"{side} limit", run.time_s[[0, -1]], sign * ref.LIMIT_RAD_S, legend="limits")
        for side, sign in (("upper", 1.0), ("lower", -1.0))
    ]
    panel = Panel("", "", TIME, Axis("dq_rad_per_s", "joint speeds [rad/s]", (-7.0, 7.0)), curves)
    title = f"Fig. 4: joint speeds within ±{ref.LIMIT_RAD_S:g} rad/s, β̃ = {ref.FAST:g}"
    return column("fig4", title, [panel], LOW)
