"""Compiled: what a task of a frame needs of the dynamics, in the joint order of the wire."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from protocol.compilation import kernel
from protocol.messages import FloatArray


@kernel(  # Pinocchio's matrices are of any layout: with one joint, Fortran's and C's are the same
    "void(f8[:,:], f8[:], f8[:,:], f8[:], f8[:,:], i8[::1], i8[::1], f8[::1], f8[:,::1], f8[::1],"
    " f8[:,::1], f8[::1], f8[::1])"
)
def frame_dynamics(
    mass: FloatArray,
    bias: FloatArray,
    joint_jacobian: FloatArray,
    origin: FloatArray,
    rotation: FloatArray,
    order: NDArray[np.int64],
    movers: NDArray[np.int64],
    dq: FloatArray,
    mass_out: FloatArray,
    bias_out: FloatArray,
    jacobian_out: FloatArray,
    twist_out: FloatArray,
    drift_out: FloatArray,
) -> None:
    """Write M, h, and of a frame J, its twist ν = J·dq and J̇·dq, seen in its own axes.

    Column s_j of the root's Jacobian is the twist of joint j, which is carried along by all joints
    before it: ṡ_j = ν_{<j} × s_j. So the sum of ṡ_j·dq_j, taken into the frame's axes, is J̇·dq:
    d/dt ν = J·ddq + J̇·dq, and ν × ν = 0 is all that the frame's own turning adds.

    Args:
        mass: (n, n) upper triangle, Pinocchio's order, like the next two.
        bias: (n,).
        joint_jacobian: (6, n) v and ω of what each joint moves, at the root's origin.
        origin, rotation: of the frame in the root, (3,) [m] and (3, 3).
        order: (n,) column of each joint of the wire in Pinocchio's order.
        movers: joints of the wire that move the frame, from the root outwards.
        dq: (n,) in wire order, like all that follows.
        mass_out, bias_out: (n, n) and (n,).
        jacobian_out: (6, n); columns of joints that do not move the frame are left as they are.
        twist_out, drift_out: (6,) v [m/s] over ω [rad/s], and their rates at ddq = 0.
    """
    n = order.size
    for i in range(n):
        bias_out[i] = bias[order[i]]
        for j in range(i + 1):
            a, b = order[i], order[j]
            value = mass[a, b] if a <= b else mass[b, a]
            mass_out[i, j] = value
            mass_out[j, i] = value
    ox, oy, oz = origin[0], origin[1], origin[2]
    vx, vy, vz, wx, wy, wz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    ax, ay, az, bx, by, bz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(movers.size):
        i = movers[k]
        c, rate = order[i], dq[i]
        sx, sy, sz = joint_jacobian[0, c], joint_jacobian[1, c], joint_jacobian[2, c]
        tx, ty, tz = joint_jacobian[3, c], joint_jacobian[4, c], joint_jacobian[5, c]
        ax += rate * (wy * sz - wz * sy + vy * tz - vz * ty)
        ay += rate * (wz * sx - wx * sz + vz * tx - vx * tz)
        az += rate * (wx * sy - wy * sx + vx * ty - vy * tx)
        bx += rate * (wy * tz - wz * ty)
        by += rate * (wz * tx - wx * tz)
        bz += rate * (wx * ty - wy * tx)
        vx += rate * sx
        vy += rate * sy
        vz += rate * sz
        wx += rate * tx
        wy += rate * ty
        wz += rate * tz
        px, py, pz = sx + ty * oz - tz * oy, sy + tz * ox - tx * oz, sz + tx * oy - ty * ox
        for row in range(3):
            x, y, z = rotation[0, row], rotation[1, row], rotation[2, row]
            jacobian_out[row, i] = x * px + y * py + z * pz
            jacobian_out[3 + row, i] = x * tx + y * ty + z * tz
    px, py, pz = vx + wy * oz - wz * oy, vy + wz * ox - wx * oz, vz + wx * oy - wy * ox
    qx, qy, qz = ax + by * oz - bz * oy, ay + bz * ox - bx * oz, az + bx * oy - by * ox
    for row in range(3):
        x, y, z = rotation[0, row], rotation[1, row], rotation[2, row]
        twist_out[row] = x * px + y * py + z * pz
        twist_out[3 + row] = x * wx + y * wy + z * wz
        drift_out[row] = x * qx + y * qy + z * qz
        drift_out[3 + row] = x * bx + y * by + z * bz
