"""Figs. 4 to 8, each for case A and case C."""

from __future__ import annotations

import numpy as np

from hoap3.tools.reproduce.figures import COLOURS, INK, PALE, Array, Axis, Curve, Figure, Panel
from hoap3.tools.reproduce.papers.qp12.experiments import (
    SECONDS,
    START_M,
    TARGET_M,
    Motion,
    Trials,
    joint_names,
    sole,
)
from hoap3.tools.reproduce.papers.qp12.reference import EVEN, PINV, SPARSE, TRIALS, Law

CASES = {"A": "A: Ψ as printed, (16)", "C": "C: Ψ without 1/√n"}
SHOWN = (0.0, 0.3, 0.7, 0.99)
"""γ of Figs. 4 and 8."""

ACTIVE_AXIS = Axis("active_joints", "active joints", (0.0, 21.0), step=5.0)
MEAN_AXIS = Axis("active_joints", "active joints, mean over 400 ms", (0.0, 21.0), step=5.0)


def draw_all(trials: Trials) -> list[Figure]:
    """Every figure of section V that shows a motion."""
    return [
        fig4(trials),
        fig5(trials),
        fig6(trials),
        fig7(trials),
        fig8(trials, "A"),
        fig8(trials, "C"),
    ]


def fig4(trials: Trials) -> Figure:
    """Path of the centre of mass over the right sole."""
    corners = 1e3 * np.vstack([sole(), sole()[:1]])
    marks = [
        Curve("right sole", corners[:, 0], corners[:, 1], PALE, "area"),
        _point("m0", "m₀", START_M, "o"),
        _point("md", "m_d", TARGET_M, "X"),
    ]

    def panel(case: str) -> Panel:
        paths = [
            Curve(f"γ = {gamma:g}", 1e3 * com[:, 0], 1e3 * com[:, 1], colour, dash=dash)
            for gamma, colour, dash in zip(SHOWN, COLOURS, ("-", "--", "-.", ":"), strict=False)
            for com in [trials[case, Law(gamma)].com]
        ]
        return Panel(
            case,
            f"{CASES[case]}; {SECONDS[case]:g} s",
            Axis("x_mm", "x, forward [mm]", (-60.0, 60.0)),
            Axis("y_mm", "y, left [mm]", (-42.0, 42.0)),
            (*marks, *paths),
            square=True,
            zoom=((-11.0, 13.0), (23.0, 30.0)),
        )

    title = "Fig. 4: centre of mass over the right sole"
    return Figure("fig4", title, (tuple(panel(case) for case in CASES),), (10.0, 4.0))


def fig5(trials: Trials) -> Figure:
    """V and Ψ over time, 11 trials."""

    def panel(case: str, name: str, label: str, column: str) -> Panel:
        curves = [
            Curve(f"γ = {law.gamma:g}", motion.time_ms, 1e6 * getattr(motion, name), colour)
            for law, colour in zip(TRIALS, _shades(len(TRIALS)), strict=True)
            for motion in [trials[case, law]]
        ]
        return Panel(f"{name}_{case}", CASES[case], _time(case), Axis(column, label), tuple(curves))

    rows = (
        tuple(panel(case, "v", "V [mm²]", "V_mm2") for case in CASES),
        tuple(panel(case, "psi", "Ψ [mm²/s]", "Psi_mm2_per_s") for case in CASES),
    )
    return Figure(
        "fig5",
        "Fig. 5: V and Ψ of 11 trials, which all but coincide; adaptive γ",
        rows,
        (10.0, 6.0),
    )


