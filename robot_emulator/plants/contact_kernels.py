"""Compiled contact of points with compliant planes: where they touch, and what forces that gives.

Forces are (normal, first tangent, second tangent), velocities likewise, the normal pointing away
from the plane. With the depth δ, the velocity v at the end of a step of h, and D' = max(D, h·K):

    f_n = max(0, K·δ − D'·v_n) where δ > 0, else 0
    f_t = −μ·f_n·v_t / max(|v_t|, `CREEP`)

So both damper and friction act on the velocity that they lead to. See `contact`.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.messages import FloatArray
from hoap3.protocol.runtime.numba_jit import inlined, kernel

CREEP = 1e-3  # m/s: above it friction is Coulomb's, below it grows in proportion
ROUNDS, STEPS = 200, 60  # at most, of contacts against each other, and within one
PRECISION = 1e-13  # relative to the largest force
NOTHING = 1e-200  # N: no friction under less


@kernel("i8(f8[:,:,::1], i8[::1], f8[:,::1], f8[:,:,::1], f8[::1], f8[:,::1], f8[::1])")
def touch(
    places: FloatArray,
    carriers: NDArray[np.int64],
    offsets: FloatArray,
    axes: FloatArray,
    levels: FloatArray,
    points_out: FloatArray,
    depths_out: FloatArray,
) -> int:
    """Find the points and how deep they are.

    Args:
        places: (b, 3, 4) rotation and origin [m] of each body in the root.
        carriers: (c,) body of each point.
        offsets: (c, 3) the point in that body [m].
        axes: (c, 3, 3) normal and two tangents, one a row, in the root's axes.
        levels: (c,) of the planes along their normals [m].
        points_out: (c, 3) in the root [m].
        depths_out: (c,) positive inside [m].

    Returns:
        How many touch.
    """
    touching = 0
    for c in range(carriers.size):
        depths_out[c] = levels[c]
        for i in range(3):
            place = places[carriers[c], i]
            points_out[c, i] = place[3]
            for j in range(3):
                points_out[c, i] += place[j] * offsets[c, j]
            depths_out[c] -= axes[c, 0, i] * points_out[c, i]
        touching += depths_out[c] > 0.0
    return touching


@kernel("void(f8[:,:], i8[::1], b1[:,::1], f8[:,:,::1], f8[:,::1], f8[:,:,::1])")
def contact_rows(
    joint_jacobian: FloatArray,
    order: NDArray[np.int64],
    movers: NDArray[np.bool_],
    axes: FloatArray,
    points: FloatArray,
    rows_out: FloatArray,
) -> None:
    """Write the Jacobian of each point along its axes.

    Args:
        joint_jacobian: (6, n) v and ω of what each joint moves, at the root's origin, in
            Pinocchio's order.
        order: (n,) column there of each joint of the wire, and of each mimic joint behind them.
        movers: (c, n) which of them move a point.
        axes, points: see `touch`.
        rows_out: (c, 3, n) in that order.
    """
    for c in range(points.shape[0]):
        x, y, z = points[c, 0], points[c, 1], points[c, 2]
        for i in range(order.size):
            if not movers[c, i]:
                continue  # 0 since the beginning
            k = order[i]
            wx, wy, wz = joint_jacobian[3, k], joint_jacobian[4, k], joint_jacobian[5, k]
            vx = joint_jacobian[0, k] + wy * z - wz * y
            vy = joint_jacobian[1, k] + wz * x - wx * z
            vz = joint_jacobian[2, k] + wx * y - wy * x
            for r in range(3):
                rows_out[c, r, i] = axes[c, r, 0] * vx + axes[c, r, 1] * vy + axes[c, r, 2] * vz


@kernel("void(f8[:,:,::1], f8[::1], f8[:,::1], f8[::1], f8, f8[:,::1], f8[::1])", allocates=True)
def react(
    rows: FloatArray,
    depths: FloatArray,
    laws: FloatArray,
    dq: FloatArray,
    h: float,
    forces_out: FloatArray,
    torque_out: FloatArray,
) -> None:
    """Forces at a velocity, and the torques of all of them.

    Args:
        rows: (c, 3, n) Jacobians.
        depths: (c,) [m].
        laws: (c, 3) K [N/m], D [N s/m] and μ.
        dq: (n,) velocities at the end of the step.
        h: its length [s].
        forces_out: (c, 3) [N].
        torque_out: (n,) Σ Jᵀf [N m or N].
    """
    torque_out[:] = 0.0
    for c in range(depths.size):
        forces_out[c] = 0.0
        if depths[c] <= 0.0:
            continue
        v = np.zeros(3)
        for r in range(3):
            for i in range(dq.size):
                v[r] += rows[c, r, i] * dq[i]
        damping = max(laws[c, 1], h * laws[c, 0])
        forces_out[c, 0] = max(0.0, laws[c, 0] * depths[c] - damping * v[0])
        grip = laws[c, 2] * forces_out[c, 0] / max(math.hypot(v[1], v[2]), CREEP)
        forces_out[c, 1], forces_out[c, 2] = -grip * v[1], -grip * v[2]
        for r in range(3):
            for i in range(dq.size):
                torque_out[i] += rows[c, r, i] * forces_out[c, r]


@inlined
def _rub(a: float, b: float, d: float, u: float, v: float, most: float) -> tuple[float, float]:
    """Friction f = −most·w / max(|w|, CREEP) where w = (u, v) + [[a, b], [b, d]]·f.

    That is f = −(H + r)⁻¹·(u, v), with r = CREEP/most, or, where this exceeds `most`, with the r
    that makes |f| = most: Newton's method on 1/|f|, as for a trust region.
    """
    x, y = 0.0, 0.0
    if most < NOTHING:
        return x, y
    r = CREEP / most
    for _ in range(STEPS):
        p, q = a + r, d + r
        det = p * q - b * b
        x, y = (b * v - q * u) / det, (b * u - p * v) / det
        size = math.hypot(x, y)
        if size <= most * (1.0 + PRECISION):
            break
        slope = (x * (q * x - b * y) + y * (p * y - b * x)) / det
        r += (size / most - 1.0) * size * size / slope
    size = math.hypot(x, y)
    if size > most:
        x, y = x * most / size, y * most / size
    return x, y


@inlined
def _factorise(mass: FloatArray, order: NDArray[np.int64], L: FloatArray) -> None:
    """L·Lᵀ = M, in wire order, by Cholesky."""
    for i in range(order.size):
        for j in range(i + 1):
            a, b = order[i], order[j]
            value = mass[a, b] if a <= b else mass[b, a]
            for k in range(j):
                value -= L[i, k] * L[j, k]
            L[i, j] = math.sqrt(value) if i == j else value / L[j, j]


@inlined
def _halve(L: FloatArray, row: FloatArray, half: FloatArray) -> None:
    """L·half = row, so that row·M⁻¹·rowᵀ = half·half."""
    for i in range(row.size):
        value = row[i]
        for k in range(i):
            value -= L[i, k] * half[k]
        half[i] = value / L[i, i]


@inlined
def _raise(L: FloatArray, total: FloatArray) -> None:
    """Solve Lᵀ·x = total, in place."""
    n = total.size
    for j in range(n):
        i = n - 1 - j
        for k in range(i + 1, n):
            total[i] -= L[k, i] * total[k]
        total[i] /= L[i, i]


@inlined
def _answer(
    W: FloatArray, v: FloatArray, depth: float, law: FloatArray, h: float, f: FloatArray
) -> None:
    """One contact's force of the law, where its velocity is v + W·f; `f`, (3,), is changed."""
    damping = max(law[1], h * law[0])
    speed = v[0] + W[0, 1] * f[1] + W[0, 2] * f[2]
    f[0] = max(0.0, (law[0] * depth - damping * speed) / (1.0 + damping * W[0, 0]))
    along, across = v[1] + W[1, 0] * f[0], v[2] + W[2, 0] * f[0]
    f[1], f[2] = _rub(W[1, 1], W[1, 2], W[2, 2], along, across, law[2] * f[0])


