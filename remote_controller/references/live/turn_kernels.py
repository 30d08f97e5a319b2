"""Compiled: orientations as unit quaternions, and as rotation vectors about one of them.

A quaternion is (x, y, z, w). With Q = q(r) ⊗ A, r is the rotation vector from A to Q in the axes
that both are given in, and ω = Jl(r)·ṙ the angular velocity in these axes; Jl is the left Jacobian
of SO(3): Jl(r)·a = a + b r × a + s r × (r × a), b = (1 − cos θ)/θ², s = (θ − sin θ)/θ³, θ = |r|
(Chirikjian 2012, volume 2, chapter 10).
"""

from __future__ import annotations

import math

from hoap3.protocol.robot.triple_kernels import Triple, cross, plus
from hoap3.protocol.runtime.numba_jit import Matrix, Vector, inlined, kernel

Quadruple = tuple[float, float, float, float]

TERMS = 10  # of series in θ² up to 1: the last is below 1e-21 of the first


@inlined
def times(a: Quadruple, b: Quadruple) -> Quadruple:
    """Product a ⊗ b of quaternions."""
    return (
        a[3] * b[0] + a[0] * b[3] + a[1] * b[2] - a[2] * b[1],
        a[3] * b[1] - a[0] * b[2] + a[1] * b[3] + a[2] * b[0],
        a[3] * b[2] + a[0] * b[1] - a[1] * b[0] + a[2] * b[3],
        a[3] * b[3] - a[0] * b[0] - a[1] * b[1] - a[2] * b[2],
    )


@inlined
def less(a: Quadruple, factor: float, b: Quadruple) -> Quadruple:
    """Difference a − factor·b."""
    return (
        a[0] - factor * b[0],
        a[1] - factor * b[1],
        a[2] - factor * b[2],
        a[3] - factor * b[3],
    )


@inlined
def coefficients(square: float) -> tuple[float, float, float, float, float]:
    """Return b, s, b′(θ)/θ, s′(θ)/θ, and c of Jl⁻¹(r)·a = a − ½ r × a + c r × (r × a), for θ²."""
    if square < 1.0:
        # of θ²ᵏ: ±1/(2k + 2)!, ±1/(2k + 3)! and ±1/(2k + 4)!
        b, s, e, b_rate, s_rate, power, term = 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.5
        before = 0.0
        for k in range(TERMS):
            n = 2.0 * k + 2.0
            next_term = term / (n + 1.0)
            b += power * term
            s += power * next_term
            e += power * next_term / (n + 2.0)
            b_rate -= 2.0 * k * before * term
            s_rate -= 2.0 * k * before * next_term
            before, power = power, -power * square
            term = next_term / (n + 2.0)
        return b, s, b_rate, s_rate, (s - 2.0 * e) / (2.0 * b)
    angle = math.sqrt(square)
    sine, cosine = math.sin(angle), math.cos(angle)
    b, s = (1.0 - cosine) / square, (angle - sine) / (angle * square)
    b_rate = (sine / angle - 2.0 * b) / square
    s_rate = (b - 3.0 * s) / square
    return b, s, b_rate, s_rate, (1.0 - 0.5 * angle * sine / (1.0 - cosine)) / square


@inlined
def bend(r: Triple, rate: Triple, b_rate: float, s: float, s_rate: float) -> Triple:
    """(dJl(r)/dt)·ṙ = ḃ r × ṙ + ṡ r × (r × ṙ) + s ṙ × (r × ṙ)."""
    along = r[0] * rate[0] + r[1] * rate[1] + r[2] * rate[2]
    turned = cross(r, rate)
    first = plus((0.0, 0.0, 0.0), b_rate * along, turned)
    return plus(plus(first, s_rate * along, cross(r, turned)), s, cross(rate, turned))


