"""The picture of docs/guides/controllers.md: a pair of tasks changes places, and nothing jumps."""

from __future__ import annotations

from copy import deepcopy
from typing import Any

import numpy as np
from drawing import label, limit, lines, of, panels
from matplotlib.figure import Figure
from runs import Run

from hoap3.protocol.config.settings import load_yaml
from hoap3.remote_controller.config import CONFIGS
from hoap3.tools.services.simulate import simulate


def shipped(**change: Any) -> Run:
    """The shipped motion of `ghc_velocity`, its change of priorities changed."""
    config = deepcopy(load_yaml(CONFIGS / "ghc_velocity.yaml"))
    config["parameters"]["priorities"]["timeline"][0].update(change)
    return Run(simulate("hoap3", config, 8.0))


def priorities() -> Figure:
    """The posture rises above the foot, and draws it back; the centre of mass stays."""
    figure, (rank, error, pull) = panels(3, gap=0.4)
    found, sudden = shipped(), shipped(over_s=0.0)
    names = found.simulation.controller.extra_names
    pairs = {
        "foot out of posture": "alpha_foot_posture",
        "posture out of foot": "alpha_posture_foot",
    }
    curves = {said: of(found, found["extra"][:, names.index(key)]) for said, key in pairs.items()}
    lines(rank, curves, at="upper left")
    rank.set_ylim(-0.05, 1.5)
    label(rank, "α", "t [s]", "")
    shown = {"centre of mass": "error_com", "foot": "error_foot"}
    curves = {
        said: of(found, 1e3 * found["extra"][:, names.index(key)]) for said, key in shown.items()
    }
    lines(error, curves, first=2, at="upper left")
    error.set_ylim(-2.0, 66.0)
    label(error, "errors", "t [s]", "|e| [mm]")
    for place, (said, each) in enumerate({"over 2 s": found, "at once": sudden}.items()):
        hardest = np.abs(np.diff(each.u, axis=0)).max(axis=1, initial=0.0) / 1e-3
        lines(pull, {said: of(each, np.append(hardest, 0.0), start=3.9, end=4.3)}, first=place)
    limit(pull, 40.0, "bounds.acceleration_rad_s2")
    pull.set_ylim(-2.0, 46.0)
    label(pull, "hardest acceleration", "t [s]", "[rad/s²]")
    return figure
