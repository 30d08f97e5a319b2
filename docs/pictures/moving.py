"""Pictures of what moves: targets, curves, and what is too fast."""

from __future__ import annotations

from typing import Any

import numpy as np
from drawing import label, limit, lines, of, panels
from limits import thin
from matplotlib.figure import Figure
from runs import TARGET, WITHIN, qp12, run, to

ALL = {"objective": qp12(0.0), "psi": {"form": "max_norm"}}


def eight(half_width_m: float, period_s: float) -> dict[str, Any]:
    """The centre of mass along a lemniscate above the right sole."""
    target = {
        "kind": "lemniscate",
        "center_m": [0.0, 0.02, 0.285],
        "plane": "xy",
        "half_width_m": half_width_m,
        "period_s": period_s,
        "approach_s": 2.0,
    }
    return {"task": "com", "parameters": {"frame": "r_sole", "target": target}}


def lemniscate() -> Figure:
    """Feed-forward leaves what Euler steps leave."""
    figure, (path, error) = panels(2)
    runs = {
        f"{each:g} s a round": run(10.0, eight(0.01, each), WITHIN, **ALL)
        for each in (8.0, 4.0, 2.0)
    }
    track = 1e3 * runs["8 s a round"].com()
    lines(path, {"": thin(track[:, 0], track[:, 1])})
    path.set_aspect("equal")
    label(path, "centre of mass, from above", "x [mm]", "y [mm]")
    lines(
        error,
        {name: of(each, 1e6 * np.sqrt(2 * each["v"]), start=0.01) for name, each in runs.items()},
    )
    error.set_yscale("log")
    error.set_ylim(1.0, 2000.0)
    label(error, "|e|: a floor, not zero", "t [s]", "[µm]")
    return figure


def circulation() -> Figure:
    """To a curve, and round it."""
    figure, (path, value) = panels(2)
    tracks, distances = {}, {}
    for direction in ("forward", "backward"):
        for kind in (qp12(0.0), {"kind": "least_squares"}):
            parameters = {
                "point": "com",
                "reference": "r_sole",
                "curve": "ellipse",
                "curve_parameters": {
                    "center_m": [0.0, 0.02, 0.285],
                    "plane": "xy",
                    "radii_m": [0.015, 0.01],
                },
                "speed_m_s": 0.01,
                "direction": direction,
            }
            chosen = {"objective": kind, "psi": ALL["psi"]}
            found = run(9.0, {"task": "task_curve", "parameters": parameters}, WITHIN, **chosen)
            if kind["kind"] == "qp12":
                track = 1e3 * found.com()
                tracks[direction] = thin(track[:, 0], track[:, 1])
            if direction == "forward":
                distances[kind["kind"]] = of(found, 1e3 * np.sqrt(2 * found["v"]))
    lines(path, tracks)
    path.set_aspect("equal")
    label(path, "centre of mass, from above", "x [mm]", "y [mm]")
    lines(value, distances)
    value.set_yscale("log")
    label(value, "distance from the curve, forward", "t [s]", "[mm]")
    return figure


def descent() -> Figure:
    """V̇ = −Ψ, or V̇ ≤ 0 and what Φ makes of it."""
    figure, (value, speed) = panels(2)
    wanted = {"kind": "least_squares", "gain_per_s": 2.0}
    runs = {
        kind: run(2.0, to(*TARGET), WITHIN, objective=wanted, psi=ALL["psi"], lyapunov=kind)
        for kind in ("equality", "descent")
    }
    lines(value, {name: of(each, each["v"] / each["v"][0]) for name, each in runs.items()})
    value.set_yscale("log")
    label(value, "V / V(0)", "t [s]", "")
    lines(speed, {name: of(each, np.abs(each.u).max(axis=1)) for name, each in runs.items()})
    label(speed, "fastest joint", "t [s]", "|u| [rad/s]")
    return figure


def behind() -> Figure:
    """A target that is faster than the joints."""
    figure, (error, share) = panels(2)
    found = run(3.2, eight(0.03, 0.6), WITHIN, **ALL)
    lines(error, {"": of(found, 1e3 * np.sqrt(2 * found["v"]))})
    label(error, "distance from the target", "t [s]", "|e| [mm]")
    lines(share, {"": of(found, found["rho"])}, rough=True)
    limit(share, 0.0, "below: V had to rise", at=0.4)
    share.set_ylim(-3.0, 1.2)
    label(share, "ρ", "t [s]", "")
    return figure
