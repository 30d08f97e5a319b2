"""The motions of section V, with the shipped controllers in lockstep on the shipped HOAP-3."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.description import COM
from hoap3.robot_emulator.robots import load
from hoap3.tools.report.motion import point_path
from hoap3.tools.reproduce.papers.qp12.reference import CASES, LAWS, Law
from hoap3.tools.simulate import simulate

ROBOT, FRAME = "hoap3", "r_sole"
START_M = (-0.0085, 0.0279, 0.2869)
TARGET_M = (0.01, 0.025, 0.2869)
U_MAX, BETA = 0.6, 46.0  # rad/s, 1/m
POINT = {"point": "com", "reference_frame": FRAME, "target_m": TARGET_M}
TASK = {**POINT, "u_max_rad_s": U_MAX, "beta": BETA}
PERIOD_S = 1e-3
THRESHOLD = 1e-3  # rad/s, from which on a joint is active
SECONDS = {"A": 3.0, "B": 1.0, "C": 1.0}
"""How long each case is followed: until |e| < 1 mm whatever γ."""

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Motion:
    """A motion, one row a tick.

    Attributes:
        v: V [m²].
        psi: Ψ, the decrease that is asked for [m²/s].
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


def move(controller: str, seconds: float, **parameters: object) -> Motion:
    """Bring the centre of mass to m_d with a shipped controller."""
    settings = {"controller": controller, "parameters": {**TASK, **parameters}}
    run = simulate(ROBOT, settings, seconds)
    states = run.states[: len(run.setpoints)]
    u = (run.setpoints["values"] - states["reference"]) / PERIOD_S
    return Motion(
        run.setpoints["v"].copy(), -run.setpoints["v_rate_required"], u, com_path(states["q"])
    )


def follow(case: str, law: Law, seconds: float) -> Motion:
    """One trial."""
    settings = law_settings(law, case)
    return move(settings["controller"], seconds, **settings["parameters"])


def run_trials(
    say: Callable[[str], None] = lambda _: None, seconds: Mapping[str, float] = SECONDS
) -> Trials:
    """Every law in each case."""
    trials = {}
    for case, law in ((case, law) for case in CASES for law in LAWS):
        say(f"case {case}, {law}: {seconds[case]:g} s")
        trials[case, law] = follow(case, law, seconds[case])
    return trials


def plain_pinv() -> Motion:
    """400 ms of u = −10 J⁺e, without Ψ."""
    return move("pinv", 0.4, law="plain", gain_per_s=10.0)


def com_path(positions: Array, seen_from: str = FRAME) -> Array:
    """Centre of mass, (ticks, 3) [m], for joint positions, (ticks, n) [rad]."""
    return point_path(positions, load(ROBOT), COM, seen_from)
