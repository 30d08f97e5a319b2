"""Pictures of Ψ and ρ: how fast V falls, and what constraints leave of it."""

from __future__ import annotations

import numpy as np
from drawing import label, limit, lines, of, panels
from matplotlib.figure import Figure
from runs import EDGE, WITHIN, qp12, run, to

BEYOND = to(0.03, 0.06, 0.2869)  # outside the sole


def rho() -> Figure:
    """At the edge of the sole."""
    figure, (largest, damped, share) = panels(3)
    constraints = [*WITHIN, EDGE]
    chosen = {"objective": qp12(0.0), "psi": {"form": "max_norm"}}
    runs = {
        "largest": run(1.5, BEYOND, constraints, **chosen, rho="largest"),
        "damped": run(1.5, BEYOND, constraints, **chosen),
    }
    for axes, name in ((largest, "largest"), (damped, "damped")):
        found = runs[name]
        shown = np.argsort(-np.abs(found.u[1000:]).max(axis=0))[:5]
        lines(
            axes,
            {f"{joint}": of(found, found.u[:, joint], start=0.15) for joint in shown},
            rough=name == "largest",
            at="",
            linewidth=0.9,
            linestyle="-",
        )
        limit(axes, 0.6)
        limit(axes, -0.6)
        axes.set_ylim(-0.7, 0.7)
        label(axes, f"rho: {name}", "t [s]", "five joints' u [rad/s]" if axes is largest else "")
    lines(
        share, {name: of(each, each["rho"], start=0.15) for name, each in runs.items()}, rough=True
    )
    share.set_yscale("log")
    share.set_ylim(1e-7, 2.0)
    label(share, "ρ", "t [s]", "")
    return figure
