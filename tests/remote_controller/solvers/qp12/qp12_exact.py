"""QP12 in exact fractions: its answer by the reference, and the conditions (31) and (32)."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray
from support.oracles.qp12_oracle import qp12


def exact_qp12(gradient: NDArray[np.float64], decrease: float, gamma: float) -> list[Fraction]:
    """The answer without rounding, for the very doubles that are given."""
    return qp12([Fraction(x) for x in gradient], Fraction(decrease), Fraction(gamma))


def exact_kkt_residual(
    gradient: NDArray[np.float64], decrease: float, gamma: float, u: NDArray[np.float64]
) -> float:
    """Relative violation of (31) and (32), in fractions; for decrease ≠ 0.

    λ is taken from the first joint with the largest gradient, and stationarity is relative to λA.
    """
    b, g = abs(Fraction(decrease)), Fraction(gamma)
    a = [abs(Fraction(x)) for x in gradient]
    x = [
        Fraction(u_i) * (-1 if (v > 0) == (decrease > 0) else 1)
        for u_i, v in zip(u, gradient, strict=True)
    ]
    power = [a_i * x_i for a_i, x_i in zip(a, x, strict=True)]
    worst = abs(sum(power) - b) / (sum(map(abs, power)) + b)
    A = max(a)
    reach = g + (1 - g) * x[a.index(A)]  # λA
    if reach <= 0:
        return 1.0
    for a_i, x_i in zip(a, x, strict=True):
        pull = reach * a_i / A - (1 - g) * x_i  # must lie in γ sgn(x_i)
        bound = g if x_i > 0 or (x_i == 0 and pull > 0) else -g
        gap = abs(pull - bound) if x_i != 0 or abs(pull) > g else Fraction(0)
        worst = max(worst, gap / reach)
    return float(worst)


def relative_error(u: NDArray[np.float64], exact: Sequence[Fraction]) -> float:
    """Largest error of a component, relative to the largest component of the exact answer."""
    scale = max(map(abs, exact))
    gap = max(abs(Fraction(u_i) - x) for u_i, x in zip(u, exact, strict=True))
    return float(gap / scale) if scale else float(gap)
