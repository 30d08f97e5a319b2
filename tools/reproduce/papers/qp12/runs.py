"""The motions of section V, with the shipped controllers in lockstep on the shipped HOAP-3."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.robot.description import COM
from hoap3.robot_emulator.robots import load
from hoap3.tools.analysis.report.motion import point_path
from hoap3.tools.reproduce.figures import Array
from hoap3.tools.reproduce.papers import Say
from hoap3.tools.services.simulate import simulate

ROBOT, FRAME = "hoap3", "r_sole"
START_M = (-0.0085, 0.0279, 0.2869)
TARGET_M = (0.01, 0.025, 0.2869)
U_MAX, BETA = 0.6, 46.0  # rad/s, 1/m
POINT = {"point": "com", "reference_frame": FRAME, "target_m": TARGET_M}
TASK = {**POINT, "u_max_rad_s": U_MAX, "beta": BETA}
PERIOD_S = 1e-3
THRESHOLD = 1e-3  # rad/s, from which on a joint is active
ROUNDED_M = 1e-12  # |e| that is rounding

CASES = {
    "A": {"psi_scale": "inverse_sqrt_n"},
    "B": {"psi_scale": "inverse_sqrt_n", "error_unit": "cm"},
    "C": {"psi_scale": "one"},
}
"""Readings of (16): A as printed with e in metres, B as printed with e in centimetres, and C in
metres without 1/√n. The paper prints no unit of e."""

SECONDS = {"A": 3.0, "B": 1.0, "C": 1.0}
"""How long each case is followed: until |e| < 1 mm for every γ."""


@dataclass(frozen=True)
class Law:
    """How u is chosen: QP12 with γ, or the pseudo-inverse where `gamma` is None.

    Attributes:
        gamma: γ, or γ_far where adaptive.
        adaptive: γ = (2γ_far/π)·atan(100|∇V|), as in the paper's figures.
    """

    gamma: float | None
    adaptive: bool = True

    def __str__(self) -> str:
        if self.gamma is None:
            return "PINV"
        kind = "" if self.gamma == 0.0 else ", adaptive" if self.adaptive else ", constant"
        return f"γ = {self.gamma:g}{kind}"


PINV, EVEN, SPARSE = Law(None), Law(0.0), Law(0.99)
SPARSE_CONSTANT = Law(0.99, adaptive=False)
TRIALS = tuple(Law(gamma) for gamma in (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.99))
"""The 11 trials of section V-C."""

LAWS = (PINV, *TRIALS, Law(0.1, adaptive=False), SPARSE_CONSTANT)
"""Those that are done in every case."""


@dataclass(frozen=True, eq=False)
class Motion:
    """A motion, one row a tick.

    Attributes:
        v: V [m²].
        psi: Ψ, the decrease that is required [m²/s].
        u: joint velocities, (ticks, n) [rad/s].
        com: m(q) in the right sole's frame, (ticks, 3) [m].
    """

    v: Array
    psi: Array
    u: Array
    com: Array

    @property
    def time_ms(self) -> Array:
        """Since the start."""
        return np.arange(len(self.v), dtype=np.float64) * (PERIOD_S * 1e3)

    @property
    def error(self) -> Array:
        """|e| [m]."""
        return np.asarray(np.sqrt(2.0 * self.v), np.float64)

    @property
    def active(self) -> NDArray[np.bool_]:
        """Which joints are active, (ticks, n)."""
        return np.asarray(np.abs(self.u) >= THRESHOLD)

    @property
    def active_count(self) -> Array:
        """How many."""
        return np.asarray(self.active.sum(axis=1), np.float64)

    def mean_active(self, begin: int, end: int) -> float:
        """Mean number of active joints from one tick to another."""
        return float(self.active_count[begin:end].mean())

    @property
    def arrival_ms(self) -> float:
        """Time until |e| < 1 mm, or NaN."""
        ticks = len(self.until_a_millimetre.v)
        return ticks * PERIOD_S * 1e3 if ticks < len(self.v) else math.nan

    @property
    def until_a_millimetre(self) -> Motion:
        """The part with |e| ≥ 1 mm."""
        there = self.error < 1e-3
        end = int(np.argmax(there)) if there.any() else len(there)
        return Motion(self.v[:end], self.psi[:end], self.u[:end], self.com[:end])

    @property
    def rises(self) -> int:
        """Ticks at which V rises, until |e| is rounding."""
        return int(((np.diff(self.v) > 0.0) & (self.error[1:] > ROUNDED_M)).sum())


Trials = Mapping[tuple[str, Law], Motion]


def joint_names() -> tuple[str, ...]:
    """Of HOAP-3, in the order of `Motion.u`."""
    return load(ROBOT).joint_names


def sole() -> Array:
    """Corners of the right sole in its own frame, (4, 2) [m]."""
    (found,) = (each for each in load(ROBOT).soles if each.frame == FRAME)
    return np.array(found.polygon)


def law_settings(law: Law, case: str = "A") -> dict[str, Any]:
    """Settings of qp12 with γ, or of pinv."""
    if law.gamma is None:
        return {"controller": "pinv", "parameters": {**TASK, **CASES[case]}}
    gamma = {"gamma": law.gamma, "adaptive_gamma": law.adaptive}
    return {"controller": "qp12", "parameters": {**TASK, **CASES[case], **gamma}}


def move(settings: Mapping[str, Any], seconds: float) -> Motion:
    """Bring the centre of mass to m_d with a shipped controller."""
    run = simulate(ROBOT, settings, seconds)
    sent, states = run.setpoints, run.states[: len(run.setpoints)]
    u = (sent["values"] - states["reference"]) / PERIOD_S
    com = point_path(states["q"], load(ROBOT), COM, FRAME)
    return Motion(sent["v"].copy(), -sent["v_rate_required"], u, com)


def run_trials(say: Say) -> Trials:
    """Every law in each case."""
    trials = {}
    for case, law in ((case, law) for case in CASES for law in LAWS):
        say(f"case {case}, {law}: {SECONDS[case]:g} s")
        trials[case, law] = move(law_settings(law, case), SECONDS[case])
    return trials


def plain_pinv() -> Motion:
    """400 ms of u = −10 J⁺e, without Ψ."""
    parameters = {**TASK, "law": "plain", "gain_per_s": 10.0}
    return move({"controller": "pinv", "parameters": parameters}, 0.4)
