"""Compiled: what task-space inverse dynamics asks for (Del Prete, IEEE RA-L 2018, (34))."""

from __future__ import annotations

import math
from typing import NamedTuple

from hoap3.protocol.messages import FloatArray
from hoap3.protocol.robot.triple_kernels import Triple, cross, plus
from hoap3.protocol.runtime.numba_jit import Matrix, Vector, kernel
from hoap3.remote_controller.tasks.se3_kernels import (
    ANTIPODE,
    curvatures,
    dot,
    exponential,
    inverse_left,
    log_rate,
    logarithm,
    transposed_times,
)

ON_THE_WAY, AT_HALF_A_TURN, NOT_FINITE = 0, 1, 2


class Pose(NamedTuple):
    """A frame: p (3,) [m] and R (3, 3)."""

    origin: Vector
    rotation: Matrix


class Motion(NamedTuple):
    """The twist ν of a frame in its own axes, and its rate J̇·dq where ddq = 0, (6,)."""

    twist: Vector
    drift: Vector


class Asked(NamedTuple):
    """What is written, (6,) each.

    Attributes:
        error: e, ρ [m] and then φ [rad].
        wanted: what J·ddq shall be.
        slope: of V = ½|e|², V̇ = slope·ν.
    """

    error: Vector
    wanted: Vector
    slope: Vector


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


@kernel()
def se3_pd(
    frame: Pose, goal: Pose, motion: Motion, kp: float, kd: float, turn: Matrix, out: Asked
) -> tuple[float, int]:
    """Write e = log(H⁻¹H_d) and what J·ddq shall be, kp·e − kd·ν − J̇·dq, in the frame's axes.

    With t = Rᵀ(p_d − p) and exp[φ]× = RᵀR_d, e = (ρ, φ) and ρ = Jl⁻¹(φ)·t. While the frame moves
    with the twist ν = (v, ω), t moves with −v − ω × t and the rotation with −ω, so V = ½|e|² has a
    rate that is linear in ν.

    Args:
        frame, goal: H and H_d.
        motion: of H.
        kp, kd: gains [1/s², 1/s].
        turn: scratch, (3, 3).
        out: written.

    Returns:
        V, and `AT_HALF_A_TURN` where e is one of two opposites.
    """
    (origin, rotation), (goal_origin, goal_rotation) = frame, goal
    twist, drift = motion
    error_out, wanted_out, slope_out = out
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
    phi: Triple = (x, y, z)
    c, d = curvatures(angle, cotangent)
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
