"""Compiled kinematics: what remains to be done after Pinocchio's pass, and the Euler step."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.limits.setpoint_limits_kernels import (
    JointLimits,
    own_start,
    taken_over,
    within,
)
from hoap3.protocol.messages import FloatArray
from hoap3.protocol.runtime.numba_jit import kernel

AT_REST, FOLLOWED, UNKNOWN = 0, 1, 2
"""What is known of the reference: it rests; how it moved since the last State; nothing."""


@kernel(  # Pinocchio's matrices are of any layout: with one joint, Fortran's and C's are the same
    "void(f8[:,:], f8[:,:], f8[::1], f8[::1], f8[:,:], b1[::1], f8[::1], f8, i8[::1], f8[::1],"
    " f8[:,::1])"
)
def com_in_frame(
    com_jacobian: FloatArray,
    joint_jacobian: FloatArray,
    com: FloatArray,
    origin: FloatArray,
    rotation: FloatArray,
    moved_by: NDArray[np.bool_],
    root_moment: FloatArray,
    moving_share: float,
    order: NDArray[np.int64],
    position_out: FloatArray,
    jacobian_out: FloatArray,
) -> None:
    """Centre of mass and its Jacobian, as seen from a frame of the robot.

    With c the centre of mass, o the frame's origin and R its rotation, all in the root frame,
    m = Rᵀ(c − o). The frame turns with ω, and what is fixed to it moves with v + ω × p at p, so
    dm/dt = Rᵀ(dc/dt − v − ω × c).

    Args:
        com_jacobian: (3, n) of the moving links, root frame, Pinocchio's order.
        joint_jacobian: (6, n) v and ω of what each joint moves, at the root's origin.
        com: (3,) of the moving links [m], root frame.
        origin, rotation: o (3,) [m] and R (3, 3).
        moved_by: (n,) whether a joint moves the frame.
        root_moment: (3,) mass of the root link × its CoM / total mass [m].
        moving_share: mass of the moving links / total mass.
        order: (n,) column of each joint of the wire in Pinocchio's order.
        position_out: (3,) m [m].
        jacobian_out: (3, n) dm/dq [m/rad], columns in wire order.
    """
    cx = moving_share * com[0] + root_moment[0]
    cy = moving_share * com[1] + root_moment[1]
    cz = moving_share * com[2] + root_moment[2]
    dx, dy, dz = cx - origin[0], cy - origin[1], cz - origin[2]
    for row in range(3):
        position_out[row] = rotation[0, row] * dx + rotation[1, row] * dy + rotation[2, row] * dz
    for joint in range(order.size):
        i = order[joint]
        x = moving_share * com_jacobian[0, i]
        y = moving_share * com_jacobian[1, i]
        z = moving_share * com_jacobian[2, i]
        if moved_by[i]:
            wx, wy, wz = joint_jacobian[3, i], joint_jacobian[4, i], joint_jacobian[5, i]
            x -= joint_jacobian[0, i] + wy * cz - wz * cy
            y -= joint_jacobian[1, i] + wz * cx - wx * cz
            z -= joint_jacobian[2, i] + wx * cy - wy * cx
        for row in range(3):
            jacobian_out[row, joint] = (
                rotation[0, row] * x + rotation[1, row] * y + rotation[2, row] * z
            )


@kernel(
    "void(f8[:,:], f8[::1], f8[:,:], b1[::1], f8[::1], f8[:,:], b1[::1], i8[::1], f8[::1],"
    " f8[:,::1], f8[:,::1])"
)
def frame_in_frame(
    joint_jacobian: FloatArray,
    origin: FloatArray,
    rotation: FloatArray,
    moved_by: NDArray[np.bool_],
    reference_origin: FloatArray,
    reference_rotation: FloatArray,
    reference_moved_by: NDArray[np.bool_],
    order: NDArray[np.int64],
    position_out: FloatArray,
    rotation_out: FloatArray,
    jacobian_out: FloatArray,
) -> None:
    """Placement and Jacobian of a frame, as seen from another frame of the robot.

    With o, R of the frame and s, S of the reference in the root frame, p = Sᵀ(o − s) and the
    rotation is SᵀR. A joint gives everything beyond it the twist (v, ω) at the root's origin, so
    that o moves with v + ω × o. Joints before both frames carry them alike and give exactly 0;
    those before the frame alone give Sᵀ(v + ω × o) and Sᵀω, and those before the reference alone
    minus that.

    Args:
        joint_jacobian: (6, n) v and ω of what each joint moves, at the root's origin.
        origin, rotation, moved_by: o (3,) [m], R (3, 3), and (n,) whether a joint moves the frame.
        reference_origin, reference_rotation, reference_moved_by: those of the reference.
        order: (n,) column of each joint of the wire in Pinocchio's order.
        position_out: (3,) p [m].
        rotation_out: (3, 3) SᵀR.
        jacobian_out: (6, n) dp/dq [m/rad] over the angular velocity in the reference's axes
            [rad/rad], columns in wire order.
    """
    S = reference_rotation
    ox, oy, oz = origin[0], origin[1], origin[2]
    dx, dy, dz = ox - reference_origin[0], oy - reference_origin[1], oz - reference_origin[2]
    for row in range(3):
        position_out[row] = S[0, row] * dx + S[1, row] * dy + S[2, row] * dz
        for column in range(3):
            rotation_out[row, column] = (
                S[0, row] * rotation[0, column]
                + S[1, row] * rotation[1, column]
                + S[2, row] * rotation[2, column]
            )
    for joint in range(order.size):
        i = order[joint]
        if moved_by[i] == reference_moved_by[i]:
            for row in range(6):
                jacobian_out[row, joint] = 0.0
            continue
        sign = 1.0 if moved_by[i] else -1.0
        wx = sign * joint_jacobian[3, i]
        wy = sign * joint_jacobian[4, i]
        wz = sign * joint_jacobian[5, i]
        x = sign * joint_jacobian[0, i] + wy * oz - wz * oy
        y = sign * joint_jacobian[1, i] + wz * ox - wx * oz
        z = sign * joint_jacobian[2, i] + wx * oy - wy * ox
        for row in range(3):
            jacobian_out[row, joint] = S[0, row] * x + S[1, row] * y + S[2, row] * z
            jacobian_out[3 + row, joint] = S[0, row] * wx + S[1, row] * wy + S[2, row] * wz


@kernel("Tuple((i8, i8))(f8[::1], f8[::1], f8, f8, i8, f8[::1], f8[:,::1], f8[::1], f8[::1])")
def euler_step(
    start: FloatArray,
    u: FloatArray,
    T: float,
    active_speed: float,
    history: int,
    reference: FloatArray,
    limits: FloatArray,
    earlier: FloatArray,
    out: FloatArray,
) -> tuple[int, int]:
    """Write start + u·T, and judge it as the robot will; arrays are (n,) [rad or m].

    Args:
        start, u: positions, and velocities [rad/s or m/s].
        T: period [s].
        active_speed: from which on a joint counts as active [rad/s or m/s].
        history: `AT_REST`, `FOLLOWED` or `UNKNOWN`. In the latter case no joint is sure to be
            taken over.
        reference: that the robot applies.
        limits: (4, n) of the robot: least and greatest position, greatest speed, greatest
            acceleration. As in the robot, the range of a joint ends where its reference is, if that
            is beyond: servos that give way may need it there from the start.
        earlier: reference of one period ago; becomes that of now.
        out: the last answer; becomes the new one.

    Returns:
        How many joints are active, and how many the robot may hold back; -1 and nothing written
        where the lengths of `start`, `u` and `out` differ.
    """
    active, beyond = 0, 0
    if start.size != out.size or u.size != out.size:
        return -1, beyond
    for i in range(out.size):
        q, s = reference[i], start[i] + u[i] * T
        lower, upper = min(limits[0, i], q), max(limits[1, i], q)
        speed, acceleration = limits[2, i], limits[3, i]
        v = (q - earlier[i]) / T if history == FOLLOWED else 0.0
        before = within(out[i], lower, upper) if history == FOLLOWED else q
        begin = own_start(before, s, q, speed, T)
        taken = taken_over(s, begin, q, v, JointLimits(lower, upper, speed, acceleration), T)
        beyond += not (taken and history != UNKNOWN)
        active += abs(u[i]) >= active_speed
        earlier[i], out[i] = q, s
    return active, beyond
