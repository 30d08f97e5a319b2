"""Figs. 2 to 11; α, of which the paper's Fig. 1 is a drawing, stands above Figs. 3 and 4."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from hoap3.robot_emulator.robots import load
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
    trace,
)
from hoap3.tools.reproduce.papers.ghc import runs

PAIRS = ((0, 1), (0, 2), (1, 2), (1, 1))
"""Shown; of each pair, the other is 1 − α, but where task 2 is removed."""

EVERY = 10  # ticks between two points that are drawn, of errors and joints
TIME = Axis("time_s", "time [s]", step=runs.PHASE_S)
ERROR = Axis("error", "error [m, rad]", (1e-7, 10.0), log=True)


def draw_all(done: runs.Runs) -> list[Figure]:
    """All of them."""
    return [
        errors("fig2", "Fig. 2: HQP", done.hqp),
        errors("fig3", "Fig. 3: GHC", done.fast, runs.FAST_S),
        errors("fig4", "Fig. 4: GHC", done.slow, runs.SLOW_S),
        draw_jerk(done.tabled),
        *draw_lemniscate(done.lemniscate),
        draw_pressing(done.pressing),
        draw_compromises(done.compromises),
    ]


def alpha_panel(name: str, over_s: float, run: runs.Run) -> Panel:
    """α of one run."""
    shown = {f"α_{i + 1}{j + 1}": (run.time_s, run.alpha[:, i, j]) for i, j in PAIRS}
    alpha, curves = Axis("alpha", "α [1]", (-0.05, 1.05)), lines(shown, ("-", "--", "-.", ":"))
    return Panel(name, f"transitions of {over_s:g} s", TIME, alpha, curves)


def errors(name: str, title: str, run: runs.Run, over_s: float | None = None) -> Figure:
    """Errors and joints of a run, below α where transitions take time."""
    joints = Axis("q_rad", "q [rad]"), joint_curves(run, run.q)
    panels = [error_panel("errors", run), Panel("joints", "positions of the joints", TIME, *joints)]
    if over_s is not None:
        panels.insert(0, alpha_panel("alpha", over_s, run))
    hierarchies = " ⇒ ".join(runs.PHASES[:-1])
    whole = f"{title}: {hierarchies} ⇒ 1 ▷ 2 ▷ 3"
    return column(name, whole, panels, (10.0, 3.0 * len(panels)))


def error_panel(name: str, run: runs.Run) -> Panel:
    """|e| of each task."""
    curves = lines({
        f"task {number}, {task}": _thin(run.time_s, run.errors[task])
        for number, task in enumerate(runs.TASKS, 1) if task in run.errors
    })  # fmt: skip
    return Panel(name, "errors of the tasks", TIME, ERROR, curves)


def joint_curves(run: runs.Run, values: Array) -> list[Curve]:
    """Values of the joints over time, (N, n), by the joints' names."""
    names = load(runs.ROBOT).joint_names
    return lines({name: _thin(run.time_s, values[:, i]) for i, name in enumerate(names)})


def draw_jerk(done: Mapping[str, runs.Run]) -> Figure:
    """Fig. 5."""
    curves = lines({name: _thin(run.time_s, run.jerk) for name, run in done.items()})
    axis = Axis("jerk_rad_per_s2", "∑ ∫|d³q/dt³| dt [rad/s²]", (1.0, 1e5), log=True)
    panel = Panel("", "of all joints, since the start", TIME, axis, curves)
    return column("fig5", "Fig. 5: integrated absolute jerk", [panel], (9.0, 4.5))


def _thin(x: Array, y: Array) -> tuple[Array, Array]:
    """Every tenth point."""
    return x[::EVERY], y[::EVERY]


