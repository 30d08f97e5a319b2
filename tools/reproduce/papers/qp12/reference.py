"""What the QP12 paper's equations give for HOAP-3, by an independent computation.

The paper does not publish its posture, so these figures hold for ours, `q0`, whose centre of mass
is the paper's. A joint is active from 0.001 rad/s on; means are over the first 400 ms. Digits are
as that computation prints them.
"""

from __future__ import annotations

from dataclasses import dataclass

SCALES = {"A": "inverse_sqrt_n", "C": "one"}
"""Case A is Ψ as printed, u_max|∇V|R/√n (16); case C leaves 1/√n out."""


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

V_AT_400_MS = {"A": (0.445, 0.445), "C": (0.017, 0.020)}
"""V(400 ms)/V(0), least and greatest over γ."""

MILLIMETRE_MS = {
    ("A", EVEN): 2744,
    ("A", SPARSE): 2852,
    ("C", EVEN): 598,
    ("C", SPARSE): 591,
}
"""Time until |e| < 1 mm."""

ACTIVE = {
    ("A", PINV): 11.9,
    ("A", EVEN): 10.5,
    ("A", Law(0.1)): 2.0,
    ("A", Law(0.1, adaptive=False)): 1.5,
    ("A", Law(0.2)): 2.0,
    ("A", Law(0.3)): 2.0,
    **{("A", Law(gamma)): 1.0 for gamma in (0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.99)},
    ("A", SPARSE_CONSTANT): 1.0,
    ("C", PINV): 13.0,
    ("C", EVEN): 12.5,
    ("C", Law(0.1)): 6.0,
    ("C", Law(0.1, adaptive=False)): 2.4,
    ("C", Law(0.2)): 4.6,
    ("C", Law(0.3)): 3.3,
    ("C", Law(0.4)): 2.6,
    ("C", Law(0.5)): 2.6,
    **{("C", Law(gamma)): 2.5 for gamma in (0.6, 0.7, 0.8, 0.9, 0.99)},
    ("C", SPARSE_CONSTANT): 1.0,
}
"""Mean number of active joints."""

ACTIVE_AT_START = {("C", PINV): 16.0, ("C", EVEN): 17.0}
ACTIVE_AFTER_400_MS = {("C", SPARSE): 3.2}
PLAIN_PINV = {"active at the start": 18, "greatest |u_i|": 0.59, "active over 200 ms": 14.7}
"""u = −10 J⁺e, without Ψ."""

ANKLE_SHARES = {"r_ankle_pitch": 0.73, "r_ankle_roll": 0.27}
"""Of the time that joint is the one that moves, at constant γ = 0.99, in A and in C."""

FASTEST_RAD_S = 0.343
"""Greatest |u_i| of all runs: C, constant γ = 0.99."""

SWITCHES_PER_S = {SPARSE_CONSTANT: 1000.0, SPARSE: 1.7}
"""How often some joint starts or stops: sliding, and with adaptive γ, in C."""

SOLE_MARGIN_M = 0.0086
"""From m(q0) to the nearest edge of the sole; m_d is further inside."""
