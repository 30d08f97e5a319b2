"""One compiled call per tick: gradient, Ψ, γ, u and certificate (QP12, section V)."""

from __future__ import annotations

import math

from hoap3.protocol.messages import FloatArray
from hoap3.protocol.runtime.numba_jit import inlined, kernel
from hoap3.remote_controller.solvers.lyapunov_qp.descent_rate_kernels import bounded_rate, reach
from hoap3.remote_controller.solvers.qp12.pinv_kernels import solve_pinv, solve_pinv_plain
from hoap3.remote_controller.solvers.qp12.qp12_kernels import qp12_kkt_residual, solve_qp12


@inlined
def required_decrease(
    error: FloatArray,
    jacobian: FloatArray,
    u_max: float,
    beta: float,
    psi_scale: int,
    gradient_out: FloatArray,
    certificate_out: FloatArray,
) -> float:
    """∇V = Jᵀe (39) and Ψ by `bounded_rate`, (16); V and the required V̇ = −Ψ are written too."""
    m, n = jacobian.shape
    squares = 0.0
    for row in range(m):
        squares += error[row] * error[row]
    for i in range(n):
        slope = 0.0
        for row in range(m):
            slope += jacobian[row, i] * error[row]
        gradient_out[i] = slope
    psi = bounded_rate(gradient_out, u_max, reach(math.sqrt(squares), beta), psi_scale)
    certificate_out[0] = 0.5 * squares
    certificate_out[1] = -psi
    return psi


@inlined
def adapted_gamma(gradient: FloatArray, gamma_far: float, slope: float) -> float:
    """Section V-C: γ = (2γ_far/π)·atan(slope·|∇V|₂), 0 where the gradient is; γ_far for slope 0."""
    if slope == 0.0:
        return gamma_far
    squares = 0.0
    for i in range(gradient.size):
        squares += gradient[i] * gradient[i]
    return 2.0 * gamma_far / math.pi * math.atan(slope * math.sqrt(squares))


@inlined
def rate_and_margin(
    gradient: FloatArray, u: FloatArray, u_max: float, certificate_out: FloatArray
) -> None:
    """Write the predicted V̇ = ∇V·u, ρ = 1, and the margin u_max − max|u|."""
    rate, fastest = 0.0, 0.0
    for i in range(u.size):
        rate += gradient[i] * u[i]
        fastest = max(fastest, abs(u[i]))
    certificate_out[2] = rate
    certificate_out[3] = 1.0
    certificate_out[4] = u_max - fastest


@kernel("i8(f8[::1], f8[:,::1], f8, f8, i8, f8, f8, f8[::1], f8[::1], f8[::1])")
def qp12_descent(
    error: FloatArray,
    jacobian: FloatArray,
    u_max: float,
    beta: float,
    psi_scale: int,
    gamma_far: float,
    slope: float,
    gradient_out: FloatArray,
    u_out: FloatArray,
    certificate_out: FloatArray,
) -> int:
    """Find u of (40), with constant γ or γ = (2γ_far/π)·atan(slope·|∇V|).

    Args:
        error: e, (m,) [m].
        jacobian: J, (m, n) [m/rad].
        u_max: [rad/s].
        beta: of (41) [1/m].
        psi_scale: form of Ψ, see `bounded_rate`.
        gamma_far: γ, or γ_far where it is adaptive.
        slope: of the adaptive γ, in 1/|∇V|; 0: γ is constant.
        gradient_out: ∇V, (n,).
        u_out: u, (n,) [rad/s].
        certificate_out: V, required V̇, predicted V̇, ρ, margin, KKT residual.

    Returns:
        Status of `solve_qp12`.
    """
    decrease = required_decrease(
        error, jacobian, u_max, beta, psi_scale, gradient_out, certificate_out
    )
    gamma = adapted_gamma(gradient_out, gamma_far, slope)
    status = solve_qp12(gradient_out, decrease, gamma, u_out)
    rate_and_margin(gradient_out, u_out, u_max, certificate_out)
    certificate_out[5] = qp12_kkt_residual(gradient_out, decrease, gamma, u_out)
    return status


@kernel(
    "i8(f8[::1], f8[:,::1], f8, f8, i8, f8, f8[:,::1], f8[::1], f8[::1], f8[::1])",
)
def pinv_descent(
    error: FloatArray,
    jacobian: FloatArray,
    u_max: float,
    beta: float,
    psi_scale: int,
    gain: float,
    work: FloatArray,
    gradient_out: FloatArray,
    u_out: FloatArray,
    certificate_out: FloatArray,
) -> int:
    """Find u along −J⁺e: with the same V̇ = −Ψ as QP12 where `gain` is 0, else u = −gain·J⁺e.

    Arguments and result as for `qp12_descent`; `gain` is in 1/s, and `work` has the shape that
    `pinv_kernels.work_shape` gives. With a gain, V̇ ≤ 0 is all that is required. The residual is
    that of the equation eᵀJu = V̇: relative, and 0 where nothing is required.
    """
    decrease = required_decrease(
        error, jacobian, u_max, beta, psi_scale, gradient_out, certificate_out
    )
    if gain == 0.0:
        status, _ = solve_pinv(jacobian, error, decrease, work, u_out)
    else:
        status, _ = solve_pinv_plain(jacobian, error, gain, work, u_out)
        decrease = 0.0
        certificate_out[1] = 0.0
    rate_and_margin(gradient_out, u_out, u_max, certificate_out)
    scale = decrease
    for i in range(u_out.size):
        scale += abs(gradient_out[i] * u_out[i])
    missing = abs(certificate_out[2] + decrease) if gain == 0.0 else max(0.0, certificate_out[2])
    certificate_out[5] = missing / scale if missing > 0.0 else 0.0
    return status