@inlined
def _settle(
    W: FloatArray, free: FloatArray, depths: FloatArray, laws: FloatArray, h: float, f: FloatArray
) -> None:
    """All forces f, (c, 3), of the law where the velocities are free + W·f.

    Each contact in turn answers the forces of the others, until none changes (Gauss-Seidel).
    """
    before, v = np.zeros(3), np.zeros(3)
    for _ in range(ROUNDS):
        change = largest = 0.0
        for c in range(depths.size):
            if depths[c] <= 0.0:
                continue
            v[:] = free[c]
            for r in range(3):
                for a in range(depths.size):
                    for s in range(3 if a != c else 0):
                        v[r] += W[c, a, r, s] * f[a, s]
            before[:] = f[c]
            _answer(W[c, c], v, depths[c], laws[c], h, f[c])
            for r in range(3):
                change = max(change, abs(f[c, r] - before[r]))
                largest = max(largest, abs(f[c, r]))
        if change <= PRECISION * largest:
            break


@kernel(
    "void(f8[:,:], i8[::1], f8[:,:,::1], f8[::1], f8[:,::1], f8[::1], f8,"
    " f8[:,::1], f8[:,:,::1], f8[:,:,:,::1], f8[:,::1], f8[::1])",
    allocates=True,
)
def push(
    mass: FloatArray,
    order: NDArray[np.int64],
    rows: FloatArray,
    depths: FloatArray,
    laws: FloatArray,
    dq: FloatArray,
    h: float,
    L: FloatArray,
    half: FloatArray,
    W: FloatArray,
    forces_out: FloatArray,
    ddq: FloatArray,
) -> None:
    """Forces of the law at the velocities that a step of `h` [s] under them leads to.

    Those are the ones without contact plus W·f, W = h·J·M⁻¹·Jᵀ.

    Args:
        mass: (n, n) upper triangle of M, Pinocchio's order.
        order, rows, depths, laws: see above.
        dq: (n,) velocities at the begin of the step.
        h: its length [s].
        L, half, W: (n, n), (c, 3, n) and (c, c, 3, 3) for the kernel's own use.
        forces_out: (c, 3) [N].
        ddq: (n,) accelerations without contact; what the forces give is added.
    """
    count = depths.size
    _factorise(mass, order, L)
    free, total = np.zeros((count, 3)), np.zeros(dq.size)
    forces_out[:] = 0.0
    for c in range(count):
        for r in range(3):
            _halve(L, rows[c, r], half[c, r])
            for i in range(dq.size):
                free[c, r] += rows[c, r, i] * (dq[i] + h * ddq[i])
    for c, a in np.ndindex(count, count):
        for r, s in np.ndindex(3, 3):
            W[c, a, r, s] = 0.0
            for i in range(dq.size):
                W[c, a, r, s] += h * half[c, r, i] * half[a, s, i]
    _settle(W, free, depths, laws, h, forces_out)
    for c, r in np.ndindex(count, 3):
        for i in range(dq.size):
            total[i] += half[c, r, i] * forces_out[c, r]
    _raise(L, total)
    for i in range(dq.size):
        ddq[i] += total[i]


