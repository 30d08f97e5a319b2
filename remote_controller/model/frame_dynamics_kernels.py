"""Compiled: what tasks of frames need of the dynamics, in the joint order of the wire."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.messages import FloatArray
from hoap3.protocol.runtime.numba_jit import inlined, kernel

Indices = NDArray[np.int64]
OWN_AXES = 6  # rows of a frame that is seen in its own axes; with fewer, in the root's


@inlined
def _inertia(
    mass: FloatArray, bias: FloatArray, order: Indices, mass_out: FloatArray, bias_out: FloatArray
) -> None:
    for i in range(order.size):
        bias_out[i] = bias[order[i]]
        for j in range(i + 1):
            a, b = order[i], order[j]
            value = mass[a, b] if a <= b else mass[b, a]
            mass_out[i, j] = value
            mass_out[j, i] = value


@inlined
def _place(
    joint: FloatArray, mount: FloatArray, origin_out: FloatArray, rotation_out: FloatArray
) -> None:
    for row in range(3):
        x, y, z = joint[row], joint[3 + row], joint[6 + row]
        for column in range(3):
            a, b, c = mount[0, column], mount[1, column], mount[2, column]
            rotation_out[row, column] = x * a + y * b + z * c
        origin_out[row] = joint[9 + row] + (x * mount[0, 3] + y * mount[1, 3] + z * mount[2, 3])


class Rows(NamedTuple):
    """Where the rows of all frames are written.

    Attributes:
        jacobian: J, (m, n).
        twist: ν = J·dq, (m,).
        drift: J̇·dq, (m,).
    """

    jacobian: FloatArray
    twist: FloatArray
    drift: FloatArray


@inlined
def _move(
    joint_jacobian: FloatArray,
    order: Indices,
    movers: Indices,
    dq: FloatArray,
    placement: tuple[FloatArray, FloatArray],
    start: int,
    size: int,
    rows: Rows,
) -> None:
    """Write the rows of one frame.

    Column s_j of the root's Jacobian is the twist of joint j, which is carried along by all joints
    before it: ṡ_j = ν_{<j} × s_j. So the sum of ṡ_j·dq_j, taken into the frame's axes, is J̇·dq of
    its twist there: d/dt ν = J·ddq + J̇·dq, and ν × ν = 0 is all that the frame's own turning adds.
    The velocity v of the origin in the root's axes is turned with ω: there ω × v is added.
    """
    (origin, rotation), (jacobian_out, twist_out, drift_out) = placement, rows
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
        if size < OWN_AXES:
            jacobian_out[start, i] = px
            jacobian_out[start + 1, i] = py
            jacobian_out[start + 2, i] = pz
            continue
        for row in range(3):
            x, y, z = rotation[0, row], rotation[1, row], rotation[2, row]
            jacobian_out[start + row, i] = x * px + y * py + z * pz
            jacobian_out[start + 3 + row, i] = x * tx + y * ty + z * tz
    px, py, pz = vx + wy * oz - wz * oy, vy + wz * ox - wx * oz, vz + wx * oy - wy * ox
    qx, qy, qz = ax + by * oz - bz * oy, ay + bz * ox - bx * oz, az + bx * oy - by * ox
    if size < OWN_AXES:
        twist_out[start], twist_out[start + 1], twist_out[start + 2] = px, py, pz
        drift_out[start] = qx + wy * pz - wz * py
        drift_out[start + 1] = qy + wz * px - wx * pz
        drift_out[start + 2] = qz + wx * py - wy * px
        return
    for row in range(3):
        x, y, z = rotation[0, row], rotation[1, row], rotation[2, row]
        twist_out[start + row] = x * px + y * py + z * pz
        twist_out[start + 3 + row] = x * wx + y * wy + z * wz
        drift_out[start + row] = x * qx + y * qy + z * qz
        drift_out[start + 3 + row] = x * bx + y * by + z * bz


@kernel(  # Pinocchio's matrices are of any layout: with one joint, Fortran's and C's are the same
    "void(f8[:,:], f8[:], f8[:,:], f8[:,::1], i8[::1], f8[:,:,::1], i8[::1], i8[::1], i8[::1],"
    " i8[:,::1], f8[::1], f8[:,::1], f8[::1], f8[:,::1], f8[::1], f8[::1], f8[:,::1],"
    " f8[:,:,::1])"
)
def frames_dynamics(
    mass: FloatArray,
    bias: FloatArray,
    joint_jacobian: FloatArray,
    joints: FloatArray,
    carriers: Indices,
    mounts: FloatArray,
    order: Indices,
    movers: Indices,
    edges: Indices,
    places: Indices,
    dq: FloatArray,
    mass_out: FloatArray,
    bias_out: FloatArray,
    jacobian_out: FloatArray,
    twist_out: FloatArray,
    drift_out: FloatArray,
    origins_out: FloatArray,
    rotations_out: FloatArray,
) -> None:
    """Write M, h, and of each frame where it is, J, its motion ν = J·dq and J̇·dq.

    Of a robot with mimic joints n counts these, too, behind the joints of the wire.

    Args:
        mass: (n, n) upper triangle, Pinocchio's order, like the next two.
        bias: (n,).
        joint_jacobian: (6, n) v and ω of what each joint moves, at the root's origin.
        joints: (j, 12) rotation, by columns, and origin [m] of all joints in the root.
        carriers: (k,) which of them carries each frame.
        mounts: (k, 3, 4) rotation and origin of each frame in its joint.
        order: (n,) column of each joint of the wire in Pinocchio's order.
        movers, edges: joints of the wire that move frame f, from the root outwards, are
            movers[edges[f]:edges[f + 1]].
        places: (k, 2) first row of each frame, and how many: `frame_dynamics.FrameRows`.
        dq: (n,) in wire order, like all that follows.
        mass_out, bias_out: (n, n) and (n,).
        jacobian_out: (m, n); columns of joints that do not move the frame are left as they are.
        twist_out, drift_out: (m,) ν, and its rate at ddq = 0.
        origins_out, rotations_out: (k, 3) [m] and (k, 3, 3), in the root's axes.
    """
    _inertia(mass, bias, order, mass_out, bias_out)
    rows = Rows(jacobian_out, twist_out, drift_out)
    for f in range(carriers.size):
        origin, rotation = origins_out[f], rotations_out[f]
        _place(joints[carriers[f]], mounts[f], origin, rotation)
        mine = movers[edges[f] : edges[f + 1]]
        placement, (start, size) = (origin, rotation), (places[f, 0], places[f, 1])
        _move(joint_jacobian, order, mine, dq, placement, start, size, rows)
