"""Convergence rate laws: the forms of Ψ in the Lyapunov constraint ∇V·u = −ρΨ, and their units.

Gonçalves et al., IEEE T-RO 2020, section III-C. ``StableQp`` finds ρ, what the constraints leave.
`descent_rate_kernels` evaluates Ψ.
"""

from __future__ import annotations

from typing import Literal, get_args

BoundedForm = Literal["inverse_sqrt_n", "one", "max_norm"]
"""Those of (16), by u_max and β.

`inverse_sqrt_n` is (16) as printed, u_max·|∇V|₂·R/√n with R = (2/π)·atan(β|e|); `one` leaves 1/√n
out, and with it the bound on the speeds; `max_norm`, u_max·|∇V|∞·R, has the same bound as (16) and
is up to √n times as fast.
"""

Form = Literal[BoundedForm, "tanh", "exponential"]
"""All forms; two by η and κ.

`tanh` is η·V·tanh(κ|∇V|₂): near the target V falls like 1/t² only. `exponential` is η·V: not for
places where ∇V vanishes and V does not.
"""
FORMS: tuple[str, ...] = get_args(Form)
"""Names of all forms; kernels know each by its place."""

ErrorUnit = Literal["m", "cm", "mm"]
UNITS_PER_M: dict[str, float] = {"m": 1.0, "cm": 100.0, "mm": 1000.0}
"""Units of e that (16), (41) and the adaptive γ may be given in."""

GAMMA_SLOPE = 100.0
"""Of the adaptive γ as printed (section V-C), in 1/|∇V|."""