@kernel(
    "void(f8[:,:,::1], i8[::1], f8[:,:,::1], b1[:,::1], f8[:,::1], f8[:,:,::1], f8[:,::1], f8,"
    " f8[::1])",
    allocates=True,
)
def sense(
    places: FloatArray,
    carriers: NDArray[np.int64],
    mounts: FloatArray,
    carried: NDArray[np.bool_],
    points: FloatArray,
    axes: FloatArray,
    forces: FloatArray,
    share: float,
    wrench: FloatArray,
) -> None:
    """Add `share` of what sensors measure: the wrench that the surroundings exert on the robot.

    Args:
        places: see `touch`.
        carriers: (s,) body of each sensor.
        mounts: (s, 3, 4) its rotation and origin in that body.
        carried: (s, c) whether it feels a contact.
        points, axes, forces: of the contacts, see above.
        share: of the whole.
        wrench: (6s,) force [N] and torque [N m] about the sensor's origin, in its axes.
    """
    for s in range(carriers.size):
        R, mount = places[carriers[s]], mounts[s]
        whole = np.zeros(6)
        arm, f = np.zeros(3), np.zeros(3)
        for c in range(points.shape[0]):
            if not carried[s, c]:
                continue
            for i in range(3):
                arm[i] = points[c, i] - R[i, 3]
                f[i] = 0.0
                for j in range(3):
                    arm[i] -= R[i, j] * mount[j, 3]
                    f[i] += axes[c, j, i] * forces[c, j]
            for i in range(3):
                j, k = (i + 1) % 3, (i + 2) % 3
                whole[i] += f[i]
                whole[3 + i] += arm[j] * f[k] - arm[k] * f[j]
        for i in range(3):
            for j in range(3):
                axis = 0.0  # component j of the sensor's axis i, in the root
                for k in range(3):
                    axis += R[j, k] * mount[k, i]
                wrench[6 * s + i] += share * axis * whole[j]
                wrench[6 * s + 3 + i] += share * axis * whole[3 + j]
