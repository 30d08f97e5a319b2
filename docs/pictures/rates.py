"""Pictures of Ψ and ρ: how fast V falls, and what constraints leave of it."""

from __future__ import annotations

import numpy as np
from drawing import label, limit, lines, of, panels
from matplotlib.figure import Figure
from runs import EDGE, WITHIN, qp12, run, to

BEYOND = to(0.03, 0.06, 0.2869)  # outside the sole
TOO_HIGH = to(0.0, 0.02, 0.40)  # higher than stretched legs


def rates() -> Figure:
    """V from the same start."""
    figure, (early, late) = panels(2)
    begin = float(run(0.01, objective=qp12(0.0), psi={"form": "max_norm"})["extra"][0, 0])
    first = run(0.01, psi={"form": "tanh"})
    eta = begin / float(first["extra"][0, 0])
    rate = begin / float(first["v"][0])
    kinds = {
        "inverse_sqrt_n": {"form": "inverse_sqrt_n"},
        "one": {"form": "one"},
        "max_norm": {"form": "max_norm"},
        "tanh": {"form": "tanh", "eta_per_s": eta},
        "exponential": {"form": "exponential", "eta_per_s": rate},
    }
    soon, far = {}, {}
    for name, psi in kinds.items():
        found = run(12.0, constraints=WITHIN, objective=qp12(0.0), psi=psi)
        share = found["v"] / found["v"][0]
        soon[name], far[name] = of(found, share, end=1.5), of(found, share)
    lines(early, soon)
    label(early, "V / V(0)", "t [s]", "")
    lines(late, far, at="")
    late.set_yscale("log")
    late.set_ylim(1e-12, 2.0)
    label(late, "the same, logarithmic", "t [s]", "")
    return figure


def unreachable() -> Figure:
    """∇V vanishes where V does not."""
    figure, (speed, value) = panels(2)
    kinds = {
        "max_norm": {"form": "max_norm"},
        "exponential": {"form": "exponential", "eta_per_s": 1.0},
    }
    runs = {
        name: run(3.0, TOO_HIGH, WITHIN[1:], objective=qp12(0.0), psi=psi)
        for name, psi in kinds.items()
    }
    lines(
        speed,
        {name: of(each, np.abs(each.u).max(axis=1)) for name, each in runs.items()},
        rough=True,
    )
    label(speed, "fastest joint", "t [s]", "|u| [rad/s]")
    lines(
        value,
        {name: of(each, 1e3 * np.sqrt(2 * each["v"])) for name, each in runs.items()},
        rough=True,
    )
    label(value, "distance from the target", "t [s]", "|e| [mm]")
    return figure


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
