"""Compiled: what task-space inverse dynamics asks for (Del Prete, IEEE RA-L 2018, (34))."""

from __future__ import annotations

import math

from hoap3.protocol.messages import FloatArray
from hoap3.protocol.runtime.numba_jit import inlined, kernel
from hoap3.remote_controller.tasks.se3_kernels import (
    ANTIPODE,
    SMALL,
    Vector,
    cross,
    dot,
    exponential,
    inverse_left,
    log_rate,
    logarithm,
    plus,
    transposed_times,
)

ON_THE_WAY, AT_HALF_A_TURN, NOT_FINITE = 0, 1, 2


@inlined
def _curvatures(angle: float, cotangent: float) -> tuple[float, float]:
    """Second-order terms c of Jl⁻¹ and d of its rate (`tasks.se3_kernels`)."""
    square = angle * angle
    if angle < SMALL:
        c = (1.0 + square / 60.0 * (1.0 + square / 42.0 * (1.0 + square / 40.0))) / 12.0
        return c, (1.0 + square / 21.0 * (1.0 + 3.0 * square / 80.0)) / 360.0
    slope = -2.0 / angle + 0.5 * cotangent + 0.25 * angle * (1.0 + cotangent * cotangent)
    return (1.0 - 0.5 * angle * cotangent) / square, slope / (angle * square)


@kernel("i8(f8[::1], f8[::1])")
def check_finite(q: FloatArray, dq: FloatArray) -> int:
    """`NOT_FINITE` unless all of q and dq are."""
    for i in range(q.size):
        if not (math.isfinite(q[i]) and math.isfinite(dq[i])):
            return NOT_FINITE
    return ON_THE_WAY


@kernel("void(f8[::1], f8[:,::1])")
def rotation_of(vector: FloatArray, out: FloatArray) -> None:
    """Write the rotation, (3, 3), of a rotation vector, (3,) [rad]."""
    exponential((vector[0], vector[1], vector[2]), (0.0, 0.0, 0.0), out)


@kernel(
    "Tuple((f8, i8))(f8[::1], f8[:,:], f8[::1], f8[:,::1], f8[::1], f8[::1], f8, f8, f8[:,::1],"
    " f8[::1], f8[::1], f8[::1])"
)
def se3_pd(
    origin: FloatArray,
    rotation: FloatArray,
    goal_origin: FloatArray,
    goal_rotation: FloatArray,
    twist: FloatArray,
    drift: FloatArray,
    kp: float,
    kd: float,
    turn: FloatArray,
    error_out: FloatArray,
    wanted_out: FloatArray,
    slope_out: FloatArray,
) -> tuple[float, int]:
    """Write e = log(H⁻¹H_d) and what J·ddq shall be, kp·e − kd·ν − J̇·dq, in the frame's axes.

    With t = Rᵀ(p_d − p) and exp[φ]× = RᵀR_d, e = (ρ, φ) and ρ = Jl⁻¹(φ)·t. While the frame moves
    with the twist ν = (v, ω), t moves with −v − ω × t and the rotation with −ω, so V = ½|e|² has a
    rate that is linear in ν.

    Args:
        origin, rotation: p (3,) [m] and R (3, 3) of H.
        goal_origin, goal_rotation: of H_d.
        twist, drift: ν and J̇·dq, (6,).
        kp, kd: gains [1/s², 1/s].
        turn: scratch, (3, 3).
        error_out, wanted_out: (6,).
        slope_out: (6,) V̇ = slope·ν.

    Returns:
        V, and `AT_HALF_A_TURN` where e is one of two opposites.
    """
    t = transposed_times(
        rotation,
        (
            goal_origin[0] - origin[0],
            goal_origin[1] - origin[1],
            goal_origin[2] - origin[2],
        ),
    )
    for column in range(3):
        axis = (goal_rotation[0, column], goal_rotation[1, column], goal_rotation[2, column])
        image = transposed_times(rotation, axis)
        for row in range(3):
            turn[row, column] = image[row]
    x, y, z, angle, cotangent = logarithm(turn)
    phi: Vector = (x, y, z)
    c, d = _curvatures(angle, cotangent)
    rho = inverse_left(phi, c, t)
    V = 0.5 * (dot(rho, rho) + dot(phi, phi))
    for row in range(3):
        error_out[row], error_out[3 + row] = rho[row], phi[row]
    for row in range(6):
        wanted_out[row] = kp * error_out[row] - kd * twist[row] - drift[row]
        one = (
            1.0 if row % 3 == 0 else 0.0,
            1.0 if row % 3 == 1 else 0.0,
            1.0 if row % 3 == 2 else 0.0,
        )
        none = (0.0, 0.0, 0.0)
        velocity, omega = (one, none) if row < 3 else (none, one)
        back = plus((-velocity[0], -velocity[1], -velocity[2]), -1.0, cross(omega, t))
        linear, angular = log_rate(phi, t, c, d, back, (-omega[0], -omega[1], -omega[2]))
        slope_out[row] = dot(rho, linear) + dot(phi, angular)
    return V, AT_HALF_A_TURN if angle > 1.0 and cotangent < ANTIPODE else ON_THE_WAY
