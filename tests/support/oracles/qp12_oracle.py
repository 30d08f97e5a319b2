"""QP12 as printed, with bounds, and the pseudo-inverse: what the kernels here are checked against.

Gonçalves et al., IEEE T-RO 2020. QP12 takes any arithmetic: with fractions an answer is exact, with
doubles (28) cancels where λa is near γ, which is why the kernels evaluate another form of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Number = TypeVar("Number", float, Fraction)

RANK_TOLERANCE = 1e-12  # of the largest singular value


def qp12(gradient: Sequence[Number], decrease: Number, gamma: Number) -> list[Number]:
    """(26) by Algorithm 2: sort, canonical QP12, signs; u is odd in the decrease: Φ(−u) = Φ(u).

    Raises:
        ZeroDivisionError: the gradient is zero, the decrease is not.
    """
    nothing = decrease * 0
    size = [abs(slope) for slope in gradient]
    order = sorted(range(len(size)), key=lambda i: -size[i])
    sign = -1 if decrease > 0 else 1
    u = [nothing] * len(size)
    if decrease == 0:
        return u
    for x, i in zip(canonical([size[i] for i in order], abs(decrease), gamma), order, strict=True):
        u[i] = sign * x if gradient[i] > 0 else -sign * x
    return u


def canonical(a: list[Number], b: Number, gamma: Number) -> list[Number]:
    """Algorithm 1 as printed, numbered from 1: a falls, b > 0.

    γ = 1 is the limit γ → 1, which splits evenly over ties; Remark 7 takes one joint, M = 1.
    """
    m, nothing = len(a), b * 0
    if gamma == 1:
        tied = a.count(a[0])
        return [b / (tied * a[0])] * tied + [nothing] * (m - tied)
    alpha = (1 - gamma) * b + gamma * a[0]
    beta = a[0] * a[0]
    lamda = alpha / beta  # (29)
    M = 1
    while m >= M + 1 and (a[M - 1] * lamda <= gamma or gamma < a[M] * lamda):  # (30)
        M += 1
        alpha += gamma * a[M - 1]
        beta += a[M - 1] * a[M - 1]
        lamda = alpha / beta
    return [(lamda * a_i - gamma) / (1 - gamma) for a_i in a[:M]] + [nothing] * (m - M)  # (28)


def bounded_qp12(
    gradient: Sequence[Number],
    decrease: Number,
    gamma: Number,
    lower: Sequence[float],
    upper: Sequence[float],
    weights: Sequence[Number],
) -> list[Number] | None:
    """(26) in W u, lower ≤ 0 ≤ upper: clamp who is beyond, take off what that delivers, repeat.

    None where the decrease is more than bounds allow, Σ |∂V/∂q_i|·limit_i (closed form of (7)).
    """
    down = [(slope > 0) == (decrease > 0) for slope in gradient]
    limit = [-lo if falls else up for lo, up, falls in zip(lower, upper, down, strict=True)]
    rest, u = abs(decrease), [decrease * 0] * len(limit)
    free = [i for i, slope in enumerate(gradient) if slope != 0]
    while rest > 0:
        if not free:
            return None
        step = qp12([abs(gradient[i]) / weights[i] for i in free], -rest, gamma)
        speed = {i: x / weights[i] for i, x in zip(free, step, strict=True)}
        beyond = [i for i in free if speed[i] > limit[i]] or free
        done = beyond is free
        for i in beyond:
            u[i] = speed[i] if done else type(rest)(limit[i])
            rest -= abs(gradient[i]) * u[i]
        if done:
            break
        free = [i for i in free if i not in beyond]
    return [-x if falls else x for x, falls in zip(u, down, strict=True)]


def pinv_plain(jacobian: Array, error: Array, gain: float) -> Array:
    """−gain·J⁺e by a singular value decomposition."""
    u: Array = -gain * (np.linalg.pinv(jacobian, rtol=RANK_TOLERANCE) @ error)
    return u


def pinv(jacobian: Array, error: Array, decrease: float) -> Array:
    """Along −J⁺e, with eᵀJ u = −decrease."""
    u = pinv_plain(jacobian, error, 1.0)
    return -decrease / float(error @ jacobian @ u) * u
