"""What surrounds OSQP in a tick: the problem (40) before it, the certificate after it."""

from __future__ import annotations

from hoap3.protocol.messages import FloatArray
from hoap3.protocol.runtime.numba_jit import kernel
from hoap3.remote_controller.controllers.qp12.lyapunov_descent_kernels import (
    adapted_gamma,
    rate_and_margin,
    required_decrease,
)
from hoap3.remote_controller.solvers.qp12.qp12_kernels import qp12_kkt_residual


@kernel("Tuple((f8, f8))(f8[::1], f8[:,::1], f8, f8, i8, f8, f8, f8[::1], f8[::1])")
def osqp_problem(
    error: FloatArray,
    jacobian: FloatArray,
    u_max: float,
    beta: float,
    psi_scale: int,
    gamma_far: float,
    slope: float,
    gradient_out: FloatArray,
    certificate_out: FloatArray,
) -> tuple[float, float]:
    """Ψ and γ; ∇V, V and the required V̇ are written. Arguments as those of `qp12_descent`."""
    decrease = required_decrease(
        error, jacobian, u_max, beta, psi_scale, gradient_out, certificate_out
    )
    return decrease, adapted_gamma(gradient_out, gamma_far, slope)


@kernel("void(f8[::1], f8, f8, f8, f8[::1], f8[::1])")
def osqp_certificate(
    gradient: FloatArray,
    decrease: float,
    gamma: float,
    u_max: float,
    u: FloatArray,
    certificate_out: FloatArray,
) -> None:
    """Write what u, whoever found it, is worth: predicted V̇, ρ, margin, KKT residual."""
    rate_and_margin(gradient, u, u_max, certificate_out)
    certificate_out[5] = qp12_kkt_residual(gradient, decrease, gamma, u)
