"""Pictures of Φ: which joints do the work."""

from __future__ import annotations

from typing import Any

import numpy as np
from drawing import joints, label, lines, of, panels
from matplotlib.figure import Figure
from runs import JOINTS, WITHIN, Array, Run, qp12, run

MOMENT = 100  # tick at which speeds are compared: 0.1 s
RATE = {"form": "max_norm"}


def motion(objective: dict[str, Any], duration: float = 0.5, **parameters: Any) -> Run:
    """The paper's motion within the joints' limits."""
    return run(duration, constraints=WITHIN, objective=objective, psi=RATE, **parameters)


def gamma() -> Figure:
    """Few joints or many, at the same V."""
    runs = {f"γ = {each:g}": motion(qp12(each), 1.5) for each in (0.0, 0.05, 0.5, 0.99)}
    figure, axes = panels(5, left=0.11, width=9.0, height=3.2, gap=0.3)
    joints(axes[:4], {name: each.u[MOMENT] for name, each in runs.items()}, JOINTS)
    lines(axes[4], {name: of(each, each["v"] / each["v"][0]) for name, each in runs.items()})
    axes[4].set_yscale("log")
    label(axes[4], "V / V(0)", "t [s]", "")
    return figure


def norms() -> Figure:
    """The other objectives."""
    kinds: dict[str, dict[str, Any]] = {
        "p = 1": {"kind": "lp", "p": 1},
        "p = 2": {"kind": "lp", "p": 2},
        "p = inf": {"kind": "lp", "p": "inf"},
        "least_squares": {"kind": "least_squares"},
    }
    figure, axes = panels(4, left=0.13, height=3.2, gap=0.2)
    joints(axes, {name: motion(each, 0.2).u[MOMENT] for name, each in kinds.items()}, JOINTS)
    return figure


def gamma_units() -> Figure:
    """The same γ moves fewer joints the slower they are."""
    figure, (speed, time) = panels(2)
    by_speed, by_time = {}, {}
    for each in (0.01, 0.1, 0.5):
        points = []
        for fastest in np.geomspace(2e-4, 20.0, 21):
            psi = {"form": "one", "u_max_rad_s": float(fastest)}
            u = run(0.001, objective=qp12(each), psi=psi).u[0]
            points.append((np.abs(u).max(), moving(u)))
        by_speed[f"γ = {each}"] = tuple(np.array(points).T)
        found = motion(qp12(each), 1.2)
        by_time[f"γ = {each}"] = of(found, moving(found.u))
    lines(speed, by_speed, marker=".")
    speed.set_xscale("log")
    label(speed, "at the start, for slow and fast Ψ", "fastest joint [rad/s]", "joints that move")
    lines(time, by_time)
    label(time, "on the way to the target", "t [s]", "joints that move")
    return figure


def moving(u: Array) -> Array:
    """How many joints move at all."""
    return np.asarray((np.abs(u) > 1e-9).sum(axis=-1), float)


def adaptive() -> Figure:
    """A constant γ chatters at the target."""
    figure, axes = panels(2)
    start, ticks = 2500, 60
    for one, (title, choice) in zip(
        axes, {"γ = 0.5": False, "γ = 0.5, adaptive": True}.items(), strict=True
    ):
        found = motion({**qp12(0.5), "adaptive_gamma": choice}, 2.6)
        busy = np.argsort(-np.abs(found.u[start : start + ticks]).max(axis=0))[:4]
        begin, end = 1e-3 * start, 1e-3 * (start + ticks) - 1e-6
        window = {JOINTS[j]: of(found, 1e3 * found.u[:, j], start=begin, end=end) for j in busy}
        lines(
            one,
            window,
            rough=not choice,
            drawstyle="steps-post",
            at="upper right",
            linewidth=0.9,
            linestyle="-",
        )
        one.set_ylim(-9.0, 22.0)
        label(one, title, "t [s]", "u [mrad/s]")
    return figure


def weights() -> Figure:
    """Dear joints rest."""
    spared = dict.fromkeys((name for name in JOINTS if "ankle" in name), 5.0)
    kinds = {"no weights": qp12(0.0), "each ankle: 5": {**qp12(0.0), "weights": spared}}
    figure, axes = panels(2, left=0.2, height=3.2, gap=0.1)
    joints(axes, {name: motion(each, 0.2).u[MOMENT] for name, each in kinds.items()}, JOINTS)
    return figure
