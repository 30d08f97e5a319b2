"""Compiled: one period of joint-space acceleration control (Del Prete, IEEE RA-L 2018)."""

from __future__ import annotations

import math

from hoap3.protocol.messages import FloatArray
from hoap3.protocol.runtime.numba_jit import kernel

ACTIVE_SPEED = 1e-3  # rad/s or m/s: below it a joint counts as inactive
RESTING = 1e-9  # rad and rad/s: nothing is left to do


@kernel("b1(f8[::1], f8[::1], f8[::1], f8[::1], f8, f8[::1])")
def follow_reference(
    reference: FloatArray,
    before: FloatArray,
    sent: FloatArray,
    q: FloatArray,
    elapsed: float,
    dq: FloatArray,
) -> bool:
    """Bring the commanded state (q, dq) to what the robot applies; whether all is finite.

    Where the robot did what was sent, the state stays as it is; where it did something else, its
    velocity is what the reference has had since the last State.

    Args:
        reference, before: applied references of this State and of the last, (n,).
        sent: the last setpoint, (n,).
        q, dq: the commanded state, written.
        elapsed: since the last State [s]; 0: there is none, and dq is left as it is.
    """
    finite, same = True, True
    for i in range(q.size):
        finite = finite and math.isfinite(reference[i]) and math.isfinite(dq[i])
        same = same and reference[i] == sent[i]
    for i in range(q.size):
        if not same and elapsed > 0.0:
            dq[i] = (reference[i] - before[i]) / elapsed
        q[i], before[i] = reference[i], reference[i]
    return finite


@kernel(
    "Tuple((f8, f8, f8, i8, f8, b1))(f8[::1], f8[::1], f8[::1], f8, f8, f8[::1], f8[::1], f8[::1],"
    " f8, f8[::1], f8[::1], f8[::1])"
)
def accelerate_to(
    q: FloatArray,
    dq: FloatArray,
    target: FloatArray,
    kp: float,
    kd: float,
    lower: FloatArray,
    upper: FloatArray,
    scale: FloatArray,
    T: float,
    ddq_out: FloatArray,
    q_out: FloatArray,
    dq_out: FloatArray,
) -> tuple[float, float, float, int, float, bool]:
    """Write the acceleration of (31) and (32), and the state that it leads to in T.

    (31) has no coupling between the joints: its solution is kp·(target − q) − kd·dq, cut to the
    bounds. V = ½·|q − target|².

    Args:
        q, dq, target: (n,) [rad, rad/s].
        kp, kd: gains [1/s², 1/s].
        lower, upper: of ddq, (n,) [rad/s²].
        scale: of ddq, what the margin is relative to, (n,).
        T: period [s].
        ddq_out, q_out, dq_out: (n,); dq_out may be dq.

    Returns:
        V, its mean rate in T to first order in T, its whole mean rate, number of joints that move,
        the least distance from a bound relative to `scale`, at most 1, and whether all rests at the
        target.
    """
    V, rate, growth, active, margin, resting = 0.0, 0.0, 0.0, 0, 1.0, True
    for i in range(q.size):
        error, v = q[i] - target[i], dq[i]
        a = min(max(-kp * error - kd * v, lower[i]), upper[i])
        moved = T * v + 0.5 * T * T * a
        margin = min(margin, (a - lower[i]) / scale[i], (upper[i] - a) / scale[i])
        resting = resting and abs(error) <= RESTING and abs(v) <= RESTING
        ddq_out[i], q_out[i], dq_out[i] = a, q[i] + moved, v + T * a
        step = q_out[i] - q[i]
        V += 0.5 * error * error
        rate += error * step / T
        growth += (error + 0.5 * step) * step / T
        active += abs(dq_out[i]) >= ACTIVE_SPEED
    return V, rate, growth, active, margin, resting
