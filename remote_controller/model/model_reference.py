"""What tasks need of a robot's kinematics and dynamics, in plain numpy with 6 × 6 matrices.

`kinematics_kernels` and `frame_dynamics_kernels` are compared with it. Columns of `joints`, (6, n),
are the twists (v, ω) that the joints give what they move, at the root's origin; the order is one
for all here. A frame has its origin o and its rotation R in the root.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def cross_matrix(w: Array) -> Array:
    """The matrix [w]× of w × …, (3, 3)."""
    return np.array([[0.0, -w[2], w[1]], [w[2], 0.0, -w[0]], [-w[1], w[0], 0.0]])


def motion_cross(twist: Array) -> Array:
    """The matrix of (v, ω) × …, (6, 6), the cross product of twists (Featherstone 2008, 2.31)."""
    v, w = cross_matrix(twist[:3]), cross_matrix(twist[3:])
    return np.block([[w, v], [np.zeros((3, 3)), w]])


def to_frame(origin: Array, axes: Array) -> Array:
    """Of a twist at the root's origin: v + ω × o and ω, both in the axes, (6, 6)."""
    shift = np.block([[np.eye(3), -cross_matrix(origin)], [np.zeros((3, 3)), np.eye(3)]])
    return np.asarray(np.kron(np.eye(2), axes.T) @ shift)


def com_in_frame(
    com: Array, com_jacobian: Array, joints: Array, origin: Array, rotation: Array
) -> tuple[Array, Array]:
    """Rᵀ(c − o), (3,), and its Jacobian, (3, n): the frame moves with `joints`, 0 for the others.

    c is the robot's centre of mass, com_jacobian, (3, n), its Jacobian, both in the root.
    """
    carried = joints[:3] - cross_matrix(com) @ joints[3:]  # v + ω × c
    return rotation.T @ (com - origin), rotation.T @ (com_jacobian - carried)


def frame_in_frame(
    joints: Array, origin: Array, rotation: Array, moved: Array, other: tuple[Array, Array, Array]
) -> tuple[Array, Array, Array]:
    """Sᵀ(o − s), SᵀR and the Jacobian, (6, n), of a frame seen from another one, s and S.

    moved: (n,), which joints move the frame; other: s, S and which joints move that one.
    """
    s, S, carried = other
    apart = moved.astype(float) - carried.astype(float)
    return S.T @ (origin - s), S.T @ rotation, to_frame(origin, S) @ (joints * apart)


def frame_motion(
    joints: Array, dq: Array, origin: Array, rotation: Array, *, own_axes: bool
) -> tuple[Array, Array, Array]:
    """J, ν = J dq and J̇ dq of a frame, whose joints come from the root outwards.

    In the frame's own axes, six rows; or of its origin in the root's, three.
    """
    root_twist, root_rate = np.zeros(6), np.zeros(6)
    for column, rate in zip(joints.T, dq, strict=True):
        root_rate += motion_cross(root_twist) @ column * rate  # ṡ_j = ν_{<j} × s_j
        root_twist += column * rate
    X = to_frame(origin, rotation if own_axes else np.eye(3))
    J, twist, drift = X @ joints, X @ root_twist, X @ root_rate
    if own_axes:
        return J, twist, drift
    return J[:3], twist[:3], drift[:3] + np.cross(twist[3:], twist[:3])
