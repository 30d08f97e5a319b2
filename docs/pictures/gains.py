"""The picture of docs/theory/sdp.md: constant gains come to a halt, those with a proof do not."""

from __future__ import annotations

import numpy as np
from drawing import label, lines, of, panels
from matplotlib.figure import Figure
from runs import Array, Run

from hoap3.protocol.config.settings import load_yaml
from hoap3.remote_controller.config import CONFIGS
from hoap3.tools.services.simulate import simulate

START = {"robot": "ur5", "posture": "outstretched"}


def shipped(name: str, **change: float) -> Run:
    """A shipped config from where the paper starts, its parameters changed."""
    config = load_yaml(CONFIGS / f"{name}.yaml")
    config["parameters"].update(change)
    return Run(simulate(START, config, 3.0))


def gains() -> Figure:
    """V, β and the gain of the second task, for constant gains and for two β̃."""
    figure, (fall, rate, gain) = panels(3, gap=0.42)
    found = {
        "constant": shipped("clik_ur5"),
        "β̃ = 2/s": shipped("clik_sdp_ur5", beta_per_s=2.0),
        "β̃ = 8/s": shipped("clik_sdp_ur5", beta_per_s=8.0),
    }

    def column(run: Run, name: str) -> Array:
        names = run.simulation.controller.extra_names
        return np.asarray(run["extra"][:, names.index(name)])

    lines(fall, {said: of(run, run["v"]) for said, run in found.items()}, at="lower left")
    fall.set_yscale("log")
    label(fall, "V = ½ Σ w|e|²", "t [s]", "[m²]")
    lines(rate, {said: of(run, column(run, "beta")) for said, run in found.items()}, at="")
    rate.axhline(0.0, color="#888888", linewidth=0.8)
    label(rate, "β that is certified", "t [s]", "[1/s]")
    lines(gain, {said: of(run, column(run, "gain_wrist")) for said, run in found.items()}, at="")
    gain.set_yscale("log")
    label(gain, "gain of the wrist", "t [s]", "λ [1/s]")
    return figure
