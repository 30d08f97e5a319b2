"""The pictures of Figs. 2 to 5: errors, joints and jerk of each strategy."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from hoap3.robot_emulator.robots import load
from hoap3.tools.reproduce.figures import COLOURS, Array, Axis, Curve, Figure, Panel
from hoap3.tools.reproduce.papers.ghc import alphas
from hoap3.tools.reproduce.papers.ghc.reference import PHASES, TASKS
from hoap3.tools.reproduce.papers.ghc.runs import PHASE_S, ROBOT, Run

EVERY = 10  # ticks between two points that are drawn, of errors and joints
TIME = Axis("time_s", "time [s]", step=PHASE_S)
ERROR = Axis("error", "error [m, rad]", (1e-7, 10.0), log=True)


def errors(name: str, title: str, run: Run, over_s: float | None = None) -> Figure:
    """Errors and joints of a run, below α where transitions take time."""
    panels = [error_panel("errors", run), joint_panel("joints", run)]
    if over_s is not None:
        panels.insert(0, alphas.panel("alpha", over_s, run))
    hierarchies = " ⇒ ".join(PHASES[: len(PHASES) - 1])
    whole = f"{title}: {hierarchies} ⇒ 1 ▷ 2 ▷ 3"
    return Figure(name, whole, tuple((each,) for each in panels), (10.0, 3.0 * len(panels)))


def error_panel(name: str, run: Run) -> Panel:
    """|e| of each task."""
    curves = tuple(
        Curve(f"task {number}, {task}", *_thin(run.time_s, run.errors[task]), colour)
        for number, (task, colour) in enumerate(zip(TASKS, COLOURS, strict=False), 1)
        if task in run.errors
    )
    return Panel(name, "errors of the tasks", TIME, ERROR, curves)


def joint_panel(name: str, run: Run) -> Panel:
    """Positions of the joints."""
    curves = tuple(
        Curve(joint, *_thin(run.time_s, run.q[:, i]), colour)
        for i, (joint, colour) in enumerate(zip(load(ROBOT).joint_names, COLOURS, strict=True))
    )
    return Panel(name, "positions of the joints", TIME, Axis("q_rad", "q [rad]"), curves)


def jerk(runs: Mapping[str, Run]) -> Figure:
    """Fig. 5."""
    curves = tuple(
        Curve(name, *_thin(run.time_s, run.jerk), colour)
        for (name, run), colour in zip(runs.items(), COLOURS, strict=False)
    )
    panel = Panel(
        "",
        "of all joints, since the start",
        TIME,
        Axis("jerk_rad_per_s2", "∑ ∫|d³q/dt³| dt [rad/s²]", (1.0, 1e5), log=True),
        curves,
    )
    return Figure("fig5", "Fig. 5: integrated absolute jerk", ((panel,),), (9.0, 4.5))


def _thin(x: Array, y: Array) -> tuple[Array, Array]:
    """Every tenth point."""
    return np.ascontiguousarray(x[::EVERY]), np.ascontiguousarray(y[::EVERY])
