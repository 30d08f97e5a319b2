"""Pictures of what moves: targets, curves, and what is too fast."""

from __future__ import annotations

import numpy as np
from drawing import label, lines, of, panels
from limits import thin
from matplotlib.figure import Figure
from runs import WITHIN, qp12, run

ALL = {"objective": qp12(0.0), "psi": {"form": "max_norm"}}


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
