"""Pictures of Φ: which joints do the work."""

from __future__ import annotations

from typing import Any

from drawing import joints, label, lines, of, panels
from matplotlib.figure import Figure
from runs import JOINTS, WITHIN, Run, qp12, run

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
