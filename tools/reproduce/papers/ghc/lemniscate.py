"""Figs. 6 to 8: the hand on a lemniscate, within narrow bounds of speeds and torques.

The paper prints the period, 2π s, the gains and both bounds. Ours are amplitude, centre and plane.
Bounds of accelerations are those that keep a joint able to keep its speed for ten periods.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hoap3.robot_emulator.robots import load
from hoap3.tools.report.motion import point_path
from hoap3.tools.reproduce.figures import COLOURS, Array, Axis, Curve, Figure, Panel, column, level
from hoap3.tools.reproduce.papers.ghc import alphas
from hoap3.tools.reproduce.papers.ghc import reference as ref
from hoap3.tools.reproduce.papers.ghc.errors_figure import EVERY, TIME, error_panel, joint_curves
from hoap3.tools.reproduce.papers.ghc.runs import (
    ROBOT,
    Run,
    position,
    switching,
    three_tasks,
)
from hoap3.tools.reproduce.rows import Row, bounded, measured

HALF_WIDTH_M, CENTER_M = 0.10, (-0.45, 0.15, 0.75)
PERIOD_S = 2.0 * math.pi
OVER_S = 2.0
APPROACH_S = 1.0
ALONE_S, ALONE_APPROACH_S = 14.0, 5.0
SETTLED_S = 2.0  # at the end, within which errors are looked at
TRACKED_M = 2e-3
ROUNDING = 1e-6
AT_BOUND = 1e-9
BOUNDS: dict[str, Any] = {
    "kind": "viability",
    "horizon_periods": 10.0,
    "acceleration_max": [100.0],
    "speed_max": [ref.SPEED_MAX],
    "torque_max": [ref.TORQUE_MAX],
    "speed_share": 1.0,
    "acceleration_share": 1.0,
    "brake_share": 1.0,
    "margin_rad": 0.0,
}


def track(
    w_r: float,
    seconds: float = ref.PHASE_S * len(ref.PHASES),
    approach_s: float = APPROACH_S,
    **parameters: Any,
) -> Run:
    """One run; `parameters` are added to those, or replace them."""
    target = {
        "kind": "lemniscate",
        "half_width_m": HALF_WIDTH_M,
        "center_m": list(CENTER_M),
        "plane": "xy",
        "period_s": PERIOD_S,
        "approach_s": approach_s,
    }
    tasks = three_tasks(position(ref.HAND, target, ref.TRACKING))
    given = {"tasks": tasks, "w_r": w_r, "bounds": BOUNDS, **parameters}
    return switching("ghc", OVER_S, seconds, **given)


def track_alone(w_r: float, seconds: float = ALONE_S) -> Run:
    """Only 1 ▷ 3, where nothing contradicts the hand."""
    order = {"order": [ref.HAND, ref.POSTURE, ref.ELBOW], "inactive": [ref.ELBOW]}
    return track(w_r, seconds, ALONE_APPROACH_S, priorities=order)


def run_all(say: Callable[[str], None] = lambda _: None) -> tuple[Run, dict[float, Run]]:
    """All hierarchies at the paper's ω_r, and 1 ▷ 3 at that and at less."""
    say("Figs. 6 to 8: the lemniscate")
    return track(ref.W_R), {w_r: track_alone(w_r) for w_r in ref.LEMNISCATE}


def rows(run: Run) -> list[Row]:
    """Bounds, and how well the highest task does, of all hierarchies that a run has."""
    made = [
        *_bounds("Fig. 8: ", run),
        bounded(f"Fig. 8: ticks at a bound, of {len(run.q)}", None, float(at_bounds(run).sum()),
                (1.0, None), "The bounds do hold something back; the paper's curve shows it, too"),
    ]  # fmt: skip
    for phase, task in ((1, ref.HAND), (2, ref.ELBOW), (3, ref.HAND), (4, ref.HAND)):
        end = (phase + 1) * ref.PHASE_S
        if len(run.q) >= run.rows(0.0, end).stop:
            item = f"Fig. 7: {ref.PHASES[phase]}, greatest error of the {task}"
            ours = float(run.errors[task][run.rows(end - SETTLED_S, end)].max())
            made.append(bounded(item, "precisely", ours, (None, TRACKED_M), _TRACKED, unit="m"))
    return made


