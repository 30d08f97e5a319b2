"""Figs. 9 and 10: the hand comes down on a plane, and presses.

The paper prints no place, no force and no law of contact. Ours: the shipped config `ghc_force` on
`lwr_with_table`, K = 2·10⁴ N/m, with an elbow target that keeps the hand above the plane until
priorities change. The measured wrench is in the equation of motion, and task 1a, the horizontal
position, and 1b, the force, are one task of three rows.
"""

from __future__ import annotations

import copy
from collections.abc import Callable

import numpy as np

from hoap3.remote_controller.config import read_config
from hoap3.tools.reproduce.figures import COLOURS, Axis, Curve, Figure, Panel, column, level, lines
from hoap3.tools.reproduce.papers.ghc.reference import ELBOW, FORCE_N, HAND, POSTURE
from hoap3.tools.reproduce.papers.ghc.runs import Run, run_of
from hoap3.tools.reproduce.rows import Row, bounded, measured, near
from hoap3.tools.simulate import simulate

SWITCH_S, OVER_S, SECONDS = 2.0, 1.0, 10.0
SETTLED_S = 2.0
ELBOW_TARGET_M = (0.0684, -0.1368, 0.68)
FORCE_SHARE = 0.005
HORIZONTAL_M = 1e-3
TOUCH_N = 0.5
EVERY = 10


def press(
    seconds: float = SECONDS, switch_s: float = SWITCH_S, say: Callable[[str], None] | None = None
) -> Run:
    """2 ▷ 1 ▷ 3 ⇒ 1 ▷ 2 ▷ 3."""
    if say:
        say("Figs. 9 and 10: pressing on a plane")
    content, _ = read_config("ghc_force")
    config = copy.deepcopy(content)
    tasks = {task["name"]: task["parameters"] for task in config["parameters"]["tasks"]}
    tasks[HAND]["force_n"] = FORCE_N
    tasks[ELBOW]["target"]["position_m"] = list(ELBOW_TARGET_M)
    change = {"at_s": switch_s, "order": [HAND, ELBOW, POSTURE], "over_s": OVER_S}
    start = {"order": [ELBOW, HAND, POSTURE], "timeline": [change]}
    config["parameters"]["priorities"] = start
    return run_of(simulate("lwr_with_table", config, seconds))


def touch_s(run: Run) -> float:
    """When it first touches [s]; NaN where it does not."""
    touching = np.flatnonzero(run.force >= TOUCH_N)
    return float(run.time_s[touching[0]]) if touching.size else float("nan")


def rows(run: Run, switch_s: float = SWITCH_S) -> list[Row]:
    """Force, place, and what happens at the impact."""
    end = slice(run.rows(0.0, len(run.q) * run.period_s - SETTLED_S).stop, None)
    off = float(np.abs(run.force[end] - FORCE_N).max())
    first = touch_s(run)
    outside = np.flatnonzero(np.abs(run.force - FORCE_N) > FORCE_SHARE * FORCE_N)
    peak = float(run.force.max())
    return [
        near("Fig. 10: force on the plane in the end", "follows its reference",
             float(run.force[end].mean()), FORCE_N, _FORCE, unit="N",
             absolute=FORCE_SHARE * FORCE_N),
        bounded("Fig. 10: greatest error of the force over the last 2 s", None, off,
                (None, FORCE_SHARE * FORCE_N), _FORCE, unit="N"),
        bounded("Fig. 10: greatest horizontal error of the hand over the last 2 s",
                "achieves its target", float(run.errors[HAND][end].max()), (None, HORIZONTAL_M),
                "As the paper: position and force are kept together", unit="m"),
        bounded("Fig. 10: from the change of priorities to the first touch", "afterwards",
                first - switch_s, (0.0, None), "As the paper: the elbow holds it back before",
                unit="s"),
        bounded("Fig. 10: impact, greatest force", "a peak", peak, (FORCE_N, None),
                "As the paper: there is one. How high depends on the plane, which is not printed",
                unit="N"),
        measured("Fig. 10: from the first touch until the force stays within 0.5 %", None,
                 float(run.time_s[outside[-1]]) - first, "Not in the paper", unit="s"),
        measured("Fig. 10: elbow, error in the end", None, float(run.errors[ELBOW][end].mean()),
                 "The paper shows a curve: the elbow gives way", unit="m"),
        bounded("Fig. 10: ticks without an answer", None, run.fallbacks, (0.0, 0.0),
                "Every problem has an answer"),
    ]  # fmt: skip


def draw(run: Run) -> list[Figure]:
    """Fig. 10; Fig. 9, a photograph of the simulator, as height over the plane is in its place."""
    time = Axis("time_s", "time [s]")
    thin = run.time_s[::EVERY]
    pairs = {f"α_{i + 1}{j + 1}": (thin, run.alpha[::EVERY, i, j]) for i, j in ((0, 1), (1, 0))}
    off = {name: (thin, run.errors[name][::EVERY]) for name in (HAND, ELBOW)}
    force = [
        level("desired", run.time_s[[0, -1]], FORCE_N),
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
    return [column("fig10", title, panels, (10.0, 8.5))]


_FORCE = (
    "As the paper, whose scale is a curve: here 10 N. With the measured wrench in the equation of "
    "motion; (3) alone, without it, would be some per cent off. No scalar variant is built"
)
