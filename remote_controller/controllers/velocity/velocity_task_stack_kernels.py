"""Compiled: what tasks want, and which joint velocities a robot can follow in the next period."""

from __future__ import annotations

import math

from hoap3.protocol.messages import FloatArray
from hoap3.protocol.robot.setpoint_limits_kernels import approach_speed
from hoap3.protocol.runtime.numba_jit import kernel


@kernel("void(f8[::1], f8[::1], f8[:,::1], f8, f8[::1], f8[::1])")
def velocity_bounds(
    reference: FloatArray,
    dq: FloatArray,
    limits: FloatArray,
    T: float,
    lower_out: FloatArray,
    upper_out: FloatArray,
) -> None:
    """Write the least and the greatest velocity of each joint, (n,); the least is never above.

    A velocity may differ from the last one by A·T, may not exceed the greatest speed, and must let
    the joint come to rest before the end of its range in steps of A·T. From a velocity within them
    there is always a next one. A joint that is faster brakes as hard as the range asks for.

    Args:
        reference: positions that the robot applies, (n,) [rad or m].
        dq: their velocity over the last period, (n,) [rad/s or m/s].
        limits: (4, n) least and greatest position, greatest speed, and A, greatest acceleration.
        T: period [s].
        lower_out, upper_out: written [rad/s or m/s].
    """
    for i in range(reference.size):
        q, v = reference[i], dq[i]
        lower, upper, speed, A = limits[0, i], limits[1, i], limits[2, i], limits[3, i]
        most = min(max(v + A * T, -speed), speed)
        least = min(max(v - A * T, -speed), speed)
        if most > 0.0:
            most = approach_speed(most, upper - q, upper, speed, A, T)
        if least < 0.0:
            least = -approach_speed(-least, q - lower, lower, speed, A, T)
        if least > most:  # too fast to stop in time as gently as that
            least = most = most if v > 0.0 else least
        lower_out[i], upper_out[i] = least, most


@kernel("f8(f8[:], f8[:], f8[:,:], f8[::1], f8[::1], f8[:,::1])")
def stack(
    error: FloatArray,
    error_rate: FloatArray,
    jacobian: FloatArray,
    errors_out: FloatArray,
    rates_out: FloatArray,
    jacobian_out: FloatArray,
) -> float:
    """Write what is missing to a target, σ* − σ = −e, its rate −∂e/∂t, and the Jacobian.

    Args:
        error, error_rate, jacobian: e (m,), ∂e/∂t (m,) and ∂e/∂q (m, n).
        errors_out, rates_out, jacobian_out: written, (m,), (m,) and (m, n).

    Returns:
        |e|.
    """
    square = 0.0
    for row in range(error.size):
        square += error[row] * error[row]
        errors_out[row], rates_out[row] = -error[row], -error_rate[row]
        for i in range(jacobian.shape[1]):
            jacobian_out[row, i] = jacobian[row, i]
    return math.sqrt(square)


@kernel("f8(f8[::1], f8, f8[::1], f8[::1], f8[::1])")
def cut(
    dq: FloatArray, share: float, lower: FloatArray, upper: FloatArray, out: FloatArray
) -> float:
    """Write share·dq, cut to bounds, all (n,); the least distance from one of them."""
    margin = math.inf
    for i in range(dq.size):
        out[i] = min(max(share * dq[i], lower[i]), upper[i])
        margin = min(margin, out[i] - lower[i], upper[i] - out[i])
    return margin
