"""Figs. 4 to 8."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hoap3.tools.reproduce import figures
from hoap3.tools.reproduce.figures import (
    COLOURS,
    INK,
    PALE,
    Array,
    Axis,
    Curve,
    Figure,
    Panel,
    level,
    mark,
)
from hoap3.tools.reproduce.papers.qp12 import runs

Limits = tuple[float, float]
Zoom = tuple[Limits, Limits] | None

CASES = {
    "A": "A: Ψ as printed, (16), e in m",
    "B": "B: Ψ as printed, (16), e in cm",
    "C": "C: Ψ without 1/√n, e in m",
}
SHOWN = (0.0, 0.3, 0.7, 0.99)
"""γ of Figs. 4 and 8."""

ACTIVE_AXIS = Axis("active_joints", "active joints", (0.0, 21.0), step=5.0)
MEAN_AXIS = Axis("active_joints", "active joints, mean over 400 ms", (0.0, 21.0), step=5.0)


def draw_all(trials: runs.Trials) -> list[Figure]:
    """Every figure of section V that shows a motion."""
    first = [fig4(trials), fig5(trials), fig6(trials), fig7(trials)]
    return [*first, *(fig8(trials, case) for case in CASES)]


def fig4(trials: runs.Trials) -> Figure:
    """Path of the centre of mass over the right sole."""
    marks = [
        sole_outline(),
        mark("m0", 1e3 * runs.START_M[0], 1e3 * runs.START_M[1], "o", legend="m₀"),
        mark("md", 1e3 * runs.TARGET_M[0], 1e3 * runs.TARGET_M[1], "X", legend="m_d"),
    ]

    def panel(case: str) -> Panel:
        coms = {f"γ = {gamma:g}": 1e3 * trials[case, runs.Law(gamma)].com for gamma in SHOWN}
        paths = {name: (com[:, 0], com[:, 1]) for name, com in coms.items()}
        return over_the_sole(
            case,
            f"{CASES[case]}; {runs.SECONDS[case]:g} s",
            (-60.0, 60.0),
            (-42.0, 42.0),
            [*marks, *figures.lines(paths, ("-", "--", "-.", ":"))],
            zoom=((-11.0, 13.0), (23.0, 30.0)),
        )

    title = "Fig. 4: centre of mass over the right sole"
    return Figure("fig4", title, [[panel(case) for case in CASES]], (15.0, 4.0))


def fig5(trials: runs.Trials) -> Figure:
    """V and Ψ over time, 11 trials."""

    def panel(case: str, name: str, label: str, axis: str) -> Panel:
        curves = [
            Curve(f"γ = {law.gamma:g}", motion.time_ms, 1e6 * getattr(motion, name), colour)
            for law, colour in zip(runs.TRIALS, _shades(len(runs.TRIALS)), strict=True)
            for motion in [trials[case, law]]
        ]
        return Panel(f"{name}_{case}", CASES[case], _time(case), Axis(axis, label), curves)

    quantities = (("v", "V [mm²]", "V_mm2"), ("psi", "Ψ [mm²/s]", "Psi_mm2_per_s"))
    rows = [[panel(case, *each) for case in CASES] for each in quantities]
    title = "Fig. 5: V and Ψ of 11 trials, which all but coincide; adaptive γ"
    return Figure("fig5", title, rows, (15.0, 6.0))


def fig6(trials: runs.Trials) -> Figure:
    """Mean number of active joints over γ."""
    gammas = np.array([law.gamma for law in runs.TRIALS], np.float64)

    def means(case: str, laws: list[runs.Law]) -> Array:
        return np.array([trials[case, law].mean_active(0, 400) for law in laws])

    curves = []
    for case, colour, marker, other in zip(CASES, COLOURS, "o^s", "x1+", strict=False):
        constant = [law for where, law in trials if where == case and not law.adaptive]
        at = np.array([law.gamma for law in constant], np.float64)
        name, pinv = CASES[case], means(case, [runs.PINV])[0]
        adaptive, fixed = means(case, list(runs.TRIALS)), means(case, constant)
        curves += [
            Curve(f"{name}, adaptive γ", gammas, adaptive, colour, marker=marker),
            Curve(f"{name}, constant γ", at, fixed, colour, dash="", marker=other),
            level(f"{name}, PINV", (0.0, 1.0), pinv, colour=colour),
        ]
    curves += [
        mark("the paper's text, QP12", 0.1, 6.0, "*"),
        level("the paper's text, PINV", (0.0, 1.0), 18.0, ":"),
    ]
    panel = Panel("", "", Axis("gamma", "γ", (-0.02, 1.02)), MEAN_AXIS, curves)
    return figures.column("fig6", "Fig. 6: joints that move, over γ", [panel], (9.0, 4.5))


def fig7(trials: runs.Trials) -> Figure:
    """Number of active joints over time."""
    laws = {"PINV": runs.PINV, "QP12, γ = 0": runs.EVEN, "QP12, γ = 0.99": runs.SPARSE}

    def panel(case: str) -> Panel:
        motions = {name: trials[case, law] for name, law in laws.items()}
        counts = {name: (each.time_ms, each.active_count) for name, each in motions.items()}
        curves = figures.lines(counts, ("--", "-", "-"), style="steps")
        return Panel(case, CASES[case], _time(case), ACTIVE_AXIS, curves)

    rows = [[panel(case) for case in CASES]]
    return Figure("fig7", "Fig. 7: active joints over time, adaptive γ", rows, (15.0, 3.6))


def fig8(trials: runs.Trials, case: str) -> Figure:
    """Joint velocities, and how many joints are active, for four γ."""
    motions = {gamma: trials[case, runs.Law(gamma)] for gamma in SHOWN}
    names = runs.joint_names()
    fastest = np.max([np.abs(motion.u).max(axis=0) for motion in motions.values()], axis=0)
    top_six = sorted(np.argsort(-fastest)[:6].tolist())
    named = dict(zip(top_six, COLOURS, strict=False))
    top = 1.1 * float(fastest.max())

    def velocities(gamma: float, motion: runs.Motion) -> Panel:
        order = sorted(range(len(names)), key=lambda i: i in named)  # those with names on top
        curves = []
        for i in order:
            colour, legend = (named[i], None) if i in named else (PALE, "other joints")
            curve = Curve(names[i], motion.time_ms, motion.u[:, i], colour, "steps", legend=legend)
            curves.append(curve)
        axis = Axis("u_rad_s", "u [rad/s]", (-top, top))
        return Panel(f"u_{gamma:g}", f"γ_far = {gamma:g}", _time(case), axis, curves)

    def count(gamma: float, motion: runs.Motion) -> Panel:
        curve = Curve("active joints", motion.time_ms, motion.active_count, INK, "steps", legend="")
        title = f"γ_far = {gamma:g}"
        return Panel(f"active_{gamma:g}", title, _time(case), ACTIVE_AXIS, [curve])

    rows = [[velocities(*each), count(*each)] for each in motions.items()]
    title = f"Fig. 8, case {CASES[case]}: velocities and active joints, adaptive γ"
    return Figure(f"fig8_{case}", title, rows, (10.0, 9.0))


def _time(case: str) -> Axis:
    return Axis("time_ms", "time [ms]", (0.0, 1e3 * runs.SECONDS[case]))


def sole_outline() -> Curve:
    """The right sole seen from above [mm]."""
    corners = 1e3 * np.vstack([runs.sole(), runs.sole()[:1]])
    return Curve("right sole", corners[:, 0], corners[:, 1], PALE, "area")


def over_the_sole(
    name: str, title: str, x: Limits, y: Limits, curves: Sequence[Curve], zoom: Zoom = None
) -> Panel:
    """A panel in the plane of the sole [mm]."""
    x_mm, y_mm = Axis("x_mm", "x, forward [mm]", x), Axis("y_mm", "y, left [mm]", y)
    return Panel(name, title, x_mm, y_mm, curves, square=True, zoom=zoom)


def _shades(count: int) -> list[str]:
    """Colours from dark blue to yellow, whose lightness rises evenly."""
    from matplotlib import colormaps
    from matplotlib.colors import to_hex

    return [to_hex(colour) for colour in colormaps["cividis"](np.linspace(0.0, 0.9, count))]
