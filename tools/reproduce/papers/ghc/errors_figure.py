"""The pictures of Figs. 2 to 5: errors, joints and jerk of each strategy."""

from __future__ import annotations

from collections.abc import Mapping

from hoap3.robot_emulator.robots import load
from hoap3.tools.reproduce.figures import Array, Axis, Curve, Figure, Panel, column, lines
from hoap3.tools.reproduce.papers.ghc import alphas
from hoap3.tools.reproduce.papers.ghc import reference as ref
from hoap3.tools.reproduce.papers.ghc.runs import ROBOT, Run

EVERY = 10  # ticks between two points that are drawn, of errors and joints
TIME = Axis("time_s", "time [s]", step=ref.PHASE_S)
ERROR = Axis("error", "error [m, rad]", (1e-7, 10.0), log=True)


def errors(name: str, title: str, run: Run, over_s: float | None = None) -> Figure:
    """Errors and joints of a run, below α where transitions take time."""
    panels = [error_panel("errors", run), joint_panel("joints", run)]
    if over_s is not None:
        panels.insert(0, alphas.panel("alpha", over_s, run))
    hierarchies = " ⇒ ".join(ref.PHASES[: len(ref.PHASES) - 1])
    whole = f"{title}: {hierarchies} ⇒ 1 ▷ 2 ▷ 3"
    return column(name, whole, panels, (10.0, 3.0 * len(panels)))


def error_panel(name: str, run: Run) -> Panel:
    """|e| of each task."""
    curves = lines({
        f"task {number}, {task}": _thin(run.time_s, run.errors[task])
        for number, task in enumerate(ref.TASKS, 1) if task in run.errors
    })  # fmt: skip
    return Panel(name, "errors of the tasks", TIME, ERROR, curves)


def joint_panel(name: str, run: Run) -> Panel:
    """Positions of the joints."""
    curves = joint_curves(run, run.q)
    return Panel(name, "positions of the joints", TIME, Axis("q_rad", "q [rad]"), curves)


def joint_curves(run: Run, values: Array) -> list[Curve]:
    """Values of the joints over time, (N, n), by the joints' names."""
    names = load(ROBOT).joint_names
    return lines({name: _thin(run.time_s, values[:, i]) for i, name in enumerate(names)})


def jerk(runs: Mapping[str, Run]) -> Figure:
    """Fig. 5."""
    curves = lines({name: _thin(run.time_s, run.jerk) for name, run in runs.items()})
    axis = Axis("jerk_rad_per_s2", "∑ ∫|d³q/dt³| dt [rad/s²]", (1.0, 1e5), log=True)
    panel = Panel("", "of all joints, since the start", TIME, axis, curves)
    return column("fig5", "Fig. 5: integrated absolute jerk", [panel], (9.0, 4.5))


def _thin(x: Array, y: Array) -> tuple[Array, Array]:
    """Every tenth point."""
    return x[::EVERY], y[::EVERY]