def rows_alone(runs: Mapping[float, Run]) -> list[Row]:
    """The hand's error by ω_r."""
    errors = {
        w_r: float(run.errors[ref.HAND][-round(SETTLED_S / run.period_s) :].max())
        for w_r, run in runs.items()
    }
    made = [
        measured(f"Fig. 7: 1 ▷ 3 alone, ω_r = {w_r:g}, greatest error of the hand", None, error,
                 _LESS, unit="m")
        for w_r, error in errors.items()
    ]  # fmt: skip
    item = "Fig. 7: 1 ▷ 3 alone, error of the hand, greatest / least ω_r"
    ratio = errors[max(errors)] / errors[min(errors)]
    return [*made, bounded(item, None, ratio, (1.0, None), _LESS)]


def _bounds(item: str, run: Run) -> list[Row]:
    return [
        bounded(f"{item}greatest |dq|", f"at most {ref.SPEED_MAX:g}", float(np.abs(run.dq).max()),
                (None, ref.SPEED_MAX + ROUNDING), _EXACT, unit="rad/s"),
        bounded(f"{item}greatest |τ|", f"at most {ref.TORQUE_MAX:g}", float(np.abs(run.tau).max()),
                (None, ref.TORQUE_MAX + ROUNDING), _EXACT, unit="N m"),
        bounded(f"{item}ticks without an answer", None, run.fallbacks, (0.0, 0.0), _ANSWER),
    ]  # fmt: skip


def at_bounds(run: Run) -> NDArray[np.bool_]:
    """Ticks at which some speed or torque is at its bound, (N,)."""
    speeds = np.abs(run.dq) >= ref.SPEED_MAX * (1.0 - AT_BOUND)
    torques = np.abs(run.tau) >= ref.TORQUE_MAX * (1.0 - AT_BOUND)
    return np.asarray((speeds | torques).any(axis=1))


def draw(run: Run) -> list[Figure]:
    """Figs. 6 to 8."""
    above = [alphas.panel("alpha", OVER_S, run), error_panel("errors", run)]
    errors = column("fig7", "Fig. 7: the hand on a lemniscate", above, (10.0, 6.5))
    cells = (
        ("speeds", run.dq, Axis("dq_rad_per_s", "joint velocities [rad/s]"), ref.SPEED_MAX),
        ("torques", run.tau, Axis("tau_n_m", "joint torques [N m]"), ref.TORQUE_MAX),
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


def _path(run: Run) -> Figure:
    """Fig. 6: the last round, while the hand is highest."""
    end = len(run.q) * run.period_s
    shown = run.rows(end - PERIOD_S, end)
    theta = 2.0 * np.pi * run.time_s[shown] / PERIOD_S
    x = HALF_WIDTH_M * np.sin(theta) / (1.0 + np.cos(theta) ** 2)
    desired = CENTER_M[0] + x, CENTER_M[1] + x * np.cos(theta)
    path = hand_path(run.q[shown][::EVERY])
    curves = [
        Curve("desired", *desired, dash="--"),
        Curve("of the hand", path[:, 0], path[:, 1], COLOURS[0]),
    ]
    x_m, y_m = Axis("x_m", "x [m]"), Axis("y_m", "y [m]")
    panel = Panel("", "one round of 2π s at 1 ▷ 2 ▷ 3", x_m, y_m, curves, square=True)
    return column("fig6", "Fig. 6: path of the hand", [panel], (8.0, 4.0))


def hand_path(q: Array) -> Array:
    """Where the hand is, (N, 3) [m], for positions of the joints, (N, n)."""
    return point_path(np.ascontiguousarray(q), load(ROBOT), "ee", "base")


_EXACT = "As the paper: the bounds are kept"
_ANSWER = (
    "The paper does not say what it does without an answer. With bounds for a single period, or "
    "transitions of 0.5 s, there are ticks without one"
)
_TRACKED = (
    "As the paper, precisely, or for the elbow where it should be; it prints a curve. How far off "
    "depends on ω_r and on the lemniscate, whose size and place are not printed: ours is 0.10 m"
)
_LESS = (
    "Not in the paper: what the hand is off is due to ω_r|τ|², and then to steps of 1 ms. Where "
    "the elbow contradicts it, a lower ω_r sets the posture swinging at the bound of the speed, "
    "which then costs the hand more"
)
