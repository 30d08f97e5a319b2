"""Rows of Table 1 and Figs. 1 to 11.

Exact are priorities by (15) and the bounds of Fig. 8; errors, torques and jerk depend on targets,
start and inertia, which are not printed. Errors in Table 1 are the mean of |e| over the last half
second of 8 s. A PD of 30 and 20 has a pole at −1.63/s, so that an error of 0.5 m is down to 10⁻⁶ m
after 8 s: what the paper prints is no steady state, but its phases were about as long.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from hoap3.tools.reproduce.papers.ghc import oracle, runs
from hoap3.tools.reproduce.rows import NONE, Row, like, row, table

TABLE_1 = {
    "GHC": (
        ("0.46", "0.40", "2.2e-30"),
        ("1.0e-6", "0.46", "1.8"),
        ("0.42", "2.6e-6", "3.0"),
        ("3.9e-6", "0.55", "0.79"),
    ),
    "HQP": (
        ("0.46", "0.40", "2.8e-10"),
        ("4.5e-7", "0.46", "1.8"),
        ("0.42", "2.7e-6", "3.1"),
        ("4.5e-6", "0.55", "0.79"),
    ),
}
"""Printed errors of tasks 1, 2 and 3 by phase [m, m, rad]."""

TABLED = len(TABLE_1["GHC"])  # phases of the table; the last of the figures is not in it
TABLE_S = TABLED * runs.PHASE_S
UNITS = ("m", "m", "rad")
FITTED = "targets, start and inertia"
EXACT = 1e-12
TOP = 1e-4  # m or rad
ROUNDING = 1e-6
AT_BOUND = 1e-9
TRACKED_M = 2e-3
SETTLED_S = 2.0  # at the end, within which errors of motions are looked at
FORCE_SHARE = 0.005
HORIZONTAL_M = 1e-3
TOUCH_N = 0.5
STRICT_M = 1e-3
EVEN = (0.5, 2.0)


def rows(done: runs.Runs) -> list[Row]:
    """All of them."""
    return [
        *alpha_rows({runs.FAST_S: done.fast, runs.SLOW_S: done.slow}),
        *tabled("GHC", done.fast),
        *tabled("HQP", done.hqp),
        *jerk_rows(done.tabled),
        *lemniscate_rows(done.lemniscate),
        *pressing_rows(done.pressing),
        *compromise_rows(done.compromises),
    ]


def alpha_rows(done: dict[float, runs.Run]) -> list[Row]:
    """α next to (15), by the duration of transitions."""
    why = (
        "Exact: all nine priorities at every tick, with five hierarchies, one removal and insertion"
    )
    off = {over: run.alpha - oracle.expected(run.time_s, over) for over, run in done.items()}
    return table(
        "Fig. 1: greatest |α − (15)|, transitions of ",
        *((f"{over:g} s", 0, np.abs(each).max(), (None, EXACT), why) for over, each in off.items()),
    )


def tabled(strategy: str, run: runs.Run) -> list[Row]:
    """The table, of GHC or HQP."""
    made = []
    for phase, papers in enumerate(TABLE_1[strategy]):
        for task, unit, paper in zip(runs.TASKS, UNITS, papers, strict=True):
            top, cascade = task == runs.HIGHEST[phase], (strategy, phase) == ("HQP", 2)
            made.append(row(
                f"Table 1: {runs.PHASES[phase]}, {strategy}, {task}", paper, run.rest(phase, task),
                (None, TOP) if top else None, _TOP if top else _LOWER, unit,
                differs=_DECAYS if top else _CASCADE if cascade else "",
                fitted="" if top else FITTED,
            ))  # fmt: skip
    return made


def jerk_rows(done: Mapping[str, runs.Run]) -> list[Row]:
    """Fig. 5, up to the end of the table or of the shortest run."""
    fast = done["GHC, 5 ms"]
    last = min(fast.rows(0.0, TABLE_S).stop, *(len(run.q) for run in done.values())) - 1
    jerk = {name: run.jerk[last] for name, run in done.items()}
    return [
        *table("Fig. 5: ∫|jerk| over four hierarchies, ",
               *((name, None, found, None, _CURVE, "rad/s²") for name, found in jerk.items())),
        *table("Fig. 5: ∫|jerk|, ",
               ("HQP / GHC 5 ms", "more than 1", jerk["HQP"] / jerk["GHC, 5 ms"], (1.0, None),
                "As the paper: HQP jerks more. How much more depends on its damping"),
               ("GHC 5 ms / GHC 2 s", "more than 1", jerk["GHC, 5 ms"] / jerk["GHC, 2 s"],
                (2.0, None), "As the paper: slower transitions jerk less")),
        *table("Table 1: ticks without an answer, ",
               *((name.replace(",", ""), None, run.fallbacks, NONE, "Every problem has an answer")
                 for name, run in done.items())),
    ]  # fmt: skip


_CURVE = (
    "The paper shows a curve without figures; inertia, start and targets, on which it depends, are "
    f"not printed. Qualitative: only the order is judged. HQP with damping "
    f"{runs.HQP_DAMPING:g}, GHC with ω_r = {runs.W_R:g}"
)
_LOWER = (
    "Targets, start and inertia are not printed: ours were sought until the table came out, so "
    "that what is shown is that one choice gives all of it"
)
_TOP = "As the paper, the highest task is done: at most 10⁻⁴"
_DECAYS = (
    "What a PD of 30 and 20 leaves depends on how long a phase lasts, which is not printed: 10⁻⁶ "
    "after 8 s. Where lower tasks swing, |τ|² lets some 10⁻⁵ of that into the highest; below 10⁻⁹ "
    "it is rounding. The claim, at most 10⁻⁴, is kept"
)
_CASCADE = (
    "Targets were fitted to the table's GHC. Where task 2 contradicts the one above, HQP rests at "
    "N₁J₂ᵀe₂ = 0 and GHC elsewhere, so that HQP leaves other errors than the paper's"
)


def lemniscate_rows(run: runs.Run) -> list[Row]:
    """Bounds, and how well the highest task does, of all hierarchies that a run has."""
    made = table(
        "Fig. 8: ",
        ("greatest |dq|", f"at most {runs.SPEED_MAX:g}", np.abs(run.dq).max(),
         (None, runs.SPEED_MAX + ROUNDING), _EXACT, "rad/s"),
        ("greatest |τ|", f"at most {runs.TORQUE_MAX:g}", np.abs(run.tau).max(),
         (None, runs.TORQUE_MAX + ROUNDING), _EXACT, "N m"),
        ("ticks without an answer", None, run.fallbacks, NONE, _ANSWER),
        (f"ticks at a bound, of {len(run.q)}", None, at_bounds(run).sum(), (1.0, None),
         "The bounds do hold something back; the paper's curve shows it, too"),
    )  # fmt: skip
    for phase, task in ((1, runs.HAND), (2, runs.ELBOW), (3, runs.HAND), (4, runs.HAND)):
        end = (phase + 1) * runs.PHASE_S
        if len(run.q) >= run.rows(0.0, end).stop:
            item = f"Fig. 7: {runs.PHASES[phase]}, greatest error of the {task}"
            ours = run.errors[task][run.rows(end - SETTLED_S, end)].max()
            made.append(row(item, "precisely", ours, (None, TRACKED_M), _TRACKED, "m"))
    return made


def at_bounds(run: runs.Run) -> NDArray[np.bool_]:
    """Ticks at which some speed or torque is at its bound, (N,)."""
    speeds = np.abs(run.dq) >= runs.SPEED_MAX * (1.0 - AT_BOUND)
    torques = np.abs(run.tau) >= runs.TORQUE_MAX * (1.0 - AT_BOUND)
    return np.asarray((speeds | torques).any(axis=1))


_EXACT = "As the paper: the bounds are kept"
_ANSWER = (
    "The paper does not say what it does without an answer. With bounds for a single period, or "
    "transitions of 0.5 s, there are ticks without one"
)
_TRACKED = (
    "As the paper, precisely, or for the elbow where it should be; it prints a curve. How far off "
    "depends on ω_r and on the lemniscate, whose size and place are not printed: ours is 0.10 m"
)


def touch_s(run: runs.Run) -> float:
    """When it first touches [s]; NaN where it does not."""
    touching = np.flatnonzero(run.force >= TOUCH_N)
    return float(run.time_s[touching[0]]) if touching.size else float("nan")


def pressing_rows(run: runs.Run, switch_s: float = runs.SWITCH_S) -> list[Row]:
    """Force, place, and what happens at the impact."""
    end = slice(run.rows(0.0, len(run.q) * run.period_s - SETTLED_S).stop, None)
    off = float(np.abs(run.force[end] - runs.FORCE_N).max())
    first = touch_s(run)
    width = FORCE_SHARE * runs.FORCE_N
    outside = np.flatnonzero(np.abs(run.force - runs.FORCE_N) > width)
    hand, elbow = run.errors[runs.HAND][end], run.errors[runs.ELBOW][end]
    return table(
        "Fig. 10: ",
        ("force on the plane in the end", "follows its reference", run.force[end].mean(),
         like(runs.FORCE_N, width), _FORCE, "N"),
        ("greatest error of the force over the last 2 s", None, off, (None, width), _FORCE, "N"),
        ("greatest horizontal error of the hand over the last 2 s", "achieves its target",
         hand.max(), (None, HORIZONTAL_M), "As the paper: position and force are kept together",
         "m"),
        ("from the change of priorities to the first touch", "afterwards", first - switch_s,
         (0.0, None), "As the paper: the elbow holds it back before", "s"),
        ("impact, greatest force", "a peak", run.force.max(), (runs.FORCE_N, None),
         "As the paper: there is one. How high depends on the plane, which is not printed", "N"),
        ("from the first touch until the force stays within 0.5 %", None,
         run.time_s[outside[-1]] - first, None, "Not in the paper", "s"),
        ("elbow, error in the end", None, elbow.mean(), None,
         "The paper shows a curve: the elbow moves aside", "m"),
        ("ticks without an answer", None, run.fallbacks, NONE, "Every problem has an answer"),
    )  # fmt: skip


_FORCE = (
    "As the paper, whose scale is a curve: here 10 N. With the measured wrench in the equation of "
    "motion; (3) alone, without it, would be some per cent off. No scalar variant is built"
)


def compromise_rows(by_alpha: Mapping[float, tuple[float, float]]) -> list[Row]:
    """Each error, monotony, and whether the ends are strict."""
    steps = np.diff(np.array([by_alpha[alpha] for alpha in sorted(by_alpha)]), axis=0)
    hand, elbow = by_alpha[0.5]
    names = runs.HAND, runs.ELBOW
    return table(
        "Fig. 11: ",
        *((f"α₁₂ = {alpha:g}, {name}", None, ours, None, _SCALE, "m")
          for alpha, found in by_alpha.items() for name, ours in zip(names, found, strict=True)),
        *((f"α₁₂ = {alpha:g}, {names[k]} alone has priority: its error", 0, by_alpha[alpha][k],
           (None, STRICT_M), _STRICT, "m") for k, alpha in enumerate((0.0, 1.0))),
        ("hand, least step from one α₁₂ to the next", "increases", steps[:, 0].min(),
         (0.0, None), _MONOTONE, "m"),
        ("elbow, greatest step from one α₁₂ to the next", "decreases", steps[:, 1].max(),
         (None, 0.0), _MONOTONE, "m"),
        ("α₁₂ = 0.5, hand / elbow", "more or less equal", hand / elbow, EVEN,
         "As the paper: more or less an equal compromise"),
    )  # fmt: skip


_SCALE = "The paper shows curves for 0.2, 0.5 and 0.8, of targets that are not printed"
_STRICT = "As the paper: α = 0 or 1 is a strict priority"
_MONOTONE = "As the paper: a greater α₁₂ improves the elbow at the expense of the hand"
