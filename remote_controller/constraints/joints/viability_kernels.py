"""Compiled: which joint velocities a robot can follow in the next period, and ever after."""

from __future__ import annotations

from hoap3.protocol.limits.setpoint_limits_kernels import approach_speed
from hoap3.protocol.messages import FloatArray
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
