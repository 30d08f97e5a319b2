"""Ψ and the adaptive γ in plain numpy: what the kernels here are checked against.

Gonçalves et al., IEEE T-RO 2020.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def adapted_gamma(gradient: Array, far: float, slope: float = 100.0) -> float:
    """γ = (2γ_far/π)·atan(slope·|∇V|) of section V-C, printed with a slope of 100."""
    return 2.0 * far / math.pi * math.atan(slope * float(np.linalg.norm(gradient)))


def descent_rate(
    form: str, V: float, gradient: Array, error: float, first: float, second: float
) -> float:
    """Ψ of a form: (16) with R of (41), first u_max and second β; else η and κ (III-C)."""
    if form == "tanh":
        return first * V * math.tanh(second * float(np.linalg.norm(gradient)))
    if form == "exponential":
        return first * V
    steepness = float(np.linalg.norm(gradient, np.inf if form == "max_norm" else None))
    if form == "inverse_sqrt_n":
        steepness /= math.sqrt(gradient.size)
    return first * steepness * 2.0 / math.pi * math.atan(second * error)
