"""J̇·dq of frames and of the centre of mass in plain numpy, by poses as 4 × 4 matrices.

`drift_kernels` is compared with it. Columns of `joints`, (6, n), are the twists (v, ω) that the
joints give what they move, at the root's origin, from the root outwards. What moves with the twist
ν has the pose H with Ḣ = [ν]H, so Ḧ = ([ν̇] + [ν]²)H; seen from a frame it is X·H, X the inverse of
that frame's pose.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hoap3.remote_controller.model.model_reference import cross_matrix

Array = NDArray[np.float64]


def matrix(twist: Array) -> Array:
    """[ν] of (v, ω), (4, 4): it takes a point (p, 1) to its velocity (v + ω × p, 0)."""
    return np.block([[cross_matrix(twist[3:]), twist[:3, None]], [np.zeros((1, 4))]])


def motion(joints: Array, dq: Array, moved: Array) -> tuple[Array, Array]:
    """[ν] and [ν̇], (4, 4), of what the joints in `moved`, (n,), carry, where ddq = 0.

    ν̇ = Σ (ν_{<j} × s_j)·dq_j, and [a × b] = [a][b] − [b][a] (Featherstone 2008, 2.31).
    """
    nu, rate = np.zeros((2, 4, 4))
    for joint, speed in zip(joints.T[moved], dq[moved], strict=True):
        s = matrix(joint)
        rate += (nu @ s - s @ nu) * speed
        nu += s * speed
    return nu, rate


def seen(
    pose: Array, nu: Array, rate: Array, H: Array, dH: Array, ddH: Array
) -> tuple[Array, Array, Array]:
    """X·H and its two derivatives in time; pose: X⁻¹, of a frame that moves by [ν] and [ν̇]."""
    X = np.linalg.inv(pose)
    dX, ddX = -X @ nu, X @ (nu @ nu - rate)
    return X @ H, dX @ H + X @ dH, ddX @ H + 2.0 * dX @ dH + X @ ddH


def frame_drift(
    joints: Array, dq: Array, pose: Array, moved: Array, other: Array, carried: Array
) -> Array:
    """d²p/dt² over dω/dt, (6,), of a frame as seen from another one, in that one's axes.

    pose, moved: (4, 4) in the root, and which joints move it; other, carried: of the other one.
    """
    nu, rate = motion(joints, dq, moved)
    first, second = nu @ pose, (rate + nu @ nu) @ pose
    H, dH, ddH = seen(other, *motion(joints, dq, carried), pose, first, second)
    R, dR, ddR = H[:3, :3], dH[:3, :3], ddH[:3, :3]
    turning = ddR @ R.T + dR @ dR.T  # [dω/dt], the rate of [ω] = Ṙ Rᵀ
    return np.hstack([ddH[:3, 3], turning[2, 1], turning[0, 2], turning[1, 0]])


def com_drift(
    joints: Array, dq: Array, com: Array, velocity: Array, acceleration: Array, *frame: Array
) -> Array:
    """c̈ of the centre of mass, (3,), as seen from a frame: its pose, and which joints move it."""
    other, carried = frame
    points = np.append(com, 1.0), np.append(velocity, 0.0), np.append(acceleration, 0.0)
    return seen(other, *motion(joints, dq, carried), *points)[2][:3]