@kernel()
def from_vector(anchor: Vector, vector: Matrix, place: int, out: Matrix) -> None:
    """Write Q, ω and dω/dt where r, ṙ and r̈ are.

    Args:
        anchor: A.
        vector: r, ṙ and r̈ in its columns from `place` on, (3, …).
        place: first column of both.
        out: written there: Q (4); ω and dω/dt, with a 0 behind them.
    """
    r = vector[0, place], vector[0, place + 1], vector[0, place + 2]
    rate = vector[1, place], vector[1, place + 1], vector[1, place + 2]
    second = vector[2, place], vector[2, place + 1], vector[2, place + 2]
    square = r[0] * r[0] + r[1] * r[1] + r[2] * r[2]
    b, s, b_rate, s_rate, _ = coefficients(square)
    half = 0.5 * math.sqrt(square)
    factor = 0.5 * math.sin(half) / half if half > 0.0 else 0.5
    turn = factor * r[0], factor * r[1], factor * r[2], math.cos(half)
    Q = times(turn, (anchor[0], anchor[1], anchor[2], anchor[3]))
    turned, bent = cross(r, rate), cross(r, second)
    omega = plus(plus(rate, b, turned), s, cross(r, turned))
    alpha = plus(plus(second, b, bent), s, cross(r, bent))
    alpha = plus(alpha, 1.0, bend(r, rate, b_rate, s, s_rate))
    for i in range(4):
        out[0, place + i] = Q[i]
    for i in range(3):
        out[1, place + i], out[2, place + i] = omega[i], alpha[i]
    out[1, place + 3] = out[2, place + 3] = 0.0


@kernel()
def to_vector(anchor: Vector, state: Matrix, place: int, out: Matrix) -> None:
    """Write r, ṙ and r̈, |r| ≤ π, where Q, ω and dω/dt are; the inverse of `from_vector`.

    Args:
        anchor: A, of length 1.
        state: as `from_vector` writes it; Q of length 1.
        place: first column of both.
        out: written there.
    """
    Q = state[0, place], state[0, place + 1], state[0, place + 2], state[0, place + 3]
    x, y, z, w = times(Q, (-anchor[0], -anchor[1], -anchor[2], anchor[3]))
    if w < 0.0:
        x, y, z, w = -x, -y, -z, -w
    sine = math.sqrt(x * x + y * y + z * z)
    angle = 2.0 * math.atan2(sine, w)
    factor = angle / sine if sine > 0.0 else 2.0
    r = factor * x, factor * y, factor * z
    _, s, b_rate, s_rate, c = coefficients(angle * angle)
    omega = state[1, place], state[1, place + 1], state[1, place + 2]
    alpha = state[2, place], state[2, place + 1], state[2, place + 2]
    turned = cross(r, omega)
    rate = plus(plus(omega, -0.5, turned), c, cross(r, turned))
    alpha = plus(alpha, -1.0, bend(r, rate, b_rate, s, s_rate))
    turned = cross(r, alpha)
    second = plus(plus(alpha, -0.5, turned), c, cross(r, turned))
    for i in range(3):
        out[0, place + i], out[1, place + i], out[2, place + i] = r[i], rate[i], second[i]


@kernel()
def normalise(curve: Matrix, place: int) -> None:
    """Make of a curve p(t) of quaternions the orientation p/|p|, and what it turns by, in place.

    With Ω = ṗp⁻¹, A = p̈p⁻¹ and B = p⃛p⁻¹, dΩ/dt = A − Ω² and d²Ω/dt² = B − 2AΩ − ΩA + 2Ω³; twice
    their vectors are ω, dω/dt and d²ω/dt², as the length of p only changes what is no vector.

    Args:
        curve: p, ṗ, p̈ and p⃛ in its columns from `place` on, (4, …).
        place: first of them.
    """
    x, y, z, w = curve[0, place], curve[0, place + 1], curve[0, place + 2], curve[0, place + 3]
    square = x * x + y * y + z * z + w * w
    back = -x / square, -y / square, -z / square, w / square
    length = math.sqrt(square)
    first, second, third = (
        (curve[1, place], curve[1, place + 1], curve[1, place + 2], curve[1, place + 3]),
        (curve[2, place], curve[2, place + 1], curve[2, place + 2], curve[2, place + 3]),
        (curve[3, place], curve[3, place + 1], curve[3, place + 2], curve[3, place + 3]),
    )
    spin, A, B = times(first, back), times(second, back), times(third, back)
    squared = times(spin, spin)
    jerk = less(less(B, 2.0, times(A, spin)), 1.0, times(spin, A))
    jerk = less(jerk, -2.0, times(squared, spin))
    acceleration = less(A, 1.0, squared)
    for i in range(3):
        curve[1, place + i] = 2.0 * spin[i]
        curve[2, place + i] = 2.0 * acceleration[i]
        curve[3, place + i] = 2.0 * jerk[i]
    curve[1, place + 3] = curve[2, place + 3] = curve[3, place + 3] = 0.0
    for i in range(4):
        curve[0, place + i] /= length
