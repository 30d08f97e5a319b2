"""Distances of rounded boxes, and the rows that keep them, in plain numpy: QP12, (25).

`distance_kernels` and `distance_curvature_kernels` are compared with it. A box is the hull of its
eight corners, a capsule's core one with two extents of 0, a sphere's centre one with three.
"""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from hoap3.remote_controller.model.model_reference import cross_matrix, frame_motion

Array = NDArray[np.float64]

SIDES = np.array([*product((-1.0, 1.0), repeat=3)])


def corners(center: Array, axes: Array, half: Array) -> Array:
    """(8, 3), of a box with half its extents."""
    return np.asarray(center + (SIDES * half) @ axes.T)


def closest(first: Array, second: Array) -> tuple[Array, Array]:
    """The nearest points of two hulls, given by their corners, (a, 3) and (b, 3).

    Their difference is the point nearest to 0 of the hull of all differences, the columns of D:
    λ ≥ 0 minimises |[D; 1ᵀ]λ − (0, 1)| (Lawson and Hanson 1974, 23.27).
    """
    D = (first[:, None] - second).reshape(-1, 3).T
    size = np.linalg.norm(D, axis=0).min()  # as far apart as they are, or nearly so
    share, _ = nnls(np.vstack([D / max(size, 1e-3), np.ones(D.shape[1])]), np.eye(4)[3])
    share = share.reshape(len(first), -1) / share.sum()
    return share.sum(axis=1) @ first, share.sum(axis=0) @ second


def row(point: Array, n: Array, joints: Array, carried: Array) -> Array:
    """−∇m by joint, n·(v + ω × p) where they carry the first body (1), less the second (−1)."""
    return np.asarray(-carried * (n @ (joints[:3] - cross_matrix(point) @ joints[3:])))


def bound(m: float, eta: float, reserve: float, return_speed: float) -> float:
    """η(m − r) inside, not below 0; outside ηm, not below the greatest speed of a return."""
    return eta * max(m - reserve, 0.0) if m >= 0.0 else max(eta * m, -return_speed)


def curvature(m: float, ahead: float, behind: float, rate: float, eps: float) -> float:
    """m̈ from margins at ±ε: (m(±ε) − m ∓ εṁ)·2/ε², of the side where it is greater."""
    return 2.0 * max(ahead - m - eps * rate, behind - m + eps * rate) / eps**2


def facing(points: Array, n: Array, joints: Array, dq: Array, carried: Array) -> float:
    """n·(p̈ − r̈) where q̈ = 0 of p on the first body and r on the second, (2, 3)."""
    bend = 0.0
    for point, side in zip(points, (1.0, -1.0), strict=True):
        which = carried == side
        if which.any():
            moving = joints[:, which], dq[which]
            bend += side * float(n @ frame_motion(*moving, point, np.eye(3), own_axes=False)[2])
    return bend
