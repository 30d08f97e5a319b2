"""Compiled: J̇·dq, what frames and the centre of mass accelerate by where no joint does.

Column s_j = (v_j, ω_j) of the root's Jacobian is the twist of joint j at the root's origin. All
joints before it carry it along: ṡ_j = ν_{<j} × s_j, × of two twists being (v, ω) × (v_j, ω_j) =
(ω × v_j + v × ω_j, ω × ω_j) (Featherstone, "Rigid Body Dynamics Algorithms", (2.31)). So what
they carry has the twist ν = Σ s_j·dq_j and, where ddq = 0, its rate a = Σ (ν_{<j} × s_j)·dq_j.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.messages import FloatArray
from hoap3.protocol.runtime.numba_jit import inlined, kernel

Mask = NDArray[np.bool_]

MINE, ITS = 0, 1  # motion of a frame, and of its reference, as those joints make it that differ


@inlined
def cross(a: FloatArray, b: FloatArray, row: int) -> float:
    """An element of a × b."""
    i, j = (row + 1) % 3, (row + 2) % 3
    return float(a[i] * b[j] - a[j] * b[i])


@inlined
def carry(twist: FloatArray, rate: FloatArray, joint: FloatArray, speed: float) -> None:
    """Add a joint to the twist ν (6,) of what it carries, and ν × s·dq to its rate a (6,).

    Args:
        twist, rate: ν and a of all joints before it; changed in place.
        joint: (6,) s, its twist at a speed of 1.
        speed: dq [rad/s or m/s].
    """
    for row in range(3):
        linear = cross(twist[3:], joint[:3], row) + cross(twist[:3], joint[3:], row)
        rate[row] += linear * speed
        rate[3 + row] += cross(twist[3:], joint[3:], row) * speed
    for row in range(6):
        twist[row] += joint[row] * speed


@inlined
def point_motion(
    twist: FloatArray, rate: FloatArray, point: FloatArray, velocity: FloatArray, out: FloatArray
) -> None:
    """Write velocity v + ω × p and acceleration a_v + a_ω × p + ω × ṗ of a carried point, (3,).

    ν = (v, ω) and a = (a_v, a_ω) are those at the root's origin.
    """
    for row in range(3):
        velocity[row] = twist[row] + cross(twist[3:], point, row)
    for row in range(3):
        out[row] = rate[row] + cross(rate[3:], point, row) + cross(twist[3:], velocity, row)


@inlined
def _seen(
    point: FloatArray,
    velocity: FloatArray,
    acceleration: FloatArray,
    twist: FloatArray,
    rate: FloatArray,
    rotation: FloatArray,
    scratch: FloatArray,
    out: FloatArray,
) -> None:
    """Write d²/dt² of Sᵀ(p − o), S and o of a reference that moves with ν and its rate a, (3,).

    As ȯ = v + ω × o and Ṡᵀx = −Sᵀ(ω × x), d/dt Sᵀ(p − o) = Sᵀ(ṗ − v − ω × p), and of that

    d/dt Sᵀ(ṗ − v − ω × p) = Sᵀ(p̈ − a_v − a_ω × p − ω × ṗ − ω × (ṗ − v − ω × p))

    ν and a are those at the root's origin, so o is not needed. scratch: (6,).
    """
    relative, turning = scratch[:3], scratch[3:]  # ṗ − v − ω × p, and what Sᵀ is taken of
    for row in range(3):
        relative[row] = velocity[row] - twist[row] - cross(twist[3:], point, row)
    for row in range(3):
        turning[row] = (
            acceleration[row]
            - rate[row]
            - cross(rate[3:], point, row)
            - cross(twist[3:], velocity, row)
            - cross(twist[3:], relative, row)
        )
    for row in range(3):
        out[row] = 0.0
        for i in range(3):
            out[row] += rotation[i, row] * turning[i]


@kernel("void(f8[:,:], f8[::1], f8[::1], b1[::1], f8[:,:], b1[::1], f8[::1])", allocates=True)
def frame_drift(
    joint_jacobian: FloatArray,
    dq: FloatArray,
    origin: FloatArray,
    moved_by: Mask,
    reference_rotation: FloatArray,
    reference_moved_by: Mask,
    out: FloatArray,
) -> None:
    """J̇·dq of a frame as seen from another.

    Joints that carry both are left out: they move both rigidly, and the relative pose, all that is
    differentiated here, does not depend on them.

    Args:
        joint_jacobian: (6, n) twist of what each joint moves, at the root's origin, root's axes.
        dq: (n,) in Pinocchio's order, in which carriers come first.
        origin, moved_by: of the frame, (3,) [m], and (n,) whether a joint moves it.
        reference_rotation, reference_moved_by: S (3, 3) and (n,) of the reference.
        out: (6,) d²p/dt² [m/s²] over dω/dt [rad/s²] where ddq = 0, in the reference's axes.
    """
    twist, rate, joint = np.zeros((2, 6)), np.zeros((2, 6)), np.empty(6)
    velocity, acceleration, scratch = np.empty(3), np.empty(3), np.empty(6)
    for i in range(dq.size):
        if moved_by[i] != reference_moved_by[i]:
            side = MINE if moved_by[i] else ITS
            joint[:] = joint_jacobian[:, i]
            carry(twist[side], rate[side], joint, dq[i])
    mine, its, my_rate, its_rate = twist[MINE], twist[ITS], rate[MINE], rate[ITS]
    point_motion(mine, my_rate, origin, velocity, acceleration)
    _seen(origin, velocity, acceleration, its, its_rate, reference_rotation, scratch, out[:3])
    for row in range(3):  # dω/dt of Sᵀ(ω − ω_o) = Sᵀ(a_ω − a_ω,o − ω_o × ω), o the reference
        scratch[row] = my_rate[3 + row] - its_rate[3 + row] - cross(its[3:], mine[3:], row)
    for row in range(3):
        out[3 + row] = 0.0
        for i in range(3):
            out[3 + row] += reference_rotation[i, row] * scratch[i]


@kernel(
    "void(f8[:,:], f8[::1], f8[::1], f8[::1], f8[::1], f8[:,:], b1[::1], f8[::1])", allocates=True
)
def com_drift(
    joint_jacobian: FloatArray,
    dq: FloatArray,
    com: FloatArray,
    com_velocity: FloatArray,
    com_acceleration: FloatArray,
    reference_rotation: FloatArray,
    reference_moved_by: Mask,
    out: FloatArray,
) -> None:
    """J̇·dq of the centre of mass as seen from a frame.

    Args:
        joint_jacobian, dq, reference_rotation, reference_moved_by: as of `frame_drift`.
        com, com_velocity, com_acceleration: (3,) of the whole robot where ddq = 0, in the root.
        out: (3,) [m/s²], in the reference's axes.
    """
    twist, rate, joint, scratch = np.zeros(6), np.zeros(6), np.empty(6), np.empty(6)
    for i in range(dq.size):
        if reference_moved_by[i]:
            joint[:] = joint_jacobian[:, i]
            carry(twist, rate, joint, dq[i])
    _seen(com, com_velocity, com_acceleration, twist, rate, reference_rotation, scratch, out)
