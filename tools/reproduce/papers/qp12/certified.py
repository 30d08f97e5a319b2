"""Shipped configs of `stable_qp` in lockstep, and the certificates of their answers."""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hoap3.remote_controller.config import read_config
from hoap3.remote_controller.controllers.base import STATUS
from hoap3.remote_controller.controllers.certificate import PROVED
from hoap3.tools.reproduce.figures import COLOURS, INK, Array, Axis, Curve, Panel
from hoap3.tools.reproduce.papers.qp12.experiments import PERIOD_S, ROBOT
from hoap3.tools.reproduce.rows import Row, bounded
from hoap3.tools.show.certificate_count import CertificateCount
from hoap3.tools.simulate import simulate

SHOWN_EVERY = 10
"""Of so many ticks one is drawn."""

ROUNDING = 1e-13
"""Of V, relative: what is left of positions of 0.1 m at an error of 1 mm."""

Config = dict[str, Any]


@dataclass(frozen=True, eq=False)
class CertifiedRun:
    """A motion and what was proved of it, one row a tick.

    Attributes:
        q: joint positions, (ticks, n) [rad].
        v: V.
        psi: Ψ.
        required, given: V̇ that was asked for, −ρΨ, and that of the answer.
        rho: ρ.
        margin: smallest of all constraints, each in its own unit.
        status: of the certificate, as in Setpoint.msg.
        held: conditions at the end, by name.
    """

    q: Array
    v: Array
    psi: Array
    required: Array
    given: Array
    rho: Array
    margin: Array
    status: NDArray[np.int64]
    held: frozenset[str]

    @property
    def time_s(self) -> Array:
        """Since the start."""
        return np.arange(len(self.v), dtype=np.float64) * PERIOD_S

    @property
    def error(self) -> Array:
        """|e|, for V = |e|²/2."""
        return np.asarray(np.sqrt(2.0 * self.v), np.float64)

    @property
    def rises(self) -> int:
        """Ticks at which V rises by more than rounding."""
        return int((np.diff(self.v) > ROUNDING * self.v[:-1]).sum())

    @property
    def unproved(self) -> int:
        """Ticks without a certificate."""
        return int((~np.isin(self.status, PROVED)).sum())


def config(name: str) -> Config:
    """A copy of a shipped config, to be changed."""
    return deepcopy(read_config(name)[0])


def constraint(content: Config, kind: str) -> dict[str, Any]:
    """Parameters of a config's first constraint of a kind."""
    entries = content["parameters"]["constraints"]
    entry: dict[str, dict[str, Any]] = next(e for e in entries if e["constraint"] == kind)
    return entry.get("parameters", {})


def run(content: Config, seconds: float) -> CertifiedRun:
    """Run a controller against HOAP-3."""
    done = simulate(ROBOT, content, seconds)
    said, count = done.setpoints, CertificateCount()
    for record in done.records:
        count.add(record)
    return CertifiedRun(
        q=done.states["q"][: len(said)].copy(),
        v=said["v"].copy(),
        psi=said["extra"][:, done.controller.extra_names.index("psi")].copy(),
        required=said["v_rate_required"].copy(),
        given=said["v_rate_predicted"].copy(),
        rho=said["rho"].copy(),
        margin=said["margin"].copy(),
        status=said["solver_status"].astype(np.int64),
        held=count.present,
    )


def falls(item: str, done: CertifiedRun) -> Row:
    """V must not rise."""
    why = "As the paper: stable by design, to the rounding of V"
    return bounded(f"{item}, ticks at which V rises", 0, done.rises, (0.0, 0.0), why)


def certified(item: str, done: CertifiedRun, least_margin: float = -1e-9) -> list[Row]:
    """Rows that hold for any motion that is stable by design."""
    why = "As the paper: V̇ = −ρΨ, and every answer has its proof"
    return [
        bounded(f"{item}, ticks without a certificate", 0, done.unproved, (0.0, 0.0), why),
        bounded(
            f"{item}, smallest margin of all constraints",
            "at least 0",
            float(done.margin.min()),
            (least_margin, None),
            "As the paper: (25) makes what is allowed invariant. Each margin in its own unit",
        ),
    ]


def panels(runs: dict[str, CertifiedRun]) -> dict[str, Panel]:
    """What is proved of motions: panels of V, V̇, ρ, margin and status, by name.

    Args:
        runs: one or two, by their names in the legend.
    """

    def panel(
        name: str,
        title: str,
        y: Axis,
        values: Callable[[CertifiedRun], Array],
        given: Callable[[CertifiedRun], Array] | None = None,
    ) -> Panel:
        curves = []
        for (label, done), colour, dash in zip(runs.items(), COLOURS, ("-", "--"), strict=False):
            curves.append(time_curve(label, done, values(done), colour=colour, dash=dash))
            if given is not None:
                style: dict[str, Any] = {"colour": INK, "dash": ":", "legend": "V̇ as given"}
                curves.append(time_curve(f"{label}, given", done, given(done), **style))
        return Panel(name, title, time_axis(runs), y, curves)

    names = tuple(sorted(STATUS, key=lambda name: STATUS[name]))
    shown = tuple(name.replace("_", " ") for name in names)
    found = [
        panel("v", "V", Axis("V_m2", "V [m²]", log=True), lambda run: run.v),
        panel("v_rate", "−V̇, required and given (dotted)",
              Axis("minus_V_rate_m2_per_s", "−V̇ [m²/s]", log=True),
              lambda run: -run.required, lambda run: -run.given),
        panel("rho", "ρ, the share of Ψ", Axis("rho", "ρ", (-0.05, 1.1)), lambda run: run.rho),
        panel("margin", "smallest margin of all constraints",
              Axis("margin_m_or_rad", "margin [m or rad]"), lambda run: run.margin),
        panel("status", "certificate", Axis("status", "", (-0.5, len(shown) - 0.5), names=shown),
              lambda run: run.status.astype(np.float64)),
    ]  # fmt: skip
    return {each.name: each for each in found}


def time_curve(label: str, done: CertifiedRun, values: Array, **style: Any) -> Curve:
    """A curve over a run's time, thinned for drawing."""
    return Curve(label, done.time_s[::SHOWN_EVERY], values[::SHOWN_EVERY], **style)


def time_axis(runs: dict[str, CertifiedRun]) -> Axis:
    """From the start to the end of the longest."""
    end = max(len(done.v) for done in runs.values()) * PERIOD_S
    return Axis("time_s", "time [s]", (0.0, end))