def draw_lemniscate(run: runs.Run) -> list[Figure]:
    """Figs. 6 to 8."""
    above = [alpha_panel("alpha", runs.LEMNISCATE_S, run), error_panel("errors", run)]
    errors = column("fig7", "Fig. 7: the hand on a lemniscate", above, (10.0, 6.5))
    cells = (
        ("speeds", run.dq, Axis("dq_rad_per_s", "joint velocities [rad/s]"), runs.SPEED_MAX),
        ("torques", run.tau, Axis("tau_n_m", "joint torques [N m]"), runs.TORQUE_MAX),
    )
    panels = []
    for name, values, axis, most in cells:
        bounds = [
            level(f"{side} bound", run.time_s[[0, -1]], value, legend="bounds")
            for side, value in (("upper", most), ("lower", -most))
        ]
        panels.append(Panel(name, "", TIME, axis, [*joint_curves(run, values), *bounds]))
    title = "Fig. 8: speeds and torques within bounds"
    return [_path(run), errors, column("fig8", title, panels, (10.0, 6.5))]


def _path(run: runs.Run) -> Figure:
    """Fig. 6: the last round, while the hand is highest."""
    end = len(run.q) * run.period_s
    shown = run.rows(end - runs.PERIOD_S, end)
    theta = 2.0 * np.pi * run.time_s[shown] / runs.PERIOD_S
    x = runs.HALF_WIDTH_M * np.sin(theta) / (1.0 + np.cos(theta) ** 2)
    desired = runs.CENTER_M[0] + x, runs.CENTER_M[1] + x * np.cos(theta)
    path = runs.hand_path(run.q[shown][::EVERY])
    curves = [
        Curve("desired", *desired, dash="--"),
        Curve("of the hand", path[:, 0], path[:, 1], COLOURS[0]),
    ]
    x_m, y_m = Axis("x_m", "x [m]"), Axis("y_m", "y [m]")
    panel = Panel("", "one round of 2π s at 1 ▷ 2 ▷ 3", x_m, y_m, curves, square=True)
    return column("fig6", "Fig. 6: path of the hand", [panel], (8.0, 4.0))


def draw_pressing(run: runs.Run) -> Figure:
    """Fig. 10; Fig. 9, a photograph of the simulator, as height over the plane is in its place."""
    time = Axis("time_s", "time [s]")
    thin = run.time_s[::EVERY]
    pairs = {f"α_{i + 1}{j + 1}": (thin, run.alpha[::EVERY, i, j]) for i, j in ((0, 1), (1, 0))}
    off = {name: (thin, run.errors[name][::EVERY]) for name in (runs.HAND, runs.ELBOW)}
    force = [
        level("desired", run.time_s[[0, -1]], runs.FORCE_N),
        Curve("measured", run.time_s, run.force, COLOURS[0]),
    ]
    errors = "hand: all three directions until it touches, then only the horizontal ones"
    panels = [
        Panel("alpha", "", time, Axis("alpha", "α [1]", (-0.05, 1.05)), lines(pairs)),
        Panel("errors", errors, time, Axis("error_m", "error [m]", (1e-5, 1.0), log=True),
              lines(off)),
        Panel("force", "", time, Axis("force_n", "force on the plane [N]", (-0.5, 15.0)), force),
    ]  # fmt: skip
    title = "Figs. 9 and 10: 2 ▷ 1 ▷ 3 ⇒ 1 ▷ 2 ▷ 3, the hand comes down and presses"
    return column("fig10", title, panels, (10.0, 8.5))


def draw_compromises(by_alpha: Mapping[float, tuple[float, float]]) -> Figure:
    """Errors over α₁₂, and one over the other."""
    alphas = np.array(sorted(by_alpha))
    ours = np.array([by_alpha[alpha] for alpha in alphas.tolist()])
    shown = {name: (alphas, ours[:, i]) for i, name in enumerate((runs.HAND, runs.ELBOW))}
    alpha, error = Axis("alpha_12", "α₁₂ [1]"), Axis("error_m", "error [m]")
    over = Panel("alpha", "α₂₁ = 1 − α₁₂", alpha, error, lines(shown, marker="o"))
    hand, elbow = (Axis(f"{name}_m", f"error of the {name} [m]") for name in shown)
    curves = [trace("GHC, α₁₂ = 0 … 1", ours, COLOURS[2], marker="o")]
    tradeoff = Panel("tradeoff", "one over the other", hand, elbow, curves)
    title = "Fig. 11: hand and elbow without strict priority"
    return Figure("fig11", title, [[over, tradeoff]], (12.0, 4.5))
