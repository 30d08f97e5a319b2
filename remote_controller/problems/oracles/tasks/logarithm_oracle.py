"""The logarithm e = (ρ, φ) of a pose error and its derivatives.

With Jl(φ) the left Jacobian of SO(3), Jl⁻¹ = I − ½[φ] + c[φ]², c = (1 − h·cot h)/θ², θ = |φ| and
h = θ/2 (Chirikjian 2012, volume 2, chapter 10); [φ] is the matrix of φ × ….
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.special import bernoulli, factorial

Array = NDArray[np.float64]

FLAT = 0.1  # rad: below, a series for (θ − sin θ)/θ³
NEAR = 1.0  # rad: below, series
TERMS = 12  # of which the last is below (NEAR/2π)²⁴ of the first


def skew(a: Array) -> Array:
    """The matrix of a × …, (3, 3)."""
    x, y, z = a.tolist()
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def rotation_vector(R: Array) -> Array:
    """φ (3,) [rad] of a rotation (3, 3), |φ| ≤ π, by its quaternion (v, w) of any length."""
    own = R.diagonal()
    trace, i = float(own.sum()), int(own.argmax())
    turned = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    v, w = turned, 1.0 + trace
    if trace < own[i]:
        v, w = R[i] + R[:, i], float(turned[i])
        v[i] = 1.0 + 2.0 * own[i] - trace
    length = math.sqrt(float(v @ v))
    if length == 0.0:
        return np.zeros(3)
    return math.copysign(2.0 * math.atan2(length, abs(w)) / length, w) * v


def nearer(phi: Array, to: Array) -> Array:
    """Of φ and the vector of the same rotation that goes the other way round, the nearer one."""
    angle = float(np.linalg.norm(phi))
    if angle == 0.0:
        return phi
    other = (1.0 - 2.0 * math.pi / angle) * phi
    return phi if np.linalg.norm(phi - to) <= np.linalg.norm(other - to) else other


def rotation_of(phi: Array) -> Array:
    """exp[φ], (3, 3) (Rodrigues)."""
    cross, angle = skew(phi), math.sqrt(float(phi @ phi))
    return np.eye(3) + _sinc(angle) * cross + 0.5 * _sinc(0.5 * angle) ** 2 * (cross @ cross)


def angular_velocity(phi: Array, rate: Array) -> Array:
    """ω (3,) of a rotation exp[φ] in its own axes, where φ changes at a rate (3,) [rad/s].

    (I − (1 − cos θ)/θ² [φ] + (θ − sin θ)/θ³ [φ]²) dφ/dt.
    """
    square = float(phi @ phi)
    if square < FLAT**2:
        rest = 1.0 / 6.0 - square / 120.0 + square**2 / 5040.0 - square**3 / 362880.0
    else:
        rest = (1.0 - _sinc(math.sqrt(square))) / square
    cross = skew(phi)
    once = cross @ rate
    bent = 0.5 * _sinc(0.5 * math.sqrt(square)) ** 2
    return np.asarray(rate - bent * once + rest * (cross @ once), float)


def _sinc(x: float) -> float:
    """Give sin x/x."""
    return math.sin(x) / x if x else 1.0


def inverse_left(phi: Array) -> tuple[Array, float, float]:
    """Jl⁻¹(φ), (3, 3), c, and dc/dθ over θ."""
    c, slope = curvature(float(phi @ phi))
    cross = skew(phi)
    return np.eye(3) - 0.5 * cross + c * cross @ cross, c, slope


def curvature(square: float) -> tuple[float, float]:
    """Give c and dc/dθ over θ, for θ²."""
    if square < NEAR**2:
        powers = square ** np.arange(TERMS)
        terms, slopes = _series()
        return float(terms @ powers), float(slopes @ powers[:-1])
    h = 0.5 * math.sqrt(square)
    cot = 1.0 / math.tan(h)
    c = (1.0 - h * cot) / square
    # d(h·cot h)/dθ = ½(cot h − h/sin²h)
    slope = -(0.5 * (cot - h * (1.0 + cot * cot)) / (2.0 * h) + 2.0 * c) / square
    return c, slope


@cache
def _series() -> tuple[Array, Array]:
    """Coefficients of c and of dc/dθ over θ in powers of θ²: |B_2k|/(2k)!, k = 1, 2, …."""
    k = np.arange(1, TERMS + 1)
    c = np.abs(bernoulli(2 * TERMS)[2 * k]) / factorial(2 * k)
    return c, 2.0 * k[:-1] * c[1:]


def pose_logarithm(t: Array, R: Array) -> tuple[Array, Array]:
    """E = (ρ, φ), (6,), of the pose (t, R), and how it changes with its motion, (6, 6).

    The second takes (ṫ, ω), R's rate being [ω]R, to ė: φ̇ = Jl⁻¹ω, ρ̇ = Jl⁻¹ṫ + (dJl⁻¹/dt)·t.
    """
    phi = rotation_vector(R)
    inverse, c, slope = inverse_left(phi)
    cross = skew(phi)
    turned = cross @ t
    # of φ̇: −½φ̇ × t + c(φ̇ × (φ × t) + φ × (φ̇ × t)) + (dc/dt)·φ × (φ × t)
    bent = 0.5 * skew(t) - c * (skew(turned) + cross @ skew(t))
    bent += slope * np.outer(cross @ turned, phi)
    rates = np.zeros((6, 6))
    rates[:3, :3], rates[:3, 3:], rates[3:, 3:] = inverse, bent @ inverse, inverse
    return np.concatenate([inverse @ t, phi]), rates
