"""Compiled: logarithm of a pose error in SE(3), and its exact derivatives."""

from __future__ import annotations

import math

from hoap3.protocol.messages import FloatArray
from hoap3.protocol.robot.triple_kernels import Triple, cross, plus
from hoap3.protocol.runtime.numba_jit import inlined, kernel
from hoap3.remote_controller.tasks.status import AT_ANTIPODE, OK

SMALL = 0.2  # rad: below, series; at it, c agrees to 1e-13, d to 1e-11 and d·θ³ to 1e-13
ANTIPODE = 1e-6  # cosine of half the angle: 2e-6 rad from half a turn


@inlined
def dot(a: Triple, b: Triple) -> float:
    """a·b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inlined
def transposed_times(rotation: FloatArray, a: Triple) -> Triple:
    """Rᵀa."""
    return (
        rotation[0, 0] * a[0] + rotation[1, 0] * a[1] + rotation[2, 0] * a[2],
        rotation[0, 1] * a[0] + rotation[1, 1] * a[1] + rotation[2, 1] * a[2],
        rotation[0, 2] * a[0] + rotation[1, 2] * a[1] + rotation[2, 2] * a[2],
    )


@inlined
def quaternion(rotation: FloatArray) -> tuple[float, float, float, float]:
    """(w, x, y, z) of a rotation matrix, w ≥ 0, from its largest component (Shepperd, 1978).

    Its length is not 1: only the ratios count.
    """
    R = rotation
    trace = R[0, 0] + R[1, 1] + R[2, 2]
    if trace >= R[0, 0] and trace >= R[1, 1] and trace >= R[2, 2]:
        w, x, y, z = 1.0 + trace, R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]
    elif R[0, 0] >= R[1, 1] and R[0, 0] >= R[2, 2]:
        w, x = R[2, 1] - R[1, 2], 1.0 + R[0, 0] - R[1, 1] - R[2, 2]
        y, z = R[1, 0] + R[0, 1], R[0, 2] + R[2, 0]
    elif R[1, 1] >= R[2, 2]:
        w, x = R[0, 2] - R[2, 0], R[1, 0] + R[0, 1]
        y, z = 1.0 + R[1, 1] - R[0, 0] - R[2, 2], R[2, 1] + R[1, 2]
    else:
        w, x = R[1, 0] - R[0, 1], R[0, 2] + R[2, 0]
        y, z = R[2, 1] + R[1, 2], 1.0 + R[2, 2] - R[0, 0] - R[1, 1]
    if w < 0.0:
        return -w, -x, -y, -z
    return w, x, y, z


@inlined
def logarithm(rotation: FloatArray) -> tuple[float, float, float, float, float]:
    """Rotation vector φ (3 numbers), its length θ in 0 … π, and cot(θ/2), 0 where θ = 0."""
    w, x, y, z = quaternion(rotation)
    sine = math.sqrt(x * x + y * y + z * z)
    if sine == 0.0:
        return 0.0, 0.0, 0.0, 0.0, 0.0
    angle = 2.0 * math.atan2(sine, w)
    factor = angle / sine
    return factor * x, factor * y, factor * z, angle, w / sine


@inlined
def curvatures(angle: float, cotangent: float) -> tuple[float, float]:
    """Return c = (1 − θ/2·cot θ/2)/θ² of `inverse_left`, and d = c′(θ)/θ of `log_rate`.

    Args:
        angle, cotangent: θ and cot(θ/2), of `logarithm`.
    """
    square = angle * angle
    if angle < SMALL:
        c = (1.0 + square / 60.0 * (1.0 + square / 42.0 * (1.0 + square / 40.0))) / 12.0
        return c, (1.0 + square / 21.0 * (1.0 + 3.0 * square / 80.0)) / 360.0
    # θ²·c′(θ)
    slope = -2.0 / angle + 0.5 * cotangent + 0.25 * angle * (1.0 + cotangent * cotangent)
    return (1.0 - 0.5 * angle * cotangent) / square, slope / (angle * square)


@inlined
def inverse_left(phi: Triple, c: float, a: Triple) -> Triple:
    """Jl⁻¹(φ)·a = a − ½ φ × a + c φ × (φ × a), Jl the left Jacobian of SO(3); c: `curvatures`."""
    turned = cross(phi, a)
    return plus(plus(a, -0.5, turned), c, cross(phi, turned))


@inlined
def log_rate(
    phi: Triple, t: Triple, c: float, d: float, velocity: Triple, omega: Triple
) -> tuple[Triple, Triple]:
    """Rates of ρ = Jl⁻¹(φ)·t and φ while t moves with `velocity` and R = exp[φ]× with `omega`.

    ω is seen from the left, Ṙ = [ω]× R. Then φ̇ = Jl⁻¹ω and

        ρ̇ = Jl⁻¹ṫ − ½ φ̇ × t + c·(φ̇ × (φ × t) + φ × (φ̇ × t)) + d·(φ·φ̇)·φ × (φ × t).
    """
    rate = inverse_left(phi, c, omega)
    moved, turned = cross(rate, t), cross(phi, t)
    linear = plus(inverse_left(phi, c, velocity), -0.5, moved)
    linear = plus(linear, c, plus(cross(rate, turned), 1.0, cross(phi, moved)))
    return plus(linear, d * dot(phi, rate), cross(phi, turned)), rate


@inlined
def exponential(r: Triple, rate: Triple, rotation_out: FloatArray) -> Triple:
    """Write exp[r]× and return its angular velocity, in its own axes, while r moves at `rate`.

    ω = Jr(r)·ṙ = ṙ − b r × ṙ + s r × (r × ṙ), with b = (1 − cos θ)/θ², s = (θ − sin θ)/θ³.
    """
    angle = math.sqrt(dot(r, r))
    if angle < SMALL:
        x = angle * angle
        a = 1.0 - x / 6.0 * (1.0 - x / 20.0 * (1.0 - x / 42.0 * (1.0 - x / 72.0)))
        b = 0.5 - x / 24.0 * (1.0 - x / 30.0 * (1.0 - x / 56.0 * (1.0 - x / 90.0)))
        s = (1.0 - x / 20.0 * (1.0 - x / 42.0 * (1.0 - x / 72.0))) / 6.0
    else:
        half = math.sin(0.5 * angle) / angle
        a, b = math.sin(angle) / angle, 2.0 * half * half
        s = (1.0 - a) / (angle * angle)
    for column in range(3):
        x, y, z = (
            1.0 if column == 0 else 0.0,
            1.0 if column == 1 else 0.0,
            1.0 if column == 2 else 0.0,
        )
        axis = (x, y, z)
        turned = cross(r, axis)
        image = plus(plus(axis, a, turned), b, cross(r, turned))
        for row in range(3):
            rotation_out[row, column] = image[row]
    turned = cross(r, rate)
    return plus(plus(rate, -b, turned), s, cross(r, turned))


@kernel(
    "i8(f8[::1], f8[:,::1], f8[:,::1], f8[::1], f8[::1], f8[:,:,::1], f8[::1], f8[:,::1], f8[::1])"
)
def pose_error(
    position: FloatArray,
    rotation: FloatArray,
    twist: FloatArray,
    target: FloatArray,
    target_rate: FloatArray,
    work: FloatArray,
    error_out: FloatArray,
    jacobian_out: FloatArray,
    error_rate_out: FloatArray,
) -> int:
    """Write e = log(M_d⁻¹M) and its exact derivatives.

    With t = R_dᵀ(p − p_d) and exp[φ]× = R_dᵀR, e = (ρ, φ) and ρ = Jl⁻¹(φ)·t. Seen in the target's
    axes a joint moves t with R_dᵀv and turns with R_dᵀω; the target's own motion (v_d, ω_d) turns
    the error with −ω_d and moves t with −v_d − ω_d × t. `log_rate` does the rest.

    Args:
        position, rotation: p (3,) [m] and R (3, 3) of M.
        twist: (6, n) v and ω of each joint, in the axes that p and p_d have.
        target, target_rate: (6,) p_d and the rotation vector of R_d, and their rates.
        work: (2, 3, 3) scratch.
        error_out: (6,) e: ρ [m], then φ [rad].
        jacobian_out: (6, n) ∂e/∂q.
        error_rate_out: (6,) ∂e/∂t.

    Returns:
        One of `tasks.status`.
    """
    goal, turn = work[0], work[1]
    p_d: Triple = (target[0], target[1], target[2])
    turn_d: Triple = (target[3], target[4], target[5])
    v_d: Triple = (target_rate[0], target_rate[1], target_rate[2])
    turn_rate_d: Triple = (target_rate[3], target_rate[4], target_rate[5])
    omega_d = exponential(turn_d, turn_rate_d, goal)
    away = (position[0] - p_d[0], position[1] - p_d[1], position[2] - p_d[2])
    t = transposed_times(goal, away)
    for column in range(3):
        axis = (rotation[0, column], rotation[1, column], rotation[2, column])
        image = transposed_times(goal, axis)
        for row in range(3):
            turn[row, column] = image[row]
    x, y, z, angle, cotangent = logarithm(turn)
    phi = (x, y, z)
    c, d = curvatures(angle, cotangent)
    rho = inverse_left(phi, c, t)
    for row in range(3):
        error_out[row], error_out[3 + row] = rho[row], phi[row]
    for i in range(twist.shape[1]):
        velocity = transposed_times(goal, (twist[0, i], twist[1, i], twist[2, i]))
        omega = transposed_times(goal, (twist[3, i], twist[4, i], twist[5, i]))
        linear, angular = log_rate(phi, t, c, d, velocity, omega)
        for row in range(3):
            jacobian_out[row, i], jacobian_out[3 + row, i] = linear[row], angular[row]
    velocity = transposed_times(goal, v_d)
    back = (-velocity[0], -velocity[1], -velocity[2])
    against = (-omega_d[0], -omega_d[1], -omega_d[2])
    linear, angular = log_rate(phi, t, c, d, plus(back, 1.0, cross(against, t)), against)
    for row in range(3):
        error_rate_out[row], error_rate_out[3 + row] = linear[row], angular[row]
    return AT_ANTIPODE if angle > 1.0 and cotangent < ANTIPODE else OK


@kernel("void(f8[:,::1], f8[::1], f8[::1])")
def rotation_vector(rotation: FloatArray, near: FloatArray, out: FloatArray) -> None:
    """Write a rotation vector of a rotation: of the two within one turn, the one nearer to `near`.

    Args:
        rotation: (3, 3).
        near: (3,) a rotation vector [rad].
        out: (3,) [rad].
    """
    x, y, z, angle, _ = logarithm(rotation)
    if angle > 0.0:
        # the other way round: length θ − 2π, and |out − near|² differs by 4π(π − θ + along)
        along = (x * near[0] + y * near[1] + z * near[2]) / angle
        if math.pi - angle + along < 0.0:
            other = 1.0 - 2.0 * math.pi / angle
            x, y, z = other * x, other * y, other * z
    out[0], out[1], out[2] = x, y, z