def fig6(trials: Trials) -> Figure:
    """Mean number of active joints over γ."""
    gammas = np.array([law.gamma for law in TRIALS], np.float64)

    def means(case: str, laws: list[Law]) -> Array:
        return np.array([trials[case, law].mean_active(0, 400) for law in laws])

    curves = []
    for case, colour, marker in (("A", COLOURS[0], "o"), ("C", COLOURS[1], "s")):
        pinv = np.full(2, means(case, [PINV])[0])
        constant = [law for where, law in trials if where == case and not law.adaptive]
        at = np.array([law.gamma for law in constant], np.float64)
        name = CASES[case]
        curves += [
            Curve(f"{name}, adaptive γ", gammas, means(case, list(TRIALS)), colour, marker=marker),
            Curve(
                f"{name}, constant γ",
                at,
                means(case, constant),
                colour,
                dash="",
                marker="x" if case == "A" else "+",
            ),
            Curve(f"{name}, PINV", np.array([0.0, 1.0]), pinv, colour, dash="--"),
        ]
    curves += [
        Curve("the paper's text, QP12", np.array([0.1]), np.array([6.0]), dash="", marker="*"),
        Curve(
            "the paper's text, PINV", np.array([0.0, 1.0]), np.array([18.0, 18.0]), INK, dash=":"
        ),
    ]
    panel = Panel("", "", Axis("gamma", "γ", (-0.02, 1.02)), MEAN_AXIS, tuple(curves))
    return Figure("fig6", "Fig. 6: joints that move, over γ", ((panel,),), (9.0, 4.5))


def fig7(trials: Trials) -> Figure:
    """Number of active joints over time."""
    laws = {"PINV": PINV, "QP12, γ = 0": EVEN, "QP12, γ = 0.99": SPARSE}
    styles = list(zip(COLOURS, ("--", "-", "-"), strict=False))

    def panel(case: str) -> Panel:
        curves = []
        for (name, law), (colour, dash) in zip(laws.items(), styles, strict=True):
            motion = trials[case, law]
            curves.append(Curve(name, motion.time_ms, motion.active_count, colour, "steps", dash))
        return Panel(case, CASES[case], _time(case), ACTIVE_AXIS, tuple(curves))

    rows = (tuple(panel(case) for case in CASES),)
    return Figure("fig7", "Fig. 7: active joints over time, adaptive γ", rows, (10.0, 3.6))


def fig8(trials: Trials, case: str) -> Figure:
    """Joint velocities, and how many joints are active, for four γ."""
    motions = {gamma: trials[case, Law(gamma)] for gamma in SHOWN}
    names = joint_names()
    fastest = np.max([np.abs(motion.u).max(axis=0) for motion in motions.values()], axis=0)
    top_six = sorted(np.argsort(-fastest)[:6].tolist())
    named = dict(zip(top_six, COLOURS, strict=False))
    top = 1.1 * float(fastest.max())

    def velocities(gamma: float, motion: Motion) -> Panel:
        order = sorted(range(len(names)), key=lambda i: i in named)  # those with names on top
        curves = [
            Curve(
                names[i],
                motion.time_ms,
                motion.u[:, i],
                named.get(i, PALE),
                "steps",
                legend=None if i in named else "other joints",
            )
            for i in order
        ]
        axis = Axis("u_rad_s", "u [rad/s]", (-top, top))
        return Panel(f"u_{gamma:g}", f"γ_far = {gamma:g}", _time(case), axis, tuple(curves))

    def count(gamma: float, motion: Motion) -> Panel:
        curve = Curve("active joints", motion.time_ms, motion.active_count, INK, "steps", legend="")
        title = f"γ_far = {gamma:g}"
        return Panel(f"active_{gamma:g}", title, _time(case), ACTIVE_AXIS, (curve,))

    rows = tuple((velocities(*each), count(*each)) for each in motions.items())
    title = f"Fig. 8, case {CASES[case]}: velocities and active joints, adaptive γ"
    return Figure(f"fig8_{case}", title, rows, (10.0, 9.0))


def _time(case: str) -> Axis:
    return Axis("time_ms", "time [ms]", (0.0, 1e3 * SECONDS[case]))


def _point(name: str, legend: str, place: tuple[float, ...], marker: str) -> Curve:
    x, y = (np.array([1e3 * value]) for value in place[:2])
    return Curve(name, x, y, INK, dash="", marker=marker, legend=legend)


def _shades(count: int) -> list[str]:
    """Colours from dark blue to yellow, whose lightness rises evenly, as in cividis."""
    stops = np.array([[0, 32, 77], [87, 93, 109], [148, 142, 119], [227, 202, 61]], np.float64)
    where = np.linspace(0, len(stops) - 1, count)
    channels = [np.interp(where, range(len(stops)), column) for column in stops.T]
    return [
        "#" + "".join(f"{round(c):02x}" for c in colour) for colour in zip(*channels, strict=True)
    ]
