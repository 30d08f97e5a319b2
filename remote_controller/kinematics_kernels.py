"""Compiled kinematics: what remains to be done after Pinocchio's pass."""

from __future__ import annotations

import numpy as np

from protocol.compilation import kernel
from protocol.messages import FloatArray


@kernel(
    "void(f8[::1,:], f8[:,::1], f8[::1], f8[::1], f8[::1,:], f8[::1], f8, i8[::1], f8[::1],"
    " f8[:,::1])"
)
def com_in_frame(
    com_jacobian: FloatArray,
    frame_jacobian: FloatArray,
    com: FloatArray,
    origin: FloatArray,
    rotation: FloatArray,
    root_moment: FloatArray,
    moving_share: float,
    order: np.ndarray,
    position_out: FloatArray,
    jacobian_out: FloatArray,
) -> None:
    """Centre of mass and its Jacobian, as seen from a frame of the robot.

    With c the centre of mass, o the frame's origin and R its rotation, all in the root frame:
    m = Rᵀ(c − o) and dm/dt = Rᵀ(ċ − ȯ + (c − o) × ω), where ω is the frame's angular velocity.

    Args:
        com_jacobian: (3, n) of the moving links, root frame, Pinocchio's order.
        frame_jacobian: (6, n), rows linear then angular, origin o, axes of the root frame.
        com: (3,) of the moving links [m], root frame.
        origin, rotation: o (3,) [m] and R (3, 3).
        root_moment: (3,) mass of the root link × its CoM / total mass [m].
        moving_share: mass of the moving links / total mass.
        order: (n,) column of each joint of the wire in Pinocchio's order.
        position_out: (3,) m [m].
        jacobian_out: (3, n) dm/dq [m/rad], columns in wire order.
    """
    dx = moving_share * com[0] + root_moment[0] - origin[0]
    dy = moving_share * com[1] + root_moment[1] - origin[1]
    dz = moving_share * com[2] + root_moment[2] - origin[2]
    for row in range(3):
        position_out[row] = rotation[0, row] * dx + rotation[1, row] * dy + rotation[2, row] * dz
    for joint in range(order.size):
        i = order[joint]
        wx, wy, wz = frame_jacobian[3, i], frame_jacobian[4, i], frame_jacobian[5, i]
        x = moving_share * com_jacobian[0, i] - frame_jacobian[0, i] + dy * wz - dz * wy
        y = moving_share * com_jacobian[1, i] - frame_jacobian[1, i] + dz * wx - dx * wz
        z = moving_share * com_jacobian[2, i] - frame_jacobian[2, i] + dx * wy - dy * wx
        for row in range(3):
            jacobian_out[row, joint] = (
                rotation[0, row] * x + rotation[1, row] * y + rotation[2, row] * z
            )
