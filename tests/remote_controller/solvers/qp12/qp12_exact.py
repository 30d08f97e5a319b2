"""QP12 in any arithmetic: the algorithms as printed, and optimality in exact fractions.

Gonçalves et al., IEEE T-RO 2020, Algorithms 1 and 2 and the conditions (31) and (32).
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

Number = TypeVar("Number", float, Fraction)


def printed_qp12(gradient: Sequence[Number], b: Number, gamma: Number) -> list[Number]:
    """Algorithm 2 as printed, for b > 0 and γ < 1, in the arithmetic of its arguments."""
    order = sorted(range(len(gradient)), key=lambda i: -abs(gradient[i]))
    x = printed_canonical_qp12([abs(gradient[i]) for i in order], b, gamma)
    u = [gradient[0] * 0] * len(gradient)
    for x_i, j in zip(x, order, strict=True):
        u[j] = -x_i if gradient[j] > 0 else x_i
    return u


def printed_canonical_qp12(a: Sequence[Number], b: Number, gamma: Number) -> list[Number]:
    """Algorithm 1 as printed, with its numbering from 1."""
    m = len(a)
    alpha = (1 - gamma) * b + gamma * a[0]
    beta = a[0] * a[0]
    lamda = alpha / beta
    M = 1
    while m >= M + 1 and (a[M - 1] * lamda <= gamma or gamma < a[M] * lamda):
        M += 1
        alpha += gamma * a[M - 1]
        beta += a[M - 1] * a[M - 1]
        lamda = alpha / beta
    return [(lamda * a_i - gamma) / (1 - gamma) for a_i in a[:M]] + [a[0] * 0] * (m - M)


def exact_qp12(gradient: NDArray[np.float64], decrease: float, gamma: float) -> list[Fraction]:
    """The answer without rounding, for the very doubles that are given."""
    v, b, g = [Fraction(x) for x in gradient], Fraction(decrease), Fraction(gamma)
    if b == 0:
        return [Fraction(0)] * len(v)
    if b < 0:
        return [-u for u in exact_qp12(gradient, -decrease, gamma)]
    if g < 1:
        return printed_qp12(v, b, g)
    top = max(abs(x) for x in v)
    tied = sum(abs(x) == top for x in v)
    return [-b / (tied * x) if abs(x) == top else Fraction(0) for x in v]


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
