"""What the paper prints, and what its equations give by an independent computation.

The paper prints curves and hardly a figure. The reference was computed without this code, with the
problem corrected, a 40-digit check of its gains, and the arm of the toolbox that the paper names.
Figures are texts, as they are to be met to their last digit.
"""

from __future__ import annotations

from dataclasses import dataclass

DT_S, LIMIT_RAD_S = 0.01, 6.0
CONSTANT = (2.0, 2.0, 2.0, 1.0)
"""Gains [1/s] that stay as they are."""

SLOW, FAST = 2.0, 8.0
"""β̃ of the paper [1/s]."""

LOW_LIMIT_RAD_S = 4.0
"""The other limit of Fig. 5."""

PERIODS_S = (0.1, 0.05, 0.01, 0.005)
"""Δt of Figs. 6 and 7, the default one among them."""

V_S = (0.1, 0.5, 1.0, 2.0, 3.0)
BETA_S = (0.0, 0.2, 1.0, 3.0)
"""When V and β are compared."""

V_START = "0.4558"


@dataclass(frozen=True)
class Printed:
    """A run of the reference.

    Attributes:
        v: V at `V_S`, "" where it is not known.
        beta: β at `BETA_S` [1/s], or only the first of them.
        speed: greatest |dq| [rad/s].
        held: steps with a joint at its limit, None where it is not known.
    """

    v: tuple[str, ...]
    beta: tuple[str, ...]
    speed: str
    held: int | None = None


TABLE = {
    "constant": Printed((".305", "6.05e-2", "9.1e-3", "2.03e-3", "1.96e-3"), (), "3.68"),
    "slow": Printed(
        (".354", "9.0e-2", "2.1e-2", "9.4e-4", "8.0e-5"), ("1.74", "1.91", "1.89", "1.12"), "3.25"
    ),
    "fast": Printed(
        (".232", "2.5e-3", "2.3e-5", "2.4e-7", "6.5e-9"), ("6.74", "7.71", "3.52", "1.98"), "6", 21
    ),
    "limited": Printed(
        (".288", "9.2e-3", "5.0e-5", "4.2e-7", "1.3e-8"), ("4.65", "4.64", "3.79", "1.90"), "4", 36
    ),
}

BY_PERIOD = {
    0.1: Printed((".264", "4.5e-3", "", "", "2e-10"), ("5.07",), "6"),
    0.05: Printed((".239", "3.0e-3", "", "", "1e-9"), ("6.26",), "6"),
    0.005: Printed((".231", "2.4e-3", "", "", "7e-9"), ("6.80",), "6"),
}

CONSTANT_BETA = ("-0.59", "-0.43")
"""Least and greatest β that the constant gains have, none of which proves anything [1/s]."""

SECOND_GAIN = {SLOW: (95.0, 50.0, 140.0), FAST: (378.0, 204.0, 557.0, 484.0)}
"""λ₄ at the start, at its least, at its greatest after that, and in the end [1/s], by β̃; read off
at a coarse grid of times."""

FIRST_GAIN = {0.1: "5.57", 0.05: "5.47", 0.01: "6.44", 0.005: "6.43"}
"""λ₁ at 0.5 s [1/s], by Δt."""

FIRST_RATE = {0.1: "4.20", 0.05: "5.85"}
"""(1 − V⁺/V)/Δt of the first step [1/s], by Δt."""

REGULARISED_BETA = "1.737"
"""β(0) for β̃ = 2, without any limit near [1/s]."""

TRANSPOSED_BETA = "0.55"
"""β(0) for β̃ = 8 with Jᵀ in (22), where J† is meant [1/s]."""

FRAME_3_V, FRAME_3_ERROR = "0.4528", "5e-4"
TURNED_V, TURNED_V_END = ".377", ".24"
"""V(0), e₂(0) and V in the end with another wrist, and with another base."""

WRIST_WEIGHT, WEIGHTED_BETA = 0.09, "6.0"
"""w of the second task, and β(1 s) for β̃ = 8 with it [1/s]."""

WARM_SHARE = 0.995
"""Of steps at 1 kHz that Newton's method does from the last answer."""


def digit(printed: str) -> float:
    """What one more in the last digit is worth."""
    mantissa, _, exponent = printed.partition("e")
    return float(10.0 ** (int(exponent or 0) - len(mantissa.partition(".")[2])))
