"""Ψ: how fast V shall fall (Gonçalves et al., IEEE T-RO 2020, section III-C).

The Lyapunov constraint is ∇V·u = −ρΨ. Ψ must vanish with the gradient, and no slower (4): the
exponential form does neither and asks for endless speeds where ∇V → 0 but V does not; it is for
constraints that lower ρ there.
"""

from __future__ import annotations

import math

from hoap3.protocol.runtime.numba_jit import Vector, inlined, kernel
from hoap3.remote_controller.solvers.linalg.scaling_kernels import MAX, largest

INVERSE_SQRT_N, ONE, MAX_NORM, TANH, EXPONENTIAL = 0, 1, 2, 3, 4


@inlined
def norm(gradient: Vector) -> float:
    """|gradient|₂ without under- or overflow of squares; inf if something is not finite."""
    top = largest(gradient)
    if not 0.0 < top <= MAX:
        return top
    squares = 0.0
    for i in range(gradient.size):
        squares += (gradient[i] / top) ** 2
    return top * math.sqrt(squares)


@inlined
def reach(error: float, beta: float) -> float:
    """R = (2/π)·atan(β|e|) (41): 0 at the target, towards 1 far from it."""
    return 2.0 / math.pi * math.atan(beta * error)


@inlined
def bounded_rate(gradient: Vector, u_max: float, reached: float, form: int) -> float:
    """(16): Ψ = u_max·|∇V|₂·R/√n; `ONE` leaves 1/√n out; `MAX_NORM`: Ψ = u_max·|∇V|∞·R.

    Without other constraints the largest |u_i| of QP12 is at most u_max·R, but √n times that for
    `ONE`: u*'s largest speed is at most Ψ/|∇V|∞, of which (15) is a consequence.
    """
    if form == MAX_NORM:
        return u_max * largest(gradient) * reached
    if form == INVERSE_SQRT_N:
        return u_max * norm(gradient) / math.sqrt(gradient.size) * reached
    return u_max * norm(gradient) * reached


@inlined
def tanh_rate(V: float, gradient: Vector, eta: float, kappa: float) -> float:
    """Section III-C1: Ψ = η V tanh(κ|∇V|₂).

    For V = |e|²/2 it is of third order in |e| near the target, so V falls like 1/t² there, not
    exponentially; nor does it bound the speeds.
    """
    return eta * V * math.tanh(kappa * norm(gradient))


@kernel()
def rate_kernel(
    form: int, scale: float, bend: float, V: float, gradient: Vector, error: float
) -> float:
    """Ψ, or NaN where something is not finite or negative that must not be, or Ψ overflows.

    Args:
        form: index into `descent_rate.FORMS`.
        scale: u_max of (16), η of the others.
        bend: β of (41), or κ of the tanh form.
        V: value of the Lyapunov function, ≥ 0.
        gradient: ∇V, (n,).
        error: |e|, ≥ 0, for the forms of (16).
    """
    size = largest(gradient)
    if not (0.0 <= V <= MAX and 0.0 <= error <= MAX and size <= MAX):
        return math.nan
    if form == TANH:
        psi = tanh_rate(V, gradient, scale, bend)
    elif form == EXPONENTIAL:
        psi = scale * V
    else:
        psi = bounded_rate(gradient, scale, reach(error, bend), form)
    return psi if 0.0 <= psi <= MAX else math.nan
