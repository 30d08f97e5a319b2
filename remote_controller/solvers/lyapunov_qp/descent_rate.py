"""How fast V shall fall: Ψ of the Lyapunov constraint ∇V·u = −ρΨ.

Gonçalves et al., IEEE T-RO 2020, section III-C. What the constraints leave of it, ρ, is found by
``functions.feasible_rate`` and ``StableQp``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.errors import BadProblemError, UnknownNameError
from hoap3.remote_controller.solvers.base.validation import KERNEL_ARRAYS, number

BoundedForm = Literal["inverse_sqrt_n", "one", "max_norm"]
"""Those of (16): of their size the speeds are bounded."""

Form = Literal[BoundedForm, "tanh", "exponential"]
FORMS: tuple[str, ...] = get_args(Form)
"""Names of all forms; kernels know each by its place."""

ErrorUnit = Literal["m", "cm", "mm"]
UNITS_PER_M: dict[str, float] = {"m": 1.0, "cm": 100.0, "mm": 1000.0}
"""Units of e that (16), (41) and the adaptive γ may be given in."""

GAMMA_SLOPE = 100.0
"""Of the adaptive γ as printed (section V-C), in 1/|∇V|."""


@dataclass(frozen=True)
class DescentRate:
    """Ψ in one of its forms.

    `inverse_sqrt_n` is (16) as printed, u_max·|∇V|₂·R/√n with R = (2/π)·atan(β|e|); `one` leaves
    1/√n out, and with it the bound on the speeds; `max_norm`, u_max·|∇V|∞·R, has the same bound as
    (16) and is up to √n times as fast. `tanh` is η·V·tanh(κ|∇V|₂): near the target V falls like
    1/t² only. `exponential` is η·V: not for places where ∇V vanishes and V does not.

    Attributes:
        form: one of `FORMS`.
        u_max: speed that (16) is scaled by, such as rad/s; > 0.
        beta: β, in 1/|e|; > 0.
        eta: η of `tanh` and `exponential` [1/s]; > 0.
        kappa: κ of `tanh`, in 1/|∇V|; > 0.

    Raises:
        UnknownNameError: there is no such form.
        BadProblemError: a parameter is not a positive number.
    """

    form: str = "inverse_sqrt_n"
    u_max: float = 0.6
    beta: float = 46.0
    eta: float = 1.0
    kappa: float = 10.0

    def __post_init__(self) -> None:
        if self.form not in FORMS:
            raise UnknownNameError("form of Ψ", self.form, FORMS)
        for name in ("u_max", "beta", "eta", "kappa"):
            value = number(name, getattr(self, name))
            if not 0.0 < value < math.inf:
                raise BadProblemError(f"{name} must be positive and finite (found {value}).")

    @property
    def scales(self) -> tuple[float, float]:
        """u_max and β of (16), or η and κ."""
        bounded = self.form in get_args(BoundedForm)
        return (self.u_max, self.beta) if bounded else (self.eta, self.kappa)

    @property
    def arguments(self) -> tuple[int, float, float]:
        """The first ones of `rate_kernel`: the form, then u_max and β of (16), or η and κ."""
        return FORMS.index(self.form), *self.scales

    def __call__(self, V: float, gradient: NDArray[np.float64], error: float) -> float:
        """Ψ ≥ 0 for V, ∇V, (n,), and |e|; not asked for, |e| may be 0 for `tanh` and `exponential`.

        Raises:
            BadProblemError: an argument is not finite or negative, Ψ overflows, or wrong types.
        """
        from hoap3.remote_controller.solvers.lyapunov_qp import descent_rate_kernels

        try:
            psi = descent_rate_kernels.rate_kernel(*self.arguments, V, gradient, error)
        except TypeError as cause:
            raise BadProblemError(f"Ψ: wrong type of argument. {KERNEL_ARRAYS}") from cause
        if math.isnan(psi):
            raise BadProblemError(
                f"Ψ: V and |e| must be finite and not negative (found {V} and {error}), ∇V finite."
            )
        return psi
