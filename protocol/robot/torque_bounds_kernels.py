"""Compiled Algorithm 4: what the torque limits leave of each joint's acceleration, state by state.

Del Prete, "Joint Position and Velocity Bounds in Discrete-Time Acceleration/Torque Control of
Robot Manipulators", IEEE RA-L 2018. While the other joints do not accelerate, their ddq = 0,
joint j can by (30) reach

    (−τ_max − h_j) / M_jj ≤ ddq_j ≤ (τ_max − h_j) / M_jj

with the bias h of gravity and velocities, and the diagonal of the mass matrix M. Both come from
one pass down the tree and one up (Featherstone, "Rigid Body Dynamics Algorithms", 2008: recursive
Newton-Euler with ddq = 0, and composite rigid bodies), in the frames of
`hoap3.protocol.robot.link_tables`, whose tables (`links`, `parents`, `prismatic`, `gravity`) all
kernels take. Everything here is in Pinocchio's order.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.messages import FloatArray
from hoap3.protocol.runtime.numba_jit import Indices, Matrix, Vector, inlined, kernel

OK, NOT_FINITE, NO_INERTIA = 0, 1, 2

SWEEPS = 400  # of the coordinate search, at most
FINEST = 1e-7  # its last step, relative to the range of a joint

Flags: TypeAlias = Annotated[NDArray[np.bool_], "b1[::1]"]


class Links(NamedTuple):
    """What `link_tables.Tree` says of a robot.

    Attributes:
        links: (n, 23), by the columns that are named there.
        parents: (n,), which joint moves the parent; −1 for the root.
        prismatic: (n,), whether the joint shifts.
        gravity: (3,), in the root's axes [m/s²].
    """

    links: Matrix
    parents: Indices
    prismatic: Flags
    gravity: Vector


# columns of `work`, one row a joint. From 0 on the rotation of its frame in its parent's, row by
# row; behind it, all but p seen from the joint's frame:
_P = 9  # its origin in its parent's frame
_W, _WD = 12, 15  # ω and its rate
_A = 18  # acceleration of its origin
_F, _N = 21, 24  # force and moment
_MASS, _S, _I = 27, 28, 31  # mass, first moment and inertia of all that the joint carries
WORK = 37

LEAST, GREATEST, SPEED, TORQUE = 0, 1, 2, 3  # rows of `limits`

# columns of `links`, as `link_tables` names them, whose names no kernel may take: it is no kernels'
ORIGIN, MASS, MOMENT, INERTIA, ARMATURE = 9, 12, 13, 16, 22


@inlined
def _cross(
    ax: float, ay: float, az: float, bx: float, by: float, bz: float
) -> tuple[float, float, float]:
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


@inlined
def _out(work: FloatArray, i: int, x: float, y: float, z: float) -> tuple[float, float, float]:
    """A vector of joint i's frame in its parent's axes."""
    return (
        work[i, 0] * x + work[i, 1] * y + work[i, 2] * z,
        work[i, 3] * x + work[i, 4] * y + work[i, 5] * z,
        work[i, 6] * x + work[i, 7] * y + work[i, 8] * z,
    )


@inlined
def _in(work: FloatArray, i: int, x: float, y: float, z: float) -> tuple[float, float, float]:
    """A vector of the parent's frame in joint i's axes."""
    return (
        work[i, 0] * x + work[i, 3] * y + work[i, 6] * z,
        work[i, 1] * x + work[i, 4] * y + work[i, 7] * z,
        work[i, 2] * x + work[i, 5] * y + work[i, 8] * z,
    )


@inlined
def _inert(
    table: FloatArray, i: int, at: int, x: float, y: float, z: float
) -> tuple[float, float, float]:
    """The symmetric matrix that starts at a column, xx xy xz yy yz zz, times a vector."""
    xy, xz, yz = table[i, at + 1], table[i, at + 2], table[i, at + 4]
    return (
        table[i, at] * x + xy * y + xz * z,
        xy * x + table[i, at + 3] * y + yz * z,
        xz * x + yz * y + table[i, at + 5] * z,
    )


@inlined
def _put(work: FloatArray, i: int, at: int, x: float, y: float, z: float) -> None:
    work[i, at], work[i, at + 1], work[i, at + 2] = x, y, z


@inlined
def _add(work: FloatArray, i: int, at: int, x: float, y: float, z: float) -> None:
    work[i, at] += x
    work[i, at + 1] += y
    work[i, at + 2] += z


@inlined
def _place(
    links: FloatArray, i: int, shifts: bool, q: float, work: FloatArray
) -> tuple[float, float, float]:
    """Write where joint i's frame is in its parent's, and return its origin."""
    px, py, pz = links[i, ORIGIN], links[i, ORIGIN + 1], links[i, ORIGIN + 2]
    cosine, sine = 1.0, 0.0
    if shifts:
        px, py, pz = px + q * links[i, 2], py + q * links[i, 5], pz + q * links[i, 8]
    else:
        cosine, sine = math.cos(q), math.sin(q)
    for k in range(0, 9, 3):
        x, y = links[i, k], links[i, k + 1]
        work[i, k] = cosine * x + sine * y
        work[i, k + 1] = cosine * y - sine * x
        work[i, k + 2] = links[i, k + 2]
    _put(work, i, _P, px, py, pz)
    return px, py, pz


@inlined
def _down(
    links: FloatArray,
    i: int,
    above: int,
    shifts: bool,
    gravity: FloatArray,
    q: float,
    v: float,
    work: FloatArray,
) -> None:
    """Where joint i's frame is and how it moves, and the force that its own link needs.

    w is ω, u its rate, a the acceleration of the origin less gravity, p the origin in the parent's
    frame, where a + u × p + w × (w × p) is that of p; a joint adds its own v along or about z, with
    2 w × v z if it shifts. Of the link, with mass m, first moment s and inertia I about the origin,

        F = m a + u × s + w × (w × s),   N = I u + w × I w + s × a

    e, c and t hold the terms of these sums.
    """
    wx, wy, wz, ux, uy, uz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    ax, ay, az = -gravity[0], -gravity[1], -gravity[2]
    if above >= 0:
        wx, wy, wz = work[above, _W], work[above, _W + 1], work[above, _W + 2]
        ux, uy, uz = work[above, _WD], work[above, _WD + 1], work[above, _WD + 2]
        ax, ay, az = work[above, _A], work[above, _A + 1], work[above, _A + 2]
    px, py, pz = _place(links, i, shifts, q, work)
    ex, ey, ez = _cross(ux, uy, uz, px, py, pz)
    cx, cy, cz = _cross(wx, wy, wz, px, py, pz)
    cx, cy, cz = _cross(wx, wy, wz, cx, cy, cz)
    ax, ay, az = _in(work, i, ax + ex + cx, ay + ey + cy, az + ez + cz)
    wx, wy, wz = _in(work, i, wx, wy, wz)
    ux, uy, uz = _in(work, i, ux, uy, uz)
    if shifts:
        ax, ay = ax + 2.0 * wy * v, ay - 2.0 * wx * v
    else:
        ux, uy, wz = ux + wy * v, uy - wx * v, wz + v
    _put(work, i, _W, wx, wy, wz)
    _put(work, i, _WD, ux, uy, uz)
    _put(work, i, _A, ax, ay, az)
    mass = links[i, MASS]
    sx, sy, sz = links[i, MOMENT], links[i, MOMENT + 1], links[i, MOMENT + 2]
    ex, ey, ez = _cross(ux, uy, uz, sx, sy, sz)
    cx, cy, cz = _cross(wx, wy, wz, sx, sy, sz)
    cx, cy, cz = _cross(wx, wy, wz, cx, cy, cz)
    _put(work, i, _F, mass * ax + ex + cx, mass * ay + ey + cy, mass * az + ez + cz)
    ex, ey, ez = _inert(links, i, INERTIA, ux, uy, uz)
    cx, cy, cz = _inert(links, i, INERTIA, wx, wy, wz)
    cx, cy, cz = _cross(wx, wy, wz, cx, cy, cz)
    tx, ty, tz = _cross(sx, sy, sz, ax, ay, az)
    _put(work, i, _N, ex + cx + tx, ey + cy + ty, ez + cz + tz)
    for k in range(10):  # mass, first moment, inertia
        work[i, _MASS + k] = links[i, MASS + k]


@inlined
def _up(work: FloatArray, i: int, above: int) -> None:
    """Hand what joint i carries to its parent: force, moment, mass, first moment, inertia."""
    px, py, pz = work[i, _P], work[i, _P + 1], work[i, _P + 2]
    fx, fy, fz = _out(work, i, work[i, _F], work[i, _F + 1], work[i, _F + 2])
    nx, ny, nz = _out(work, i, work[i, _N], work[i, _N + 1], work[i, _N + 2])
    tx, ty, tz = _cross(px, py, pz, fx, fy, fz)
    _add(work, above, _F, fx, fy, fz)
    _add(work, above, _N, nx + tx, ny + ty, nz + tz)
    mass = work[i, _MASS]
    sx, sy, sz = _out(work, i, work[i, _S], work[i, _S + 1], work[i, _S + 2])
    work[above, _MASS] += mass
    _add(work, above, _S, sx + mass * px, sy + mass * py, sz + mass * pz)
    # a, b, c are the columns of R I Rᵀ; about the parent's origin it has, with s in its axes, also
    # 2 (s·p) 1 − s pᵀ − p sᵀ + m (p² 1 − p pᵀ) = 2 (g·p) 1 − g pᵀ − p gᵀ, g = s + ½ m p
    ax, ay, az = _out(work, i, *_inert(work, i, _I, work[i, 0], work[i, 1], work[i, 2]))
    _, by, bz = _out(work, i, *_inert(work, i, _I, work[i, 3], work[i, 4], work[i, 5]))
    _, _, cz = _out(work, i, *_inert(work, i, _I, work[i, 6], work[i, 7], work[i, 8]))
    gx, gy, gz = sx + 0.5 * mass * px, sy + 0.5 * mass * py, sz + 0.5 * mass * pz
    x, y, z = 2.0 * gx * px, 2.0 * gy * py, 2.0 * gz * pz
    _add(work, above, _I, ax + y + z, ay - gx * py - gy * px, az - gx * pz - gz * px)
    _add(work, above, _I + 3, by + x + z, bz - gy * pz - gz * py, cz + x + y)


@kernel(nogil=True)
def bias_and_inertia(
    tree: Links, q: Vector, dq: Vector, work: Matrix, bias_out: Vector, inertia_out: Vector
) -> None:
    """Bias and diagonal of the mass matrix in one state.

    Newton's and Euler's equations from the root outwards and back; inertias are composed on the
    way back.

    Args:
        tree: the robot's links.
        q, dq: (n,) positions and velocities [rad, rad/s or m, m/s].
        work: (n, `WORK`), overwritten.
        bias_out: (n,) h(q, dq) [N m or N].
        inertia_out: (n,) M_jj(q) [kg m² or kg], armature included.
    """
    links, parents, prismatic, gravity = tree
    n = parents.size
    for i in range(n):
        _down(links, i, parents[i], prismatic[i], gravity, q[i], dq[i], work)
    for i in range(n - 1, -1, -1):
        bias_out[i] = work[i, _F + 2] if prismatic[i] else work[i, _N + 2]
        inertia_out[i] = (work[i, _MASS] if prismatic[i] else work[i, _I + 5]) + links[i, ARMATURE]
        if parents[i] >= 0:
            _up(work, i, parents[i])


@kernel(
    "Tuple((i8, i8))(f8[:,::1], i8[::1], b1[::1], f8[::1], f8[:,::1], b1, f8[:,::1], f8[:,::1],"
    " f8[:,:,:,::1])",
    nogil=True,
    allocates=True,
)
def sample(
    links: FloatArray,
    parents: NDArray[np.int64],
    prismatic: NDArray[np.bool_],
    gravity: FloatArray,
    limits: FloatArray,
    at_corners: bool,
    drawn: FloatArray,
    bounds: FloatArray,
    states: FloatArray,
) -> tuple[int, int]:
    """Tighten bounds by what is possible in random states.

    Args:
        limits: (4, n) by row: `LEAST` and `GREATEST` position, greatest `SPEED` and `TORQUE`.
        at_corners: every velocity is the greatest, forwards or backwards; else uniform.
        drawn: (samples, 2n) uniform in [0, 1): positions, then velocities.
        bounds: (2, n) greatest lower and least upper bound so far; tightened.
        states: (2, n, 2, n), overwritten where tightened: by bound, lower and upper, and joint,
            the state that gave it: q and dq, of all joints.

    Returns:
        `OK`, or `NOT_FINITE` or `NO_INERTIA` and the joint.
    """
    n, tree = parents.size, Links(links, parents, prismatic, gravity)
    q, dq, bias, inertia = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    work = np.empty((n, WORK))
    for k in range(drawn.shape[0]):
        for i in range(n):
            share = drawn[k, n + i]
            q[i] = limits[LEAST, i] + drawn[k, i] * (limits[GREATEST, i] - limits[LEAST, i])
            if at_corners:
                dq[i] = limits[SPEED, i] if share >= 0.5 else -limits[SPEED, i]
            else:
                dq[i] = (2.0 * share - 1.0) * limits[SPEED, i]
        bias_and_inertia(tree, q, dq, work, bias, inertia)
        for j in range(n):
            if not (math.isfinite(bias[j]) and math.isfinite(inertia[j])):
                return NOT_FINITE, j
            if not inertia[j] > 0.0:
                return NO_INERTIA, j
            lower = (-limits[TORQUE, j] - bias[j]) / inertia[j]
            upper = (limits[TORQUE, j] - bias[j]) / inertia[j]
            if lower > bounds[0, j]:
                bounds[0, j] = lower
                states[0, j, 0], states[0, j, 1] = q, dq
            if upper < bounds[1, j]:
                bounds[1, j] = upper
                states[1, j, 0], states[1, j, 1] = q, dq
    return OK, -1


@kernel(
    "f8(f8[:,::1], i8[::1], b1[::1], f8[::1], f8[:,::1], i8, b1, f8[::1], f8[::1])",
    nogil=True,
    allocates=True,
)
def polish(
    links: FloatArray,
    parents: NDArray[np.int64],
    prismatic: NDArray[np.bool_],
    gravity: FloatArray,
    limits: FloatArray,
    joint: int,
    upwards: bool,
    q: FloatArray,
    dq: FloatArray,
) -> float:
    """Search for a worse state near one, coordinate by coordinate; returns the bound there.

    In a velocity h is a parabola, so its best is an end or the vertex. In a position the search
    steps to both sides, and halves the step when no coordinate gains any more.

    Args:
        limits: (4, n) by row: `LEAST` and `GREATEST` position, greatest `SPEED` and `TORQUE`.
        joint, upwards: which bound: the upper one of this joint, or the lower one.
        q, dq: (n,) the state; left at the worst one that was found.
    """
    n, tree = parents.size, Links(links, parents, prismatic, gravity)
    work, bias, inertia = np.empty((n, WORK)), np.empty(n), np.empty(n)
    sign, most = (1.0 if upwards else -1.0), limits[TORQUE, joint]
    tried = np.empty(3)
    bias_and_inertia(tree, q, dq, work, bias, inertia)
    worst = (sign * bias[joint] - most) / inertia[joint]  # the bound times −sign: to be raised
    step = 0.25  # of the range of each position
    for _ in range(SWEEPS):
        before = worst
        for i in range(n):
            best = dq[i]
            for k in range(3):
                dq[i] = (k - 1.0) * limits[SPEED, i]
                bias_and_inertia(tree, q, dq, work, bias, inertia)
                tried[k] = (sign * bias[joint] - most) / inertia[joint]
                if tried[k] > worst:
                    worst, best = tried[k], dq[i]
            curved = tried[0] - 2.0 * tried[1] + tried[2]
            back = 0.5 * (tried[0] - tried[2])  # slope at 0, reversed: the vertex is at back/curved
            if curved < 0.0 and abs(back) < -curved:
                dq[i] = limits[SPEED, i] * back / curved
                bias_and_inertia(tree, q, dq, work, bias, inertia)
                here = (sign * bias[joint] - most) / inertia[joint]
                if here > worst:
                    worst, best = here, dq[i]
            dq[i] = best
            best = q[i]
            for k in range(2):
                moved = best + (2.0 * k - 1.0) * step * (limits[GREATEST, i] - limits[LEAST, i])
                q[i] = min(max(moved, limits[LEAST, i]), limits[GREATEST, i])
                bias_and_inertia(tree, q, dq, work, bias, inertia)
                here = (sign * bias[joint] - most) / inertia[joint]
                if here > worst:
                    worst, best = here, q[i]
            q[i] = best
        if not worst > before:
            step *= 0.5
            if step < FINEST:
                break
    return float(-sign * worst)
